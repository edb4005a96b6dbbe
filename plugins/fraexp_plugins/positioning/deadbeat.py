"""Deadbeat feedforward: the smoothest thrust that takes a model from rest to rest in a chosen number of samples."""

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from fraexp.api import ParameterError

MOST_BOUND = 2000
"""Samples of a move at most where bounds bind: that program is dense."""
MOST_SKEWED = 1e13
"""Condition of the states' equations up to which one thrust can tell them apart."""
INFEASIBLE = 1e-7
"""Residual of the dual problem, relative to 1, at which no thrust keeps to its bounds."""
SAME = 1e-9
"""Relative distance at which a bound counts as kept."""


@dataclass(frozen=True)
class Program:
    """The least |Δ^order u|² of u over N samples with W u = goal, u = 0 before and `rest` after it.

    W holds the columns A^(N-1) b … b of the n states that must come to rest. All such u, and they alone, are D(z) v of
    the coprime factors N(z)/D(z) of the model: u = D v and y = N v for one finite v, whose increments sum to
    (distance)/N(1).
    """

    directions: np.ndarray
    """Orthonormal directions of u that change where it leads, shape (N, n)."""
    goal: np.ndarray
    """How far u must go along them [N], shape (n,)."""
    order: int
    """Of the differences."""
    steps: np.ndarray
    """What the differences of u over its samples are to be, for u to begin at 0 and to go on as `rest` [N]."""

    @classmethod
    def of(
        cls, transition: np.ndarray, held: np.ndarray, goal: np.ndarray, rest: float, samples: int, order: int
    ) -> "Program":
        """Return the program of a sampled model; ParameterError if its states cannot all be brought to rest."""
        reach = np.empty((goal.size, samples))
        column = held
        for k in range(samples - 1, -1, -1):
            reach[:, k] = column
            column = transition @ column
        scale = 1 / np.maximum(np.abs(reach).max(axis=1), np.finfo(float).tiny)
        directions, triangle = np.linalg.qr((scale[:, None] * reach).T)
        if np.linalg.cond(triangle) > MOST_SKEWED:
            raise ParameterError(
                f"the design model's {goal.size} states cannot be brought to rest by one thrust in {samples} samples: "
                "expected modes of different frequencies, or a longer duration"
            )
        return cls(directions, np.linalg.solve(triangle.T, scale * goal), order, _at_the_end(rest, samples, order))

    def solve(self, lowest: np.ndarray | None = None, highest: np.ndarray | None = None) -> np.ndarray | None:
        """Return u [N], shape (N,), within its bounds [N]; None if there is no such u."""
        u = self._smoothest
        if lowest is None or highest is None or _within(u, lowest, highest):
            return u
        if u.size == self.goal.size:
            return None
        if u.size > MOST_BOUND:
            raise ParameterError(
                f"a move of {u.size:,} samples cannot be planned for a force_limit that binds; expected {MOST_BOUND:,} "
                "at most: raise force_limit, or make several moves"
            )
        left = _least_distance(np.vstack([self._ways, -self._ways]), np.concatenate([lowest - u, u - highest]))
        return None if left is None else self._led(u + self._ways @ left)

    @cached_property
    def _smoothest(self) -> np.ndarray:
        """The best u without bounds [N]: by its multipliers, as the matrix of the cost is a narrow band."""
        from scipy.linalg import solveh_banded  # scipy: imported only where something is designed

        binomials = _binomials(self.order)
        band = np.zeros((self.order + 1, self.directions.shape[0]))
        for k in range(self.order + 1):
            band[self.order - k, k:] = np.dot(binomials[: binomials.size - k], binomials[k:])
        linear = np.correlate(self.steps, binomials, "valid")
        solved = solveh_banded(band, np.column_stack([linear, self.directions]))
        free, answers = solved[:, 0], solved[:, 1:]
        multipliers = np.linalg.solve(self.directions.T @ answers, self.goal - self.directions.T @ free)
        return self._led(free + answers @ multipliers)

    @cached_property
    def _ways(self) -> np.ndarray:
        """Ways from the best u that lead to the same end, each of which costs the square of how far one goes."""
        n = self.goal.size
        null = np.linalg.qr(self.directions, mode="complete")[0][:, n:]
        differences = np.diff(np.pad(null, ((self.order, self.order), (0, 0))), self.order, axis=0)
        triangle = np.linalg.qr(differences).R
        return np.linalg.solve(triangle.T, null.T).T

    def _led(self, u: np.ndarray) -> np.ndarray:
        """Return the nearest u that leads to the goal: rounding has led it a little astray."""
        return u + self.directions @ (self.goal - self.directions.T @ u)


def _binomials(order: int) -> np.ndarray:
    """Return the coefficients of a difference, from the newest sample on."""
    return np.array([(-1.0) ** shift * comb(order, shift) for shift in range(order + 1)])


def _at_the_end(rest: float, samples: int, order: int) -> np.ndarray:
    """Return what the differences of u are compared with, shape (samples + order,): behind u they see `rest`."""
    return np.concatenate([np.zeros(samples), -rest * np.cumsum(_binomials(order))[:order]])


def _within(u: np.ndarray, lowest: np.ndarray | None, highest: np.ndarray | None) -> bool:
    slack = SAME * float(np.abs(u).max())
    return (lowest is None or bool((u >= lowest - slack).all())) and (
        highest is None or bool((u <= highest + slack).all())
    )


def _least_distance(matrix: np.ndarray, bound: np.ndarray) -> np.ndarray | None:
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
    except RuntimeError:  # it does not end: nothing is known
        return None
    if distance < INFEASIBLE:
        return None
    residual = system @ multipliers - unit
    return -scale * residual[:-1] / residual[-1]
