"""Least squares of all identification: sizes that cannot be negative, shapes that are searched, and covariances."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ROUNDING, RecordError

HOLD_WEIGHT = ROUNDING**-0.5
"""Weight of the equation that holds a sum, over that of a column: it takes a quarter of a double's digits."""
Residuals = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class HeldSum(NamedTuple):
    """A sum of some unknowns that is given."""

    chosen: NDArray[np.bool_]
    """Which unknowns it adds up, shape (N,)."""
    value: float


def solve_non_negative(
    matrix: NDArray[np.float64], target: NDArray[np.float64], free: int = 0, held: HeldSum | None = None
) -> NDArray[np.float64]:
    """Return the x of least |A x - b|², shape (N,), of which all but the first `free` ones are >= 0.

    Orthogonal transformations make the rows below those of the free unknowns independent of them (C. L. Lawson and
    R. J. Hanson, Solving Least Squares Problems, 1974, ch. 23, doi 10.1137/1.9781611971217).
    """
    from scipy.optimize import nnls  # slow to import: only when something is estimated

    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    table = np.column_stack([matrix / scale, target])
    if held is not None:
        row = held.chosen / scale
        table = np.vstack([table, HOLD_WEIGHT / row.max() * np.append(row, held.value)])
    small = np.asarray(np.linalg.qr(table, mode="r")) if free else table
    try:
        positive, _ = nnls(small[free:, free:-1], small[free:, -1], maxiter=100 * (scale.size + 1))
    except RuntimeError:
        raise RecordError(
            "the non-negative least squares did not converge; use fewer thresholds, or a wider range of them"
        ) from None
    either = np.linalg.solve(small[:free, :free], small[:free, -1] - small[:free, free:-1] @ positive)
    return np.asarray(np.concatenate([either, positive]) / scale)


def inverse_square(jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (JᵀJ)⁻¹, shape (p, p), of a Jacobian of p columns: the covariance for residuals of variance 1.

    A direction that the rows do not determine has a great variance, not an infinite one.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    triangle = np.asarray(np.linalg.qr(jacobian / scale, mode="r"))
    _, singular, right = np.linalg.svd(np.concatenate([triangle, ROUNDING * np.eye(scale.size)]), full_matrices=False)
    root = right.T / singular / scale[:, None]
    return np.asarray(root @ root.T)


def minimise(
    residuals: Residuals,
    start: NDArray[np.float64],
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
    evaluations: int | None,
    jacobian: Residuals | None = None,
    **options: Any,
) -> tuple[NDArray[np.float64], bool]:
    """Return where a search from a start leads, and whether it has converged.

    What is linear is eliminated in the residuals (variable projection: G. H. Golub and V. Pereyra, SIAM J. Numerical
    Analysis 10(2), 1973, doi 10.1137/0710036). Without a Jacobian differences are taken. `options` are those of
    `scipy.optimize.least_squares`. Where no parameter changes the residuals, as of a law
    without force, the start is returned.
    """
    from scipy.optimize import least_squares  # slow to import: only when something is estimated

    start = np.clip(start, *bounds)
    if jacobian is not None and not jacobian(start).any():
        return start, True
    known = {"jac": jacobian} if jacobian is not None else {}
    settings = {"x_scale": "jac", "ftol": ROUNDING, "xtol": ROUNDING, "gtol": None, **known, **options}
    found = least_squares(residuals, start, bounds=bounds, max_nfev=evaluations, **settings)
    return found.x, bool(found.status > 0)


def derivatives(function: Residuals, point: NDArray[np.float64], steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivatives of a function by its p parameters, shape (values, p), by differences of these steps.

    They are 0 for a step of 0, and where the function is infinite, as no model has the parameters.
    """
    here = function(point)
    moved = [function(point + row) - here if row.any() else np.zeros(here.size) for row in np.diag(steps)]
    found = np.array(moved).reshape(-1, here.size).T / np.where(steps == 0, 1.0, steps)
    return np.where(np.isfinite(found), found, 0.0)
