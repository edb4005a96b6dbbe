"""One period of an excitation, how it is started, settled and recorded, and the feedforward of a motion."""

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from fraexp.components.kinds import FrictionModel

RELATIVE_REST = 1e-12
"""Difference from its last value, relative to the greatest value, at which a table has come to rest."""


@dataclass(frozen=True)
class Feedforward:
    """A move of 1 m, which is scaled by the distance, and the friction that is compensated along it."""

    thrust: NDArray[np.float64]
    """Thrust at each sample [N/m], shape (n,); the last one holds the machine at the target."""
    reference: NDArray[np.float64]
    """Position that is measured at each sample [m/m], delayed as the machine delays it, shape (n,)."""
    displacement: NDArray[np.float64]
    """Displacement at the points of all samples and at the end [m/m], shape (n · points + 1,)."""
    points: int
    """Points per sample."""
    friction: "FrictionModel | None"
    """Friction that is compensated along the displacement."""
    max_distance: float | None = None
    """Distance [m] beyond which the thrust would exceed its limit; None without a limit."""

    def without_rest(self) -> "Feedforward":
        """Return the feedforward up to the sample at which all is at rest."""
        moved = self.displacement[:-1].reshape(-1, self.points)
        rests = [
            np.abs(table - last).max(axis=1) <= RELATIVE_REST * np.abs(table).max()
            for table, last in (
                (self.thrust[:, None], self.thrust[-1]),
                (self.reference[:, None], self.reference[-1]),
                (moved, self.displacement[-1]),
            )
        ]
        moving = np.flatnonzero(~np.logical_and.reduce(rests))
        samples = min(int(moving[-1]) + 2, self.thrust.size) if moving.size else 1
        return Feedforward(
            self.thrust[:samples],
            self.reference[:samples],
            self.displacement[: samples * self.points + 1],
            self.points,
            self.friction,
            self.max_distance,
        )


@dataclass(frozen=True)
class Period:
    """One period of an excitation, and the harmonics of it that it excites."""

    waveform: NDArray[np.float64]
    """Samples [N or m], shape (n,)."""
    lines: NDArray[np.int64]
    """Excited harmonics of the period, ascending, shape (lines,)."""
    reference: NDArray[np.float64] | None = None
    """Motion of the position reference around that of the loop [m], shape (n,); None if it rests."""
    recorded_periods: int = 0
    """Minimum number of times that it is recorded; 0 for the number of the schedule."""


@dataclass(frozen=True)
class Schedule:
    """How a periodic experiment is started, settled and recorded."""

    ramp: float = 0.0
    """Time over which the amplitude rises [s]."""
    settling_tolerance: float = 1e-6
    """Relative difference of successive periods at which the response counts as periodic."""
    settling_timeout: float = 60.0
    """Time after which settling is given up [s]; 0 to record from the start."""
    recorded_periods: int = 1
    """Minimum number of periods recorded once settled."""
    min_record_time: float = 0.0
    """Minimum time recorded once settled [s]."""

    def period_count(self, period: Period, sample_time: float) -> int:
        """Return how often a period is recorded that is sampled at `sample_time` [s]."""
        shortest = ceil(self.min_record_time / (period.waveform.size * sample_time))
        return max(period.recorded_periods or self.recorded_periods, shortest, 1)
