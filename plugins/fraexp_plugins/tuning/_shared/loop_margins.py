"""Margins that a loop keeps for every plant of a band and every amplitude of friction's describing function.

The loop 1 + C G P/(1 + P N) vanishes where 1/P + N + C G does. The inverse of the plant lies in a disc, so that the
sum does too, and everything that is asked about it has a closed form.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Controller
from fraexp_plugins.tuning._shared.plant_band import PlantBand


@dataclass(frozen=True)
class Margins:
    """Margins that are guaranteed."""

    modulus: float
    """Smallest distance of the loop's response from -1, 1/max|S|."""
    gain: float
    """Factor up to which the gain may rise; infinite without a limit."""
    gain_reduction: float
    """Factor down to which the gain may fall; 0 without a limit."""
    phase: float
    """Phase lag that may be added [rad]; infinite without a limit."""


@dataclass(frozen=True)
class LoopFamily:
    """All loops of a controller: one for each plant of the band and each amplitude."""

    band: PlantBand
    friction: NDArray[np.complex128]
    """N + jω Dv [N/m], shape (frequencies, amplitudes)."""
    path: NDArray[np.complex128]
    """Response of hold, delays and aliasing images [1], shape (frequencies,)."""
    sample_time: float
    frequency_reserve: float = 0.5
    """How far from its grid a loop may be, over the distance to the neighbouring frequency's."""
    amplitude_reserve: float = 0.5
    """The same over the distance to the neighbouring amplitude's."""

    def thinned(self, frequencies: int, amplitudes: int) -> "LoopFamily":
        """Return the family at every so many frequencies and amplitudes, for a first search."""
        rows = slice(None, None, frequencies)
        return LoopFamily(
            self.band.rows(rows),
            self.friction[rows, ::amplitudes],
            self.path[rows],
            self.sample_time,
            self.frequency_reserve / frequencies,  # that of the whole family, as near as it matters
            self.amplitude_reserve / amplitudes,
        )

    def control(self, controller: Controller) -> NDArray[np.complex128]:
        """Return C G [N/m], shape (frequencies,)."""
        return controller.response(2 * np.pi * self.band.frequency, self.sample_time) * self.path

    def sensitivity(self, control: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return an upper bound of |S| for all plants, shape (frequencies, amplitudes); infinite where one may fail."""
        middle, radius, is_inside = self._sum(control)
        power = np.abs(middle) ** 2 - radius**2
        safe = np.where(is_inside, power, 1.0)
        centre = 1 - control[:, None] * np.conj(middle) / safe
        spread = np.abs(control)[:, None] * radius / np.abs(safe)
        return np.where(is_inside, np.abs(centre) + spread, np.inf)

    def is_safe(self, control: NDArray[np.complex128]) -> bool:
        """Return whether no plant of the band and no amplitude brings the loop to -1."""
        return bool(np.all(self._sum(control)[2]))

    def margins(self, control: NDArray[np.complex128]) -> Margins:
        """Return the margins of C G; all are 0, and the gain's 1, if the loop itself may be unstable.

        They are where the disc of 1/P + N + k C G, or that with a lag, first reaches 0.
        """
        worst = float(self.sensitivity(control).max())
        if not np.isfinite(worst):
            return Margins(0.0, 1.0, 1.0, 0.0)
        middle, radius, _ = self._sum(control)
        driven = np.broadcast_to(control[:, None], middle.shape)
        plant = middle - driven
        size, product = np.abs(driven), np.real(np.conj(plant) * driven)
        surplus = np.abs(plant) ** 2 - radius**2
        with np.errstate(invalid="ignore"):
            root = np.sqrt(product**2 - size**2 * surplus)
            factors = np.array([(-product - root) / size**2, (-product + root) / size**2])
            opening = np.arccos((radius**2 - np.abs(plant) ** 2 - size**2) / (2 * np.abs(plant) * size))
        between = np.angle(driven) - np.angle(plant)
        lags = np.mod(np.array([between - opening, between + opening]), 2 * np.pi)
        return Margins(
            1 / worst,
            float(np.where(factors > 1, factors, np.inf).min()),
            float(np.where((factors > 0) & (factors < 1), factors, 0.0).max()),
            float(np.where(np.isfinite(lags), lags, np.inf).min()),
        )

    def _sum(
        self, control: NDArray[np.complex128]
    ) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.bool_]]:
        """Return centre and radius of the disc of 1/P + N + C G, and whether 0 is none of its values."""
        band = self.band
        middle = (band.centre + control)[:, None] + self.friction
        step = self.frequency_reserve * _neighbour_gap(control)[:, None] + self._plant_reserve
        outside = band.is_outside[:, None]
        radius = np.where(outside, band.inverse_radius[:, None], band.inverse_radius[:, None] + step)
        return middle, radius, np.where(outside, np.abs(middle) < radius, np.abs(middle) > radius)

    @cached_property
    def _plant_reserve(self) -> NDArray[np.float64]:
        """How far 1/P + N may be from its grid [N/m], shape (frequencies, amplitudes)."""
        along = self.frequency_reserve * _neighbour_gap((1 / self.band.nominal)[:, None] + self.friction)
        return along + self.amplitude_reserve * _neighbour_gap(self.friction.T).T


def _neighbour_gap(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the greater one of the distances to the values before and behind, along the first axis."""
    steps = np.abs(np.diff(values, axis=0))
    gap = np.zeros(values.shape)
    gap[:-1] = steps
    gap[1:] = np.maximum(gap[1:], steps)
    return gap
