"""Elements of friction on a grid of thresholds: the convex problem from which every identification starts."""

from abc import ABC
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from fraexp.api import RecordError, Signals, param
from fraexp_plugins.identification.friction_identification import FrictionIdentification, IdentificationTask
from fraexp_plugins.identification.friction_regression import Compressed, RegressionRows, long_run_variance
from fraexp_plugins.identification.friction_report import ReportedElements

SPRING, MOSTLY = 0.1, 0.5
"""Force of a spring to ground, over that of slipping elements, from which it is remarked on, and refused."""
BETTER = 0.9
"""Squared error with that spring over the one without, where it is believed."""
ALL, BEYOND = 0.98, 1.5
"""Share of the Coulomb force at whose threshold the virgin curve ends, and how much farther the grid goes."""
FOUND = 1e-12
"""Stiffness of an element, relative to all, that is none."""
JUST_BELOW = 1e-3
"""Relative excess of the squared error that counts as none."""


class GridIdentification(FrictionIdentification, ABC):
    """An identification that begins with non-negative least squares on stop operators over a grid of thresholds.

    Elements are taken away one by one, always the one that is missed least; their number is the one whose squared error
    over the cycles held out is least. Standard deviations take the neighbours on the grid along: what an element's
    threshold may be off by shows as stiffness there, and is counted as that of the nearest element.
    """

    elements: int = param("1", "number of elements; chosen by held-out cycles if 0", 0, at_least=0, at_most=400)

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses the frictionless machine with which it is tried here.",
    )

    def solution(self, task: IdentificationTask) -> tuple[ReportedElements, list[RegressionRows], np.ndarray]:
        """Return elements and terms, the rows of the final grid, and the coefficients of their columns."""
        rows = task.rows(task.thresholds)
        fitted = Compressed(rows, task.cycles)
        terms = np.arange(rows[0].columns.shape[1]) < len(task.terms)
        every = np.ones_like(terms)
        sets = [every] if self.thresholds else _nested(fitted, terms, every)
        kept = _chosen(sets, rows, task, fitted, self.elements)
        coefficients = fitted.solve(kept)
        _check_found(coefficients[len(task.terms) :])
        basis = terms | (coefficients > 0) if self.thresholds else terms | _neighbours(sets[0], len(task.terms))
        covariance = _covariance(rows, task, fitted, coefficients, basis)
        return _elements(task, coefficients, covariance), rows, coefficients

    def focused(self, signals: Signals) -> IdentificationTask:
        """Return the task with a grid that ends where the virgin curve does: a wide motion says little about it."""
        task = self.task(signals)
        if self.thresholds:
            return task
        rows = task.rows(task.thresholds)
        coefficients = Compressed(rows, task.cycles).solve(np.ones(rows[0].columns.shape[1], dtype=bool))
        remarks = (*task.remarks, *_check_slip(rows, task, coefficients))
        force = coefficients[len(task.terms) :] * task.thresholds
        _check_found(force)
        reached = np.searchsorted(np.cumsum(force), ALL * force.sum())
        task = replace(task, remarks=remarks)
        return self.narrowed(task, BEYOND * float(task.thresholds[min(reached, force.size - 1)]))


def _neighbours(kept: np.ndarray, count: int) -> np.ndarray:
    """Return the kept elements and those beside them on the grid, after `count` terms, shape (p,) of bool."""
    wide = kept[count:].copy()
    wide[1:] |= kept[count:-1]
    wide[:-1] |= kept[count + 1 :]
    return np.concatenate([kept[:count], wide])


def _covariance(
    rows: Sequence[RegressionRows],
    task: IdentificationTask,
    fitted: Compressed,
    coefficients: np.ndarray,
    basis: np.ndarray,
) -> np.ndarray:
    """Return the covariance of the coefficients of the `basis`, 0 elsewhere, shape (p, p)."""
    residuals = [(each.force - each.columns @ coefficients)[np.isin(each.cycle, task.cycles)] for each in rows]
    covariance: np.ndarray = fitted.inverse(basis) * long_run_variance(residuals, int(basis.sum()))
    return covariance


def _nested(fitted: Compressed, terms: np.ndarray, every: np.ndarray) -> list[np.ndarray]:
    """Return sets of columns with ever fewer elements, each shape (p,) of bool: the least missed one goes."""
    kept = terms | (fitted.solve(every) > 0)
    sets = [kept]
    while np.sum(kept & ~terms) > 1:
        trials = [kept & (np.arange(kept.size) != place) for place in np.flatnonzero(kept & ~terms)]
        solved = [fitted.solve(trial) for trial in trials]
        best = int(np.argmin([fitted.mean_square(solution) for solution in solved]))
        kept = trials[best] & (terms | (solved[best] > 0))
        sets.append(kept)
    return sets


def _chosen(
    sets: Sequence[np.ndarray],
    rows: Sequence[RegressionRows],
    task: IdentificationTask,
    fitted: Compressed,
    elements: int,
) -> np.ndarray:
    """Return the set of so many elements, or the smallest one whose held-out error is the least."""
    sizes = [int(kept.sum()) - len(task.terms) for kept in sets]
    if len(sets) == 1:
        return sets[0]
    if elements:
        return next((kept for kept, size in zip(sets, sizes, strict=True) if size <= elements), sets[-1])
    judged = Compressed(rows, task.held_out)
    judged = judged if judged.count else fitted
    errors = np.array([judged.mean_square(fitted.solve(kept)) for kept in sets])
    good = np.flatnonzero(errors <= errors.min() * (1 + JUST_BELOW))
    return sets[int(good[-1])]


def _check_slip(rows: Sequence[RegressionRows], task: IdentificationTask, coefficients: np.ndarray) -> list[str]:
    """Return a remark if a spring to ground explains some of what slipping elements should; RecordError if most."""
    elements = [
        np.column_stack([task.deflections(stretch, task.thresholds), stretch.displacement])
        for stretch in task.stretches
    ]
    with_spring = task.rows_with(elements)
    compressed = Compressed(with_spring, task.cycles)
    found = compressed.solve(np.ones(with_spring[0].columns.shape[1], dtype=bool))
    stroke = max(float(np.ptp(stretch.displacement)) for stretch in task.stretches)
    slipping = float(np.sum(found[len(task.terms) : -1] * task.thresholds))
    stuck = found[-1] * stroke / 2
    without = Compressed(rows, task.cycles).mean_square(coefficients)
    if stuck <= SPRING * slipping or compressed.mean_square(found) > BETTER * without:
        return []
    rise = f"over the stroke of {stroke:.3g} m the force still rises by {stuck:.3g} N of {stuck + slipping:.3g} N"
    if stuck > MOSTLY * slipping:
        raise RecordError(f"the friction does not slip through: {rise}; record a motion several times as wide")
    return [f"{rise}: a wider motion would tell whether a spring, a Stribeck effect or wider elements do that"]


def _check_found(stiffness: np.ndarray) -> None:
    if not np.any(stiffness > 0):
        raise RecordError(
            "no friction is found: the force does not follow the motion as friction does; check the force's sign "
            "(friction acts with the velocity), its channel and the dead time"
        )


def _elements(task: IdentificationTask, coefficients: np.ndarray, covariance: np.ndarray) -> ReportedElements:
    """Return the elements of the coefficients that are above 0."""
    count = len(task.terms)
    stiffness = coefficients[count:]
    kept = np.flatnonzero(stiffness > FOUND * stiffness.sum())
    places = np.arange(stiffness.size)
    nearest = np.argmin(np.abs(np.log(task.thresholds)[:, None] - np.log(task.thresholds[kept])), axis=1)
    transform = np.zeros((2 * kept.size + count, coefficients.size))
    transform[nearest, count + places] = 1.0
    transform[kept.size + nearest, count + places] = task.thresholds
    transform[2 * kept.size :, :count] = np.eye(count)
    full = transform @ covariance @ transform.T
    terms = dict(zip(task.terms, coefficients[:count].tolist(), strict=True))
    if task.viscous is not None:
        terms["viscous"] = task.viscous
        full = np.pad(full, (0, 1))
    return ReportedElements(stiffness[kept], stiffness[kept] * task.thresholds[kept], np.empty(0), terms, full)
