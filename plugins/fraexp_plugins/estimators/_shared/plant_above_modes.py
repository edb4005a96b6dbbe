"""The plant at multiples of the excited frequencies, as the motion there shows it.

Nothing is excited there: the friction force F alone moves the plant, Y = -P F. So P follows from the harmonics that
stand out of the noise, by local regression over the logarithm of the frequency: W. S. Cleveland, J. Am. Stat. Assoc.
74(368), 1979, doi:10.1080/01621459.1979.10481038. Above the highest of them it falls as c/(jω)^r.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse
from fraexp_plugins.estimators._shared.measured_motion import LEAST_ERROR, LikelyTerms, MeasuredMotion

BANDWIDTH = 0.3
"""Natural logarithm of the ratio of frequencies up to which harmonics, or points of a response, count as near: with
half of it, and with twice as much, the harmonics do not tell a dead time."""
MIN_CLEAR_HARMONICS = 8
"""Number of harmonics within the bandwidth, which stand out of the noise, from which the plant is known."""


class Harmonics(NamedTuple):
    """Terms of a motion that friction causes, shape (n,)."""

    omega: NDArray[np.float64]
    """Their frequencies [rad/s]."""
    motion: NDArray[np.complex128]
    """Measured terms [m]."""
    force: NDArray[np.complex128]
    """Terms of the friction force [N]."""
    scatter: NDArray[np.float64]
    """Variance of the measured terms [m²]."""
    is_clear: NDArray[np.bool_]
    """Whether a term stands out of it."""

    @classmethod
    def of(cls, measured: MeasuredMotion, force: NDArray[np.complex128]) -> "Harmonics":
        """Return the terms at which there is a force [N], shape (terms,)."""
        used = force != 0
        scatter = np.full(int(used.sum()), measured.variance)
        return cls(measured.omega[used], measured.terms[used], force[used], scatter, measured.is_clear[used])


class PlantAboveModes(NamedTuple):
    """A plant P = c(ω)/(jω)^r, with c at some frequencies, shape (n,)."""

    omega: NDArray[np.float64]
    """Ascending frequencies [rad/s]; above the last one c tends to a real constant."""
    gain: NDArray[np.complex128]
    """c [m/(N s^r)]."""
    errors: NDArray[np.float64]
    """Its relative error."""
    relative_degree: int
    """r; 0 if it is unknown, and the motion counts as none."""

    @classmethod
    def of_gain(cls, gain: float, relative_degree: int) -> "PlantAboveModes":
        """Return a plant of constant c that is no more than a guess."""
        return cls(np.zeros(1), np.array([gain + 0j]), np.ones(1), relative_degree)

    @property
    def limit(self) -> float:
        """C at frequencies far above the last one [m/(N s^r)]."""
        return float(self.gain[-1].real)

    def response(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return P(jω) [m/N], shape (n,), at ω > 0 [rad/s]."""
        if not self.relative_degree:
            return np.zeros(omega.size, dtype=complex)
        gain = np.interp(omega, self.omega, self.gain)
        turn = np.minimum(self.omega[-1] / omega, 1.0)  # c0 + c1/(jω) above the last one, as of masses and dampers
        return np.asarray((gain.real + 1j * gain.imag * turn) / (1j * omega) ** self.relative_degree)

    def error(self, omega: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return the relative error of P(jω), of the shape of ω [rad/s]; beyond the last one it grows by bandwidths."""
        away = np.log(np.maximum(omega, 1e-300) / self.omega[-1]) / BANDWIDTH if self.omega[-1] else 0.0
        return np.asarray(np.interp(omega, self.omega, self.errors, left=np.inf) * (1 + np.maximum(away, 0.0)))

    def likely_terms(self, omega: NDArray[np.float64], force: NDArray[np.complex128]) -> LikelyTerms:
        """Return what a friction force [N] makes likely of the motion, shape (n,), at ω [rad/s]."""
        likely, error = LikelyTerms.unknown(omega.size), self.error(omega)
        is_guess = not self.omega[-1]
        known = (force != 0) & (error < 1) & (not is_guess)  # else not even its sign is known
        likely.mean[known] = -force[known] * self.response(omega[known])
        likely.deviation[known] = error[known] * np.abs(likely.mean[known])
        return likely


def fit_above_modes(parts: Sequence[Harmonics], guess: PlantAboveModes) -> PlantAboveModes:
    """Return the plant from the harmonics of all motions; the guess if they do not show it.

    Weak harmonics count too, as much as their scatter allows: leaving them out would favour those that noise enlarged.
    """
    omega, motion, force, scatter, is_clear = map(np.concatenate, zip(*parts, strict=True))
    if is_clear.sum() < MIN_CLEAR_HARMONICS or not guess.relative_degree:
        return guess
    order = np.argsort(omega, kind="stable")
    omega, motion, force, scatter, is_clear = (each[order] for each in (omega, motion, force, scatter, is_clear))
    cause = -force / (1j * omega) ** guess.relative_degree
    place, clear = np.log(omega), np.log(omega[is_clear])
    grid = np.arange(clear.min(), clear.max(), BANDWIDTH / 6)
    begins, ends = (np.searchsorted(clear, grid + side * BANDWIDTH) for side in (-1, 1))
    grid = grid[ends - begins >= MIN_CLEAR_HARMONICS]
    if not grid.size:
        return guess
    begins, ends = (np.searchsorted(place, grid + side * BANDWIDTH) for side in (-1, 1))
    fits = [
        _fit_line((place[near] - middle) / BANDWIDTH, cause[near], motion[near], scatter[near])
        for middle, near in zip(grid, map(slice, begins, ends), strict=True)
    ]
    gain, error = map(np.array, zip(*fits, strict=True))
    gain = np.where(error < 1, gain, guess.gain[-1])
    return PlantAboveModes(np.exp(grid), gain, error, guess.relative_degree)


def _fit_line(
    away: NDArray[np.float64],
    cause: NDArray[np.complex128],
    motion: NDArray[np.complex128],
    scatter: NDArray[np.float64],
) -> tuple[complex, float]:
    """Return c in the middle of a window, by a line c0 + c1 x through terms at -1 < x < 1, and its relative error."""
    weight = (1 - np.abs(away) ** 3) ** 3 / (scatter + (LEAST_ERROR * np.abs(motion)) ** 2)
    power, product = weight * np.abs(cause) ** 2, weight * motion * cause.conj()
    zeroth, first, second = (np.sum(away**order * power) for order in range(3))
    direct, sloped = (np.sum(away**order * product) for order in range(2))
    determinant = zeroth * second - first**2
    gain, slope = (second * direct - first * sloped) / determinant, (zeroth * sloped - first * direct) / determinant
    found = (gain + slope * away) * cause
    excess = np.sum(weight * (np.abs(motion - found) ** 2 - scatter))
    size = np.sum(weight * np.abs(found) ** 2)
    return gain, float(np.sqrt(max(excess, 0.0) / size + second / determinant / np.abs(gain) ** 2))


def gain_above_modes(response: FrequencyResponse, relative_degree: int) -> float:
    """Return c of a plant that falls as c/(jω)^r [m/(N s^r)], from the highest frequencies of its response."""
    usable = np.isfinite(response.response) & (response.frequency > 0)
    frequency, values = response.frequency[usable], response.response[usable]
    upper = frequency >= frequency.max(initial=0.0) * np.exp(-BANDWIDTH)
    gains = np.real(values[upper] * (2j * np.pi * frequency[upper]) ** relative_degree)
    return float(np.median(gains)) if gains.size else 0.0
