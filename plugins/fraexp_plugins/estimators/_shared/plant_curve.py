"""The inverse of the plant between measured frequencies, and how well it is known there."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

MAX_FREQUENCY_RATIO = 1.5
"""Ratio of two neighbouring frequencies, at most, between which the plant is interpolated: more may hide a mode."""
MAX_BEND = 0.5
"""Distance of a value from the straight line between its neighbours, relative to the greatest of them, from which an
antiresonance may lie there."""


class PlantCurve(NamedTuple):
    """The apparent mass -1/(ω² P) [kg] over ln ω, shape (n,): linear in friction, smooth but for antiresonances."""

    place: NDArray[np.float64]
    value: NDArray[np.complex128]
    deviation: NDArray[np.float64]
    """What its band has for radius [kg]; 0 where it is unknown."""

    @classmethod
    def of(cls, omega: NDArray[np.float64], inverse: NDArray[np.complex128], deviation: NDArray[np.float64]) -> Self:
        """Return the curve through 1/P [N/m] at ω [rad/s], with the radius of its band [N/m], shape (n,) each."""
        usable = np.isfinite(inverse)
        omega, inverse, deviation = omega[usable], inverse[usable], deviation[usable]
        place, order = np.unique(np.log(omega), return_index=True)
        mass = -inverse[order] / omega[order] ** 2
        return cls(place, mass, np.nan_to_num(deviation[order], nan=0.0, posinf=np.inf) / omega[order] ** 2)

    @property
    def has_close_frequencies(self) -> bool:
        """Whether the plant is known between any two frequencies, with others beside them."""
        return self.place.size > 2 and float(np.diff(self.place).min()) <= np.log(MAX_FREQUENCY_RATIO)

    def is_close(self, omega: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether frequencies [rad/s] lie between two that are close to each other, shape (k,)."""
        place = np.log(omega)
        inside = (place >= self.place[0]) & (place <= self.place[-1])
        left, right = self._ends(omega)
        return np.asarray(inside & (self.place[right] - self.place[left] <= np.log(MAX_FREQUENCY_RATIO)))

    def is_known(self, omega: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether frequencies [rad/s] lie between two that are close, without a mode between them, shape (k,).

        An antiresonance between two frequencies bends the curve at both.
        """
        left, right = self._ends(omega)
        share = (self.place[1:-1] - self.place[:-2]) / (self.place[2:] - self.place[:-2])
        bend = np.abs(self.value[1:-1] - (1 - share) * self.value[:-2] - share * self.value[2:])
        greatest = np.abs(np.stack([self.value[1:-1], self.value[:-2], self.value[2:]])).max(axis=0)
        is_smooth = np.concatenate([[True], bend <= MAX_BEND * greatest, [True]])
        return np.asarray(self.is_close(omega) & is_smooth[left] & is_smooth[right])

    def sharing(self, omega: NDArray[np.float64], counts: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return how many of the frequencies that count lie between the same two, and share their error, shape (k,)."""
        left, _ = self._ends(omega)
        return np.maximum(np.bincount(left[counts], minlength=self.place.size)[left], 1.0)

    def inverse(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return 1/P [N/m] by cubics whose slopes at both ends are those of parabolas, shape (k,)."""
        straight, begin, end = self._parts(omega)
        return np.asarray(-(straight + begin - end) * omega**2)

    def error(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the error of that [N/m], shape (k,).

        It is the band's, and the distance to straight lines: how far they are off bounds how far the cubic is. Where a
        mode bends the curve at both ends alike the cubic crosses the line, and is no better there: sizes are added.
        """
        _, begin, end = self._parts(omega)
        left, right = self._ends(omega)
        band = np.maximum(self.deviation[left], self.deviation[right])
        return np.asarray((np.abs(begin) + np.abs(end) + band) * omega**2)

    def _parts(self, omega: NDArray[np.float64]) -> tuple[NDArray[np.complex128], ...]:
        """Return the straight lines, and what the slopes at the left and at the right end of each add, shape (k,)."""
        left, right = self._ends(omega)
        slope, step = np.gradient(self.value, self.place), self.place[right] - self.place[left]
        part = (np.log(omega) - self.place[left]) / step
        rise = self.value[right] - self.value[left]
        height = part * (1 - part)
        begin, end = (1 - part) * (step * slope[left] - rise), part * (step * slope[right] - rise)
        return self.value[left] + part * rise, height * begin, height * end

    def _ends(self, omega: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the numbers of the frequencies between which others lie."""
        right = np.clip(np.searchsorted(self.place, np.log(omega)), 1, self.place.size - 1)
        return right - 1, right
