"""The least and the greatest sum of some forces with which others still explain the records."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

RIDGE_RATIO = 1e-6
"""Weight of a ridge over that of the largest column: it decides between columns that are equal."""
CONSTRAINT_WEIGHT = 1e4
"""Weight of the equation that holds the sum, over that of the largest column."""
TOLERANCE = 1e-3
"""Relative tolerance of an end of the interval."""
MAX_DOUBLINGS = 20
"""Steps in which an upper end is looked for; each is twice as long as the one before."""


def sum_interval(
    matrix: NDArray[np.float64], target: NDArray[np.float64], chosen: NDArray[np.bool_], rise: float
) -> tuple[float, float]:
    """Return the least and greatest Σ x_j over the `chosen` columns for which |A x - b|² is near its minimum.

    It is the profile likelihood of the sum over x >= 0: the sum of squares, minimised over all other directions, lies
    at most `rise` above that of the best x. Columns that may replace one another make it wide, whichever of them the
    best x has (S. A. Murphy and A. W. van der Vaart, Journal of the American Statistical Association 95(450), 2000,
    doi 10.1080/01621459.2000.10474219). The profile is convex. `matrix` A has the shape (m, N), `chosen` (N,).
    """
    from scipy.optimize import nnls  # slow to import: only when something is estimated

    count = matrix.shape[1]
    triangle = np.linalg.qr(np.column_stack([matrix, target])).R
    reduced, right = triangle[:, :-1], triangle[:, -1]
    scale = float(np.linalg.norm(reduced, axis=0).max())
    ridge, hold = RIDGE_RATIO * scale * np.eye(count), CONSTRAINT_WEIGHT * scale * chosen[None].astype(float)
    zeros = np.zeros(count)

    def cost_at(total: float) -> float:
        rows = np.concatenate([reduced, ridge, hold])
        x, _ = nnls(rows, np.concatenate([right, zeros, [CONSTRAINT_WEIGHT * scale * total]]), maxiter=100 * count)
        return float(np.sum((reduced @ x - right) ** 2))

    x, _ = nnls(np.concatenate([reduced, ridge]), np.concatenate([right, zeros]), maxiter=100 * count)
    best, most = float(x[chosen].sum()), float(np.sum((reduced @ x - right) ** 2)) + rise

    def is_near(total: float) -> bool:
        return cost_at(total) <= most

    step = max(best, TOLERANCE) / 32
    for _ in range(MAX_DOUBLINGS):
        if not is_near(best + step):
            break
        step *= 2
    low = 0.0 if is_near(0.0) else _edge(is_near, best, 0.0)
    return low, _edge(is_near, best, best + step)


def _edge(is_near: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return the end of an interval by bisection, on its outer side."""
    tolerance = TOLERANCE * max(abs(inside), abs(outside))
    while abs(outside - inside) > tolerance:
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if is_near(middle) else (inside, middle)
    return outside
