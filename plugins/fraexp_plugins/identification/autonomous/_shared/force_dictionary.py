"""A dictionary of friction forces, from which those that a machine has are chosen whatever its law is."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Motion
from fraexp_plugins.identification._shared.stop_operator import reversals, stop_operators
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import history

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
"""Stribeck velocities of peaks over the largest velocity."""
WEAKENING_STEP, WEAKENING_VELOCITIES, WEAKENING_RANGE = 20, 6, (0.03, 1.0)
"""Every twentieth stop operator has a part that weakens in sliding; number of its Stribeck velocities, and their range
over the largest velocity: what weakens at higher ones only is a part of the Coulomb force."""
WEAKENING_LAG_S = 0.05
"""Time in which a sliding element follows its Stribeck curve, where it does not at once."""


@dataclass(frozen=True)
class ForceDictionary:
    """Friction forces that act side by side, each driven by the motion alone, and of unknown size.

    Stop operators are rolling elements; bristles are Dahl's law; a damper acts on the rate of a stop operator, as D_i
    and σ1 do; a Stribeck peak acts near standstill. A stop operator that weakens is the part of its force that is lost
    with the velocity of sliding: in first order of δ, what the threshold Y + δ exp(-(v/v_s)²) adds, at once or with a
    lag, and what it keeps while it sticks. Elements of the generalized Maxwell slip model weaken like that (F.
    Al-Bender, V. Lampaert and J. Swevers, IEEE Trans. Automatic Control 50(11), 2005, doi 10.1109/TAC.2005.858676);
    without these forces their Stribeck force would be taken for Coulomb force. Together the forces make any of the
    laws that fraexp has, or come near.
    """

    stops: NDArray[np.float64]
    """Thresholds of stop operators [m], ascending, shape (S,)."""
    bristles: NDArray[np.float64]
    """Widths F/σ of Dahl bristles [m], ascending, shape (B,)."""
    peaks: NDArray[np.float64]
    """Stribeck velocities [m/s], ascending, shape (P,)."""
    weakening: NDArray[np.float64]
    """Stribeck velocities of stop operators that weaken [m/s], ascending, shape (V,)."""

    @classmethod
    def spanning(cls, smallest: float, largest: float, velocity: float) -> "ForceDictionary":
        """Return the dictionary for motions from a smallest to a largest amplitude [m], up to a velocity [m/s]."""
        low = max(smallest / 2, largest / WIDTH_SPAN)
        return cls(
            np.geomspace(low, MAX_STOP_RATIO * largest, STOPS),
            np.geomspace(low, MAX_BRISTLE_RATIO * largest, BRISTLES),
            velocity * np.geomspace(*PEAK_RANGE, PEAKS),
            velocity * np.geomspace(*WEAKENING_RANGE, WEAKENING_VELOCITIES),
        )

    @property
    def widths(self) -> NDArray[np.float64]:
        """Factor [m] that makes a coefficient [N/m] of each column a force, shape (N,)."""
        dampers = self.stops[::RATE_STEP]
        weakening = np.repeat(self.stops[::WEAKENING_STEP], 2 * self.weakening.size)
        return np.concatenate([self.stops, self.bristles, dampers, np.ones(self.peaks.size), weakening])

    @property
    def parts(self) -> tuple[slice, slice, slice, slice]:
        """Places of stop operators, bristles, dampers and of what weakens among the columns."""
        sizes = self.stops.size, self.bristles.size, self.stops[::RATE_STEP].size
        first, second, third = np.cumsum(sizes).tolist()
        return slice(0, first), slice(first, second), slice(second, third), slice(third, self.widths.size)

    @property
    def is_coulomb(self) -> NDArray[np.bool_]:
        """Which columns keep their force in gross sliding, shape (N,)."""
        return np.arange(self.widths.size) < self.stops.size + self.bristles.size

    def columns(self, motion: Motion) -> NDArray[np.float64]:
        """Return each force over its coefficient [m] along a period of motion, shape (n, N)."""
        y, size, time_step = history(motion), motion.displacement.size, motion.time_step  # the start has no effect then
        deflection = stop_operators(y, self.stops)
        rate = np.gradient(deflection[:, ::RATE_STEP], axis=0)[-size:] / time_step
        velocity = np.gradient(y) / time_step
        sliding = velocity[-size:, None]
        peaks = np.sign(sliding) * np.exp(-((sliding / self.peaks) ** 2))
        bristles = dahl_bristles(y, self.bristles)[-size:] * self.bristles
        widths = self.stops[::WEAKENING_STEP]
        slip = np.where(np.abs(deflection) >= self.stops, np.sign(deflection), 0.0)[:, ::WEAKENING_STEP]
        share = np.exp(-((velocity[:, None] / self.weakening) ** 2))
        weakening = weakening_forces(slip, share, float(np.exp(-time_step / WEAKENING_LAG_S)))[-size:]
        weakening = (widths[:, None] * weakening.reshape(size, widths.size, -1)).reshape(size, -1)
        return np.concatenate([deflection[-size:], bristles, RATE_TIME_S * rate, peaks, weakening], axis=1)

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


def weakening_forces(slip: NDArray[np.float64], share: NDArray[np.float64], decay: float) -> NDArray[np.float64]:
    """Return the relative forces of elements that weaken in sliding, shape (n, N, 2, V): without a lag, and with one.

    `slip` is the direction in which each element slides, 0 while it sticks, shape (n, N), and `share` the Stribeck
    curve along the motion, shape (n, V). An element begins to slide with the share of that sample; with a lag the
    difference then falls by `decay` in each sample. It keeps its force while it sticks.
    """
    from scipy.signal import lfilter  # slow to import: only when something is estimated

    found = np.zeros((*slip.shape, 2, share.shape[1]))
    for place, direction in enumerate(slip.T):
        changes = (np.flatnonzero(np.diff(direction)) + 1).tolist()
        for begin, end in pairwise([0, *changes, len(direction)]):
            run = found[begin:end, place]
            if direction[begin]:
                start = decay * share[begin : begin + 1]
                run[:, 0] = direction[begin] * share[begin:end]
                run[:, 1] = direction[begin] * lfilter([1 - decay], [1, -decay], share[begin:end], axis=0, zi=start)[0]
            elif begin:
                run[:] = found[begin - 1, place]
    return found
