"""The dead time and the shape of a law that leave least of some records; sizes are eliminated."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification._shared.least_squares import minimise
from fraexp_plugins.identification.autonomous._law_columns import LawColumns
from fraexp_plugins.identification.autonomous._line_records import LawSolution, LineRecords

SHAPE_STEP, DIFFERENCE = 0.1, 1e-4
"""Scale of a step of a logarithm, and its difference for derivatives."""
MAX_SHIFT, MAX_DEAD_TIME = 7.0, 8.0
"""Distance of a logarithm from its start at most, and the largest dead time [samples]."""
MAX_TRIALS, TOLERANCE = 40, 1e-4
"""Steps of a search at most, and relative change of the sum of squares at which it ends."""


class LawSearch:
    """What a law leaves of some records, by values: the dead time [samples], and the coordinates of its shape.

    `law_at_start` is the law at which the search begins.
    """

    def __init__(self, records: LineRecords, law: LawColumns, is_delayed: bool) -> None:
        self.records, self.law_at_start, self._is_delayed = records, law, is_delayed

    def values(self, law: LawColumns, dead_time: float) -> NDArray[np.float64]:
        """Return the values of a law of this family, and a dead time [s]."""
        return np.array([dead_time / self.records.sample_time, *law.shape])

    def law(self, values: NDArray[np.float64]) -> LawColumns:
        """Return the law of these values."""
        return replace(self.law_at_start, shape=values[1:])

    def dead_time(self, values: NDArray[np.float64]) -> float:
        """Return the dead time [s]."""
        return max(float(values[0]), 0.0) * self.records.sample_time

    def solve(self, values: NDArray[np.float64], held: float | None = None) -> LawSolution:
        """Return the sizes and residuals; with `held` the Coulomb force is that [N]."""
        law = self.law(values)
        return self.records.solve(law, self.records.deflection(law), self.dead_time(values), held)

    def cost(self, values: NDArray[np.float64], held: float | None = None) -> float:
        """Return the sum of squares."""
        return float(np.sum(self.solve(values, held).residual ** 2))

    def robust_cost(self, values: NDArray[np.float64]) -> float:
        """Return what no record decides alone."""
        return float(np.sum(np.log1p(self.solve(values).residual ** 2)))

    def minimised(
        self, start: NDArray[np.float64], held: float | None = None, trials: int = MAX_TRIALS, is_robust: bool = False
    ) -> NDArray[np.float64]:
        """Return the values that leave least, from a start on; a linear law keeps its shape."""
        is_free = np.arange(start.size) >= 1 - self._is_delayed
        is_free[1:] &= not self.law_at_start.is_linear
        if not is_free.any():
            return start

        def complete(free: NDArray[np.float64]) -> NDArray[np.float64]:
            values = start.copy()
            values[is_free] = free
            return values

        low, high = start - MAX_SHIFT, start + MAX_SHIFT
        low[0], high[0] = -1e-9, MAX_DEAD_TIME
        found, _ = minimise(
            lambda free: self.solve(complete(free), held).residual,
            start[is_free],
            (low[is_free], high[is_free]),
            trials,
            x_scale=SHAPE_STEP,
            diff_step=DIFFERENCE,
            ftol=TOLERANCE,
            gtol=TOLERANCE**2,
            loss="soft_l1" if is_robust else "linear",
        )
        return complete(found)
