"""Elements on a grid of thresholds, by non-negative least squares: convex, without a start, their number chosen."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Finding, Quantity, RecordError
from fraexp_plugins.identification.friction._friction_fit import FrictionFit, GridElements
from fraexp_plugins.identification.friction._friction_problem import FrictionProblem
from fraexp_plugins.identification.friction._regression import CompressedRows, Rows

REMARKED_SPRING, REFUSED_SPRING = 0.1, 0.5
"""Forces of a spring to ground, over that of slipping elements, from which there is a remark, and an error."""
SPRING_ERROR_RATIO = 0.9
"""Squared error with that spring over the one without, up to which the spring is significant."""
CURVE_END_FORCE, GRID_MARGIN = 0.98, 1.5
"""Part of the Coulomb force at which the virgin curve ends, and the factor by which the grid extends beyond."""
ERROR_TOLERANCE = 1e-3
"""Relative excess of the squared error that counts as none."""


def fit_elements(problem: FrictionProblem, elements: int, has_known_thresholds: bool) -> FrictionFit:
    """Return the fit of elements on the grid.

    It is non-negative least squares on stop operators over the thresholds. Elements are removed one by one, always the
    one whose removal increases the error least; their number is `elements`, or, if that is 0, the one with the smallest
    squared error over the held-out cycles.
    """
    rows, count = _rows(problem), len(problem.terms)
    fitted = problem.compress(rows, problem.cycles)
    terms = np.arange(rows[0].columns.shape[1]) < count
    sets = [np.ones_like(terms)] if has_known_thresholds else _nested_sets(fitted, terms)
    coefficients = fitted.solve(_choose_set(sets, rows, problem, fitted, elements))
    kept = coefficients[count:] > 0
    if not kept.any():
        raise RecordError(
            "no friction is identifiable: the force does not follow the motion as friction does; check its sign "
            "(friction acts with the velocity), its channel and the dead time"
        )
    of_grid = np.zeros_like(kept) if has_known_thresholds else np.convolve(sets[0][count:], [1, 1, 1], "same") > 0
    forces = GridElements(problem.thresholds[kept], problem.thresholds[of_grid & ~kept])
    return FrictionFit(problem, forces, np.zeros(forces.neighbours.size))


def grid_error(problem: FrictionProblem) -> float:
    """Return the root mean square error [N] with all elements of the grid."""
    compressed = problem.compress(_rows(problem), problem.cycles)
    return float(np.sqrt(compressed.mean_square(compressed.solve(np.ones(compressed.size, dtype=bool)))))


def curve_end(problem: FrictionProblem, *, spring_remarks: bool = True) -> tuple[float, list[Finding | str]]:
    """Return the end of the virgin curve [m], which a wide motion hardly resolves, and remarks on a spring."""
    compressed = problem.compress(_rows(problem), problem.cycles)
    coefficients = compressed.solve(np.ones(compressed.size, dtype=bool))
    remarks = _spring_remarks(problem, compressed.mean_square(coefficients))
    force = coefficients[len(problem.terms) :] * problem.thresholds
    reached = np.searchsorted(np.cumsum(force), CURVE_END_FORCE * force.sum())
    end = GRID_MARGIN * float(problem.thresholds[min(reached, force.size - 1)])
    return min(end, float(problem.thresholds[-1])), remarks if spring_remarks else []


def _rows(problem: FrictionProblem) -> list[Rows]:
    return problem.rows_with([record.deflections(problem.thresholds) for record in problem.records])


def _nested_sets(fitted: CompressedRows, terms: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Return sets of columns with fewer and fewer elements, each of shape (p,): the least important one is removed."""
    kept = terms | (fitted.solve(np.ones_like(terms)) > 0)
    sets = [kept]
    while np.sum(kept & ~terms) > 1:
        trials = [kept & (np.arange(kept.size) != place) for place in np.flatnonzero(kept & ~terms)]
        solved = [fitted.solve(trial) for trial in trials]
        best = int(np.argmin([fitted.mean_square(solution) for solution in solved]))
        kept = trials[best] & (terms | (solved[best] > 0))
        sets.append(kept)
    return sets


def _choose_set(
    sets: Sequence[NDArray[np.bool_]],
    rows: Sequence[Rows],
    problem: FrictionProblem,
    fitted: CompressedRows,
    elements: int,
) -> NDArray[np.bool_]:
    """Return the set of so many elements, or the smallest set with the smallest held-out error."""
    if len(sets) == 1:
        return sets[0]
    if elements:
        sizes = [int(kept.sum()) - len(problem.terms) for kept in sets]
        return next((kept for kept, size in zip(sets, sizes, strict=True) if size <= elements), sets[-1])
    held_out = problem.compress(rows, problem.held_out)
    held_out = held_out if held_out.count else fitted
    errors = np.array([held_out.mean_square(fitted.solve(kept)) for kept in sets])
    return sets[int(np.flatnonzero(errors <= errors.min() * (1 + ERROR_TOLERANCE))[-1])]


def _spring_remarks(problem: FrictionProblem, without: float) -> list[Finding | str]:
    """Return a remark if a spring to ground explains a part of the force; RecordError if it explains most of it.

    `without` is the mean squared error without it [N²].
    """
    columns = [np.column_stack([r.deflections(problem.thresholds), r.displacement]) for r in problem.records]
    compressed = problem.compress(problem.rows_with(columns), problem.cycles)
    found = compressed.solve(np.ones(compressed.size, dtype=bool))
    stroke = max(float(np.ptp(record.displacement)) for record in problem.records)
    slipping = float(np.sum(found[len(problem.terms) : -1] * problem.thresholds))
    spring = found[-1] * stroke / 2
    if spring <= REMARKED_SPRING * slipping or compressed.mean_square(found) > SPRING_ERROR_RATIO * without:
        return []
    rise = (
        Quantity(stroke, "m", "stroke"),
        Quantity(float(spring), "N", "rise of the force over it"),
        Quantity(float(spring) + slipping, "N", "force at its end"),
    )
    if spring > REFUSED_SPRING * slipping:
        parts = [part for of in rise for part in (", ", of)]
        raise RecordError("the motion stays in presliding: ", *parts[1:], "; record a motion several times as wide")
    remedy = "record a wider motion to separate a spring, a Stribeck effect and wider elements"
    return [Finding("remark", rise, text="the force still rises at the end of the stroke", remedy=remedy)]
