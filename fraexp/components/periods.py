"""One period of an excitation, and how it is started, settled and recorded."""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray


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
