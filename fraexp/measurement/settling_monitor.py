"""Whether a machine that is played on has become periodic: the rule of the simulated loop, on recorded samples."""

import numpy as np
from numpy.typing import NDArray

from fraexp.simulation.experiments import ExperimentPlan

MAX_DECAY_RATIO = 0.98
"""Greatest ratio of successive differences that the extrapolation uses: a slower decay looks like noise."""
MAX_DRIFT = 0.03
"""Change of the mean position between windows, over the motion, that is no lack of a steady state where it may drift: a
feedback without integral action holds an axis with friction by a weak spring, and takes many seconds."""
MAX_PHASOR_STDS = 3.0
"""Difference of two windows' phasors, in standard deviations by encoder and noise, that is no drift."""


class SettlingMonitor:
    """Compares windows of the position as they become complete; `fraexp.kernels.settling` explains the rule."""

    def __init__(self, counts: ExperimentPlan, may_drift: bool = False) -> None:
        self._max_drift = MAX_DRIFT if may_drift else 0.0
        self._counts, self._windows, self._excess = counts, 0, np.inf
        lines = counts.experiment.period.lines
        self._cycles = int(lines[0]) if lines.size == 1 else 0
        self.residual = float("nan")
        """Relative difference of the last two windows."""
        self.noise = 0.0
        """Noise of the position [m] by which the last two windows differ; 0 if they differ smoothly, as motions do."""
        self.is_settled = counts.window == 0
        self.record_start: int | None = 0 if counts.window == 0 else None
        """First sample of the record; None while it is not known."""

    def look(self, position: NDArray[np.float64]) -> None:
        """Compare the windows that have become complete; `position` are all samples since rest [m], shape (n,)."""
        counts = self._counts
        while self.record_start is None:
            end = counts.ramp + (self._windows + 1) * counts.window
            if end > position.size:
                return
            self._windows += 1
            self.is_settled = self._windows >= 2 and self._has_settled(position[:end])
            if self.is_settled or end >= counts.settling_limit:
                self.record_start = end - counts.record if counts.record <= counts.window else end

    def _has_settled(self, position: NDArray[np.float64]) -> bool:
        counts = self._counts
        last, before = position[-counts.window :], position[-2 * counts.window : -counts.window]
        difference, motion = last - before, float(np.std(last))
        if abs(np.mean(difference)) <= self._max_drift * motion:
            difference = difference - np.mean(difference)
        change = float(np.sqrt(np.mean(difference**2)))
        is_noise = np.mean(np.diff(difference) ** 2) > change**2  # twice as much if white, next to nothing of a motion
        self.noise = change / np.sqrt(2) if is_noise else 0.0
        if motion == 0.0:
            return change == 0.0
        self.residual = change / motion
        previous, self._excess = self._excess, max(change - counts.noise_floor, 0.0) / motion
        if sum_to_come(self._excess, previous) > counts.experiment.schedule.settling_tolerance:
            return False
        return counts.noise_floor == 0.0 or self._cycles == 0 or not self._drifts(position)

    def _drifts(self, position: NDArray[np.float64]) -> bool:
        """Return whether the phasor goes on changing, too slowly for successive windows to show it."""
        counts, lag = self._counts, (self._windows - 1) // 2
        if lag == 0:
            return False
        last, middle, first = (self._phasor(position, k * lag * counts.window) for k in range(3))
        explained = MAX_PHASOR_STDS * counts.noise_floor * np.sqrt(2.0 / counts.window)
        difference, before = max(abs(last - middle) - explained, 0.0), abs(middle - first)
        return sum_to_come(difference, before) > counts.experiment.schedule.settling_tolerance * abs(last)

    def _phasor(self, position: NDArray[np.float64], back: int) -> complex:
        """Return the phasor [m] over the window that ends `back` samples before the last one."""
        counts, end = self._counts, position.size - back
        window = position[end - counts.window : end]
        angle = -2j * np.pi * self._cycles / counts.experiment.period.waveform.size
        return complex(2.0 / counts.window * (window @ np.exp(angle * np.arange(counts.window))))


def sum_to_come(difference: float, before: float) -> float:
    """Return the sum of all differences to come, as a geometric series from the last two; at least the last one."""
    ratio = min(difference / before, MAX_DECAY_RATIO) if before > 0.0 else 0.0
    return difference * max(1.0, ratio / (1.0 - ratio))
