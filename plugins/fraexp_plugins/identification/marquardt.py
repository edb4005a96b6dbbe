"""Levenberg and Marquardt's method on an object that knows how to move."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

T = TypeVar("T")

FIRST = 1e-3
"""First damping, relative to the columns."""
LEAST, MOST = 1e-15, 1e12
"""Damping at least, and at most: there no step is short enough to be better."""
SETTLED = 1e-7
"""Relative change of the squared error that is none: of n residuals, noise alone leaves some 1/n undecided."""
ROUNDING = 1e-28
"""Squared error, relative to the first, that is rounding."""
PATIENCE = 3
"""Steps in a row that must change nothing."""


@dataclass(frozen=True)
class IterationStep(Generic[T]):
    """A place of the search: residuals, and how the model that makes them off moves with the parameters."""

    place: T
    residual: np.ndarray
    """Measured less model, shape (n,)."""
    gradient: np.ndarray
    """Derivative of the model by the parameters, shape (n, p)."""

    @property
    def cost(self) -> float:
        """Sum of the squared residuals; infinite where one is no number."""
        total = float(np.add.reduce(self.residual**2))
        return total if np.isfinite(total) else np.inf


def minimised(
    step_of: Callable[[T], IterationStep[T]], moved: Callable[[T, np.ndarray], T], begin: T, iterations: int
) -> tuple[T, int]:
    """Return the place of least squared residuals near `begin`, and the steps taken; `iterations` if it was not found.

    D. W. Marquardt, J. SIAM 11(2), 1963, doi:10.1137/0111030.
    """
    now = step_of(begin)
    first, damping, still = now.cost, FIRST, 0
    for count in range(iterations):
        trial = step_of(moved(now.place, _solved(now, damping)))
        gain = now.cost - trial.cost
        if gain > 0:
            still = still + 1 if gain <= SETTLED * now.cost else 0
            now, damping = trial, max(damping / 5, LEAST)
        else:
            damping *= 3
        if still >= PATIENCE or damping > MOST or now.cost <= ROUNDING * first:
            return now.place, count
    return now.place, iterations


def _solved(now: IterationStep[T], damping: float) -> np.ndarray:
    """Return the step: least squares with the columns' own scale as damping, by orthogonal transformations."""
    count = now.gradient.shape[1]
    small = np.asarray(np.linalg.qr(np.column_stack([now.gradient, now.residual]), mode="r"))
    columns, goal = small[:, :count], small[:, count]
    scale = np.sqrt(np.add.reduce(columns**2, axis=0))
    scale[scale == 0] = 1.0
    padded = np.concatenate([columns / scale, np.sqrt(damping) * np.eye(count)])
    found: np.ndarray = np.linalg.lstsq(padded, np.concatenate([goal, np.zeros(count)]), rcond=None)[0]
    return found / scale
