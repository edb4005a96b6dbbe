"""Deadbeat feedforward: the smoothest thrust that takes a model from rest to rest in a chosen number of samples."""

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError

MAX_BOUNDED_SAMPLES = 2000
"""Samples of a move whose bounds bind: that program is dense."""
MAX_CONDITION = 1e13
"""Condition number of the states' equations up to which one thrust controls all of them."""
INFEASIBLE_RESIDUAL = 1e-7
"""Residual of the dual problem, relative to 1, below which no thrust keeps its bounds."""
BOUND_TOLERANCE = 1e-9
"""Relative distance at which a bound counts as kept."""


@dataclass(frozen=True)
class DeadbeatProgram:
    """The least |Δ^order u|² of u over N samples with W u = goal, u = 0 before and `rest` after it.

    W holds the columns A^(N-1) b … b of the n states that must come to rest. All such u, and they alone, are D(z) v of
    the coprime factors N(z)/D(z) of the model: u = D v and y = N v for one finite v, whose increments sum to
    (distance)/N(1).
    """

    directions: NDArray[np.float64]
    """Orthonormal directions in which u changes the final state, shape (N, n)."""
    goal: NDArray[np.float64]
    """Component of u along each of them [N], shape (n,)."""
    order: int
    """Order of the differences."""
    difference_targets: NDArray[np.float64]
    """Target of the differences of u, so that u begins at 0 and continues as `rest` [N], shape (N + order,)."""

    @classmethod
    def from_model(
        cls,
        transition: NDArray[np.float64],
        hold_response: NDArray[np.float64],
        goal: NDArray[np.float64],
        rest: float,
        samples: int,
        order: int,
    ) -> "DeadbeatProgram":
        """Return the program of a sampled model x' = A x + b u.

        Args:
            transition: A, shape (n, n).
            hold_response: b, the response to a thrust held over one sample, shape (n,).
            goal: State to be reached, shape (n,).
            rest: Thrust that follows the move [N].
            samples: Samples N of the move.
            order: Order of the differences of u that are made small.

        Raises
        ------
            ParameterError: If one thrust cannot bring all states to rest.
        """
        reach = np.empty((goal.size, samples))
        column = hold_response
        for k in range(samples - 1, -1, -1):
            reach[:, k] = column
            column = transition @ column
        scale = 1 / np.maximum(np.abs(reach).max(axis=1), np.finfo(float).tiny)
        directions, triangle = np.linalg.qr((scale[:, None] * reach).T)
        if np.linalg.cond(triangle) > MAX_CONDITION:
            raise ParameterError(
                f"the design model's {goal.size} states cannot be brought to rest by one thrust in {samples} samples: "
                "expected modes of different frequencies, or a longer duration"
            )
        return cls(
            directions, np.linalg.solve(triangle.T, scale * goal), order, _target_differences(rest, samples, order)
        )

    def solve(
        self, lower: NDArray[np.float64] | None = None, upper: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64] | None:
        """Return the best u [N], shape (N,), within its bounds [N], each of shape (N,); None if there is none."""
        u = self._smoothest
        if lower is None or upper is None or _keeps_bounds(u, lower, upper):
            return u
        if u.size == self.goal.size:
            return None
        if u.size > MAX_BOUNDED_SAMPLES:
            raise ParameterError(
                f"a move of {u.size:,} samples cannot be planned for a force_limit that binds; expected "
                f"{MAX_BOUNDED_SAMPLES:,} or fewer: raise force_limit, or make several moves"
            )
        both_bounds = np.concatenate([lower - u, u - upper])
        step = _solve_least_distance(np.vstack([self._free_directions, -self._free_directions]), both_bounds)
        return None if step is None else self._projected(u + self._free_directions @ step)

    @cached_property
    def _smoothest(self) -> NDArray[np.float64]:
        """The best u without bounds [N], shape (N,): by its multipliers, as the matrix of the cost is a narrow band."""
        from scipy.linalg import solveh_banded  # scipy: imported only where something is designed

        binomials = _binomials(self.order)
        band = np.zeros((self.order + 1, self.directions.shape[0]))
        for k in range(self.order + 1):
            band[self.order - k, k:] = np.dot(binomials[: binomials.size - k], binomials[k:])
        linear = np.correlate(self.difference_targets, binomials, "valid")
        solutions = solveh_banded(band, np.column_stack([linear, self.directions]))
        free, responses = solutions[:, 0], solutions[:, 1:]
        multipliers = np.linalg.solve(self.directions.T @ responses, self.goal - self.directions.T @ free)
        return self._projected(free + responses @ multipliers)

    @cached_property
    def _free_directions(self) -> NDArray[np.float64]:
        """Directions that keep the final state, shape (N, N - n); along them the cost rises by the distance squared."""
        n = self.goal.size
        null = np.linalg.qr(self.directions, mode="complete")[0][:, n:]
        differences = np.diff(np.pad(null, ((self.order, self.order), (0, 0))), self.order, axis=0)
        triangle = np.linalg.qr(differences).R
        return np.linalg.solve(triangle.T, null.T).T

    def _projected(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the nearest u that leads to the goal: it removes the error of rounding."""
        return u + self.directions @ (self.goal - self.directions.T @ u)


def _binomials(order: int) -> NDArray[np.float64]:
    """Return the coefficients of a difference, from the newest sample on."""
    return np.array([(-1.0) ** shift * comb(order, shift) for shift in range(order + 1)])


def _target_differences(rest: float, samples: int, order: int) -> NDArray[np.float64]:
    """Return what the differences of u are compared with, shape (samples + order,): `rest` follows u."""
    return np.concatenate([np.zeros(samples), -rest * np.cumsum(_binomials(order))[:order]])


def _keeps_bounds(u: NDArray[np.float64], lower: NDArray[np.float64], upper: NDArray[np.float64]) -> bool:
    slack = BOUND_TOLERANCE * float(np.abs(u).max())
    return bool((u >= lower - slack).all() and (u <= upper + slack).all())


def _solve_least_distance(matrix: NDArray[np.float64], bound: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the shortest x with matrix x >= bound, or None if there is none.

    Least distance programming by non-negative least squares (C. L. Lawson and R. J. Hanson, Solving Least Squares
    Problems, 1974, section 23.4).
    """
    from scipy.optimize import nnls  # scipy: imported only where something is designed

    scale = float(np.abs(bound).max())
    system = np.vstack([matrix.T, bound / scale])
    unit = np.zeros(system.shape[0])
    unit[-1] = 1.0
    try:
        multipliers, distance = nnls(system, unit, maxiter=20 * system.shape[1])
    except RuntimeError:  # the solver did not converge: whether an x exists is unknown
        return None
    if distance < INFEASIBLE_RESIDUAL:
        return None
    residual = system @ multipliers - unit
    return -scale * residual[:-1] / residual[-1]
