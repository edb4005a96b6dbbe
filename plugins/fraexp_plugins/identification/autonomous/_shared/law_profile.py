"""The best shape of a law by all records, and how far its Coulomb force may be from the one there."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.autonomous._shared.law_elements import LawElements
from fraexp_plugins.identification.autonomous._shared.law_records import LawRecords

FIRST_CHANGE, MAX_CHANGE = 0.01, 0.08
"""Relative change of the Coulomb force that is tried first, and the one from which the interval is wide enough to be of
no use; each change is twice the one before."""
FIRST_TRIALS, MAX_TRIALS, TOLERANCE = 10, 6, 1e-3
"""Steps of the shape at most, to the best one and at each change from there, and relative change of the sum of squares
at which they end."""
SHAPE_STEP, MAX_SHIFT, DIFFERENCE = 0.1, 7.0, 1e-4
"""Scale of a step of a logarithm, its distance from where it began at most, and its difference for derivatives."""
DEAD_TIME_RANGE = 1.0
"""Distance of the dead time from where it began at most [samples]."""


class LawProfile:
    """The least sum of squares that a law leaves of all records, by its Coulomb force.

    At each force dead time, shape and sizes are found anew: derivatives at the best shape do not show how far the force
    may go, as friction that weakens slowly is Coulomb friction of another size, with a shape far away.
    """

    def __init__(self, elements: LawElements, dead_time: float, records: LawRecords) -> None:
        self._records, self._law = records, elements
        self._sample_time = records.signals.segments[0].sample_time
        self._known: tuple[bytes, NDArray[np.complex128]] = (b"", np.empty(0, dtype=complex))
        self._start = np.array([dead_time / self._sample_time, *elements.shape])
        self._least, self._best = self._minimised(None, self._start)

    @property
    def elements(self) -> LawElements:
        """The law of the best shape."""
        return replace(self._law, shape=self._best[1:])

    @property
    def dead_time(self) -> float:
        """The dead time that goes with it [s]."""
        return float(self._best[0]) * self._sample_time

    def interval(self, stds: float) -> tuple[float, float]:
        """Return the least and greatest Coulomb force [N] by some standard deviations, by what the best shape leaves.

        Beyond `MAX_CHANGE` an end is not looked for.
        """
        sizes = self._records.solve(self._deflection(self._best), self.dead_time).sizes
        force, rise = float(sizes[self._law.is_coulomb].sum()), stds**2 * self._least / self._records.equations
        return self._end(force, -1.0, rise), self._end(force, 1.0, rise)

    def _end(self, force: float, sign: float, rise: float) -> float:
        """Return the end of the interval on one side [N], by the root of the rise, which is linear near the best."""
        change, before, values = FIRST_CHANGE, (0.0, 0.0), self._best
        while True:
            cost, values = self._minimised(force * (1 + sign * change), values)
            size = float(np.sqrt(max(cost - self._least, 0.0) / rise))
            if size >= 1:
                part = (1 - before[1]) / (size - before[1])
                return force * (1 + sign * (before[0] + part * (change - before[0])))
            if change >= MAX_CHANGE:
                return force * (1 + sign * change)
            before, change = (change, size), 2 * change

    def _minimised(self, force: float | None, start: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Return the least sum of squares, with a Coulomb force [N] if given; dead time [samples] and shape there."""
        from scipy.optimize import least_squares  # slow to import: only when something is estimated

        low, high = self._start - MAX_SHIFT, self._start + MAX_SHIFT
        low[0], high[0] = max(self._start[0] - DEAD_TIME_RANGE, -1e-9), self._start[0] + DEAD_TIME_RANGE
        trials = FIRST_TRIALS if force is None else MAX_TRIALS
        found = least_squares(
            lambda values: self._residual(values, force), np.clip(start, low, high), bounds=(low, high),
            x_scale=SHAPE_STEP, diff_step=DIFFERENCE, max_nfev=trials, ftol=TOLERANCE,
        )  # fmt: skip
        return 2 * float(found.cost), np.asarray(found.x)

    def _residual(self, values: NDArray[np.float64], force: float | None) -> NDArray[np.float64]:
        held = None if force is None else (self._law.is_coulomb, force)
        return self._records.solve(self._deflection(values), values[0] * self._sample_time, held).residual

    def _deflection(self, values: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the forces of a shape; those of the last one are kept, as the dead time has no effect on them."""
        key = values[1:].tobytes()
        if self._known[0] != key:
            self._known = key, self._records.deflection(replace(self._law, shape=values[1:]))
        return self._known[1]
