"""Levenberg and Marquardt's method for parameters that move in their own way."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Place = TypeVar("Place")

INITIAL_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-3, 1e-15, 1e12
"""Damping relative to the columns; above the maximum no step is short enough to be better."""
COST_TOLERANCE = 1e-7
"""Relative change of the cost that counts as none: of n residuals noise alone leaves about 1/n undecided."""
COST_ROUNDING = 1e-28
"""Cost, relative to the initial one, that is rounding."""
STEPS_WITHOUT_CHANGE = 3
"""Successive steps without a change after which the search ends."""


@dataclass(frozen=True)
class IterationStep(Generic[Place]):
    """A place of the search, with its residuals and, where the search goes on from here, their gradient."""

    place: Place
    residual: NDArray[np.float64]
    """Measured less model, shape (n,)."""
    find_gradient: Callable[[], NDArray[np.float64]]
    """Returns the gradient; a trial that is rejected needs none."""

    @cached_property
    def gradient(self) -> NDArray[np.float64]:
        """Derivative of the model by the parameters, shape (n, p)."""
        return self.find_gradient()

    @property
    def cost(self) -> float:
        """Sum of the squared residuals; infinite if one is not a number."""
        total = float(np.add.reduce(self.residual**2))
        return total if np.isfinite(total) else np.inf


class Minimum(NamedTuple, Generic[Place]):
    """Where a search ended."""

    place: Place
    iterations: int
    """Steps taken; the maximum if it has not converged."""


def minimise(
    step_of: Callable[[Place], IterationStep[Place]],
    move: Callable[[Place, NDArray[np.float64]], Place],
    begin: Place,
    max_iterations: int,
) -> Minimum[Place]:
    """Return the place of least squared residuals near `begin`.

    D. W. Marquardt, J. SIAM 11(2), 1963, doi:10.1137/0111030. scipy.optimize.least_squares has vector parameters
    within constant bounds and evaluates residuals and Jacobian apart; here `move` projects each step with a state of
    its own, and a noisy cost that stops falling ends the search.
    """
    now = step_of(begin)
    initial_cost, damping, unchanged = now.cost, INITIAL_DAMPING, 0
    for count in range(max_iterations):
        trial = step_of(move(now.place, _damped_step(now, damping)))
        gain = now.cost - trial.cost
        if gain > 0:
            unchanged = unchanged + 1 if gain <= COST_TOLERANCE * now.cost else 0
            now, damping = trial, max(damping / 5, MIN_DAMPING)
        else:
            damping *= 3
        ended = unchanged >= STEPS_WITHOUT_CHANGE or damping > MAX_DAMPING
        if ended or now.cost <= COST_ROUNDING * initial_cost:
            return Minimum(now.place, count)
    return Minimum(now.place, max_iterations)


def _damped_step(now: IterationStep[Place], damping: float) -> NDArray[np.float64]:
    """Return the step by damped least squares, with damping on the scale of the columns, shape (p,)."""
    count = now.gradient.shape[1]
    small = np.asarray(np.linalg.qr(np.column_stack([now.gradient, now.residual]), mode="r"))
    columns, goal = small[:, :count], small[:, count]
    scale = np.sqrt(np.add.reduce(columns**2, axis=0))
    scale[scale == 0] = 1.0
    padded = np.concatenate([columns / scale, np.sqrt(damping) * np.eye(count)])
    step: NDArray[np.float64] = np.linalg.lstsq(padded, np.concatenate([goal, np.zeros(count)]), rcond=None)[0]
    return step / scale
