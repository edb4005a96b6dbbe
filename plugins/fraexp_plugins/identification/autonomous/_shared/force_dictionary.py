"""A dictionary of friction forces, from which those that a machine has are chosen whatever its law is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification._shared.stop_operator import reversals, stop_operators

STOPS, BRISTLES, PEAKS = 160, 60, 14
"""Number of stop operators, of Dahl bristles and of Stribeck peaks."""
RATE_STEP = 5
"""Every fifth stop operator has a damper beside it."""
RATE_TIME_S = 1e-3
"""Time that makes a force of a damper's rate: it only sets the size of a column."""
WIDTH_SPAN = 1e5
"""Ratio of the largest motion to the smallest width."""
MAX_STOP_RATIO, MAX_BRISTLE_RATIO = 0.5, 0.1
"""Largest widths over the largest motion: what hardly slips acts as a spring."""
PEAK_RANGE = (3e-4, 0.05)
"""Stribeck velocities over the largest velocity; wider peaks are a part of the Coulomb force."""


@dataclass(frozen=True)
class ForceDictionary:
    """Friction forces that act side by side, each driven by the motion alone, and of unknown size.

    Stop operators are rolling elements; bristles are Dahl's law; a damper acts on the rate of a stop operator, as D_i
    and σ1 do; a Stribeck peak acts near standstill. Together they make any of the laws that fraexp has, or come near.
    """

    stops: NDArray[np.float64]
    """Thresholds of stop operators [m], ascending, shape (S,)."""
    bristles: NDArray[np.float64]
    """Widths F/σ of Dahl bristles [m], ascending, shape (B,)."""
    peaks: NDArray[np.float64]
    """Stribeck velocities [m/s], ascending, shape (P,)."""

    @classmethod
    def spanning(cls, smallest: float, largest: float, velocity: float) -> "ForceDictionary":
        """Return the dictionary for motions from a smallest to a largest amplitude [m], up to a velocity [m/s]."""
        low = max(smallest / 2, largest / WIDTH_SPAN)
        return cls(
            np.geomspace(low, MAX_STOP_RATIO * largest, STOPS),
            np.geomspace(low, MAX_BRISTLE_RATIO * largest, BRISTLES),
            velocity * np.geomspace(*PEAK_RANGE, PEAKS),
        )

    @property
    def widths(self) -> NDArray[np.float64]:
        """Factor [m] that makes a coefficient [N/m] of each column a force, shape (N,)."""
        dampers = self.stops[::RATE_STEP]
        return np.concatenate([self.stops, self.bristles, dampers, np.ones(self.peaks.size)])

    @property
    def parts(self) -> tuple[slice, slice, slice, slice]:
        """Places of stop operators, bristles, dampers and peaks among the columns."""
        sizes = self.stops.size, self.bristles.size, self.stops[::RATE_STEP].size, self.peaks.size
        ends = np.cumsum(sizes).tolist()
        first, second, third, fourth = (slice(end - size, end) for size, end in zip(sizes, ends, strict=True))
        return first, second, third, fourth

    @property
    def is_coulomb(self) -> NDArray[np.bool_]:
        """Which columns keep their force in gross sliding, shape (N,)."""
        stops, bristles, dampers, peaks = (part.stop - part.start for part in self.parts)
        return np.arange(stops + bristles + dampers + peaks) < stops + bristles

    def columns(self, motion: NDArray[np.float64], time_step: float) -> NDArray[np.float64]:
        """Return each force over its coefficient [m] along a period of motion [m], shape (n, N)."""
        twice, size = np.concatenate([motion, motion]), motion.size  # the state at the start has no effect then
        deflection = stop_operators(twice, self.stops)
        rate = np.gradient(deflection[:, ::RATE_STEP], axis=0)[size:] / time_step
        velocity = (np.roll(motion, -1) - np.roll(motion, 1)) / (2 * time_step)
        peaks = np.sign(velocity)[:, None] * np.exp(-((velocity[:, None] / self.peaks) ** 2))
        bristles = dahl_bristles(twice, self.bristles)[size:] * self.bristles
        return np.concatenate([deflection[size:], bristles, RATE_TIME_S * rate, peaks], axis=1)

    def virgin_force(self, force: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force [N] of a first slow displacement x [m], shape (n,), for a force of each column [N]."""
        return self.virgin_columns(x) @ force

    def virgin_columns(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how much of each column's force acts after a first slow displacement x [m], shape (n, N)."""
        found = np.zeros((x.size, self.is_coulomb.size))
        stops, bristles, _, _ = self.parts
        found[:, stops] = np.minimum(x[:, None] / self.stops, 1.0)
        found[:, bristles] = -np.expm1(-x[:, None] / self.bristles)
        return found


def dahl_bristles(displacement: NDArray[np.float64], widths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the relative forces of Dahl bristles of widths F/σ [m], shape (n, N), along a displacement from rest.

    Between reversals z = s + (z_r - s) exp(-|y - y_r|/w), with s the direction: exact, all samples at once.
    """
    force = np.empty((displacement.size, widths.size))
    state = np.zeros(widths.size)
    force[0] = state
    ends = reversals(displacement)
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        moved = displacement[begin + 1 : end + 1] - displacement[begin]
        direction = np.sign(moved[-1])
        force[begin + 1 : end + 1] = direction + (state - direction) * np.exp(-np.abs(moved)[:, None] / widths)
        state = force[end]
    return force
