"""What an identification of friction fits to records, and elements on a grid of thresholds, with which it starts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Finding, Quantity, RecordError
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE
from fraexp_plugins.identification._shared.stop_operator import turning_points
from fraexp_plugins.identification.friction._friction_record import (
    FrictionRecord,
)
from fraexp_plugins.identification.friction._friction_regression import (
    CompressedRows,
    Observation,
    RegressionRows,
    long_run_variance,
    misfit_variance,
    regression_rows,
)
from fraexp_plugins.identification.friction._friction_report import (
    Errors,
    ReportedElements,
    has_model_error,
    model_error_remarks,
)

STANDSTILL_SPEED_RATIO = 0.3
"""Speed over that of sliding below which the machine turns: a jump of friction looks like inertia there."""
MIN_ROWS = 60
"""Rows that a regression needs."""


@dataclass(frozen=True)
class IdentificationTask:
    """Records, observation, thresholds and terms of an identification."""

    records: tuple[FrictionRecord, ...]
    observation: Observation
    terms: tuple[str, ...]
    """Terms that are fitted with the elements, those of either sign first."""
    thresholds: NDArray[np.float64]
    """Y_i of the grid [m], ascending, shape (N,)."""
    viscous: float | None
    """Known viscous coefficient [N s/m], or None."""
    resolution: float
    """Quantisation step of the encoder [m]; 0 if it is ideal."""
    held_out: NDArray[np.int64]
    """Numbers of the cycles that are held out."""
    cycles: NDArray[np.int64]
    """Numbers of the cycles that are fitted."""
    remarks: tuple[Finding | str, ...]
    speed: float | None = None
    """The speed of all sliding [m/s] if there is only one."""

    def rows(self, thresholds: NDArray[np.float64]) -> list[RegressionRows]:
        """Return the rows of all records for elements with these thresholds [m], shape (N,)."""
        elements = [record.deflections(thresholds) for record in self.records]
        return self.rows_with(elements)

    def rows_with(self, elements: Sequence[NDArray[np.float64]]) -> list[RegressionRows]:
        """Return the rows of all records with these columns of elements, each (n, N)."""
        max_threshold = float(self.thresholds.max())
        rows = [
            regression_rows(record, self.observation, self.terms, columns, record.first_known_sample(max_threshold))
            for record, columns in zip(self.records, elements, strict=True)
        ]
        if self.viscous:
            rows = [self._without_viscous(*pair) for pair in zip(rows, self.records, strict=True)]
        rows = [each for each in rows if each.force.size]
        if sum(each.force.size for each in rows) < MIN_ROWS:
            raise RecordError(
                "the motion never spans twice the largest threshold, ",
                Quantity(max_threshold, "m"),
                ", for long enough; record more cycles with gross sliding, or lower max_threshold",
            )
        return rows

    def _without_viscous(self, rows: RegressionRows, record: FrictionRecord) -> RegressionRows:
        known = self.observation.friction(record, record.velocity()[:, None])
        max_threshold = float(self.thresholds.max())
        known = self.observation.known_rows(record, known, record.first_known_sample(max_threshold))
        return replace(rows, force=rows.force - (self.viscous or 0.0) * known[:, 0])

    @property
    def least_error(self) -> float:
        """Root mean square error [N] with all elements of the grid."""
        rows = self.rows(self.thresholds)
        compressed = CompressedRows(rows, self.cycles)
        solution = compressed.solve(np.ones(rows[0].columns.shape[1], dtype=bool))
        return float(np.sqrt(compressed.mean_square(solution)))

    def noise(self, mass: float) -> float:
        """Return the error [N] by noise of the channels."""
        return max(self.observation.noise(record, mass) for record in self.records)

    def inflation(
        self, rows: Sequence[RegressionRows], errors: Errors, coulomb: float, mass: float, count: int
    ) -> float:
        """Return the factor on a covariance of `count` parameters for errors of the model; 1 if noise explains them."""
        if not has_model_error(coulomb, errors.worst, self.noise(mass)):
            return 1.0
        chosen = [np.isin(each.cycle, self.cycles) for each in rows]
        parts = [residual[which] for residual, which in zip(errors.residuals, chosen, strict=True)]
        size = sum(part.size for part in parts)
        return max(misfit_variance(size, count, errors.fitted) / long_run_variance(parts, count), 1.0)

    def with_model_error(
        self, found: ReportedElements, rows: Sequence[RegressionRows], errors: Errors
    ) -> tuple[ReportedElements, list[str]]:
        """Return the elements with the model's errors in their covariance, and remarks on these errors."""
        coulomb, mass = found.coulomb[0], found.terms.get("mass", 0.0)
        count = found.stiffness.size + len(self.terms)
        covariance = found.covariance * self.inflation(rows, errors, coulomb, mass, count)
        if mass and self.speed is not None:  # friction jumps at an unknown time while the machine stands
            place = len(covariance) - len(found.terms) + list(found.terms).index("mass")
            delay = max(_standstill_time(record, self.speed) for record in self.records)
            covariance[place, place] += (coulomb * delay / self.speed / NORMAL_QUANTILE) ** 2
        return replace(found, covariance=covariance), model_error_remarks(coulomb, errors.worst, self.noise(mass))

    def errors(self, rows: Sequence[RegressionRows], residuals: Sequence[NDArray[np.float64]]) -> Errors:
        """Return the errors from the residuals [N] of each record."""
        labels = np.concatenate([each.cycle for each in rows])
        squared = np.concatenate(residuals) ** 2
        held = np.isin(labels, self.held_out)
        parts = [squared[~held], squared[held]]
        fitted, held_out = (float(np.sqrt(np.add.reduce(p) / p.size)) if p.size else np.nan for p in parts)
        return Errors(fitted, held_out, residuals)


def _standstill_time(record: FrictionRecord, speed: float) -> float:
    """Return the standstill time at a reversal of a motion at this speed [m/s], plus one sample [s]."""
    turns = turning_points(record.displacement, speed * record.sample_time).size
    slow = int(np.sum(np.abs(record.velocity()) < STANDSTILL_SPEED_RATIO * speed))
    return (1 + slow / max(turns, 1)) * record.sample_time


REMARKED_SPRING, REFUSED_SPRING = 0.1, 0.5
"""Forces of a spring to ground, over that of slipping elements, from which there is a remark, and an error."""
SPRING_ERROR_RATIO = 0.9
"""Squared error with that spring over the one without, up to which the spring is significant."""
CURVE_END_FORCE, GRID_MARGIN = 0.98, 1.5
"""Part of the Coulomb force at which the virgin curve ends, and the factor by which the grid extends beyond."""
MIN_STIFFNESS = 1e-12
"""Relative stiffness of an element below which it counts as none."""
ERROR_TOLERANCE = 1e-3
"""Relative excess of the squared error that counts as none."""


def element_solution(
    task: IdentificationTask, elements: int, has_known_thresholds: bool
) -> tuple[ReportedElements, list[RegressionRows], NDArray[np.float64]]:
    """Return elements and terms, the rows of the final grid, and the coefficients of their columns.

    It is non-negative least squares on stop operators over the thresholds. Elements are removed one by one, always the
    one whose removal increases the error least; their number is `elements`, or, if that is 0, the one with the smallest
    squared error over the held-out cycles. The covariance includes the neighbours on the grid: an error of an element's
    threshold appears as stiffness there, and counts as that of the nearest element.
    """
    rows = task.rows(task.thresholds)
    fitted = CompressedRows(rows, task.cycles)
    terms = np.arange(rows[0].columns.shape[1]) < len(task.terms)
    every = np.ones_like(terms, dtype=bool)
    sets = [every] if has_known_thresholds else _nested_sets(fitted, terms, every)
    kept = _choose_set(sets, rows, task, fitted, elements)
    coefficients = fitted.solve(kept)
    _check_found(coefficients[len(task.terms) :])
    basis = terms | (coefficients > 0) if has_known_thresholds else terms | _with_neighbours(sets[0], len(task.terms))
    covariance = _covariance(rows, task, fitted, coefficients, basis)
    return _elements(task, coefficients, covariance), rows, coefficients


def curve_end(task: IdentificationTask, *, spring_remarks: bool = True) -> tuple[float, list[Finding]]:
    """Return the end of the virgin curve [m], which a wide motion hardly resolves, and remarks on a spring."""
    rows = task.rows(task.thresholds)
    coefficients = CompressedRows(rows, task.cycles).solve(np.ones(rows[0].columns.shape[1], dtype=bool))
    remarks = _spring_remarks(rows, task, coefficients)
    force = coefficients[len(task.terms) :] * task.thresholds
    _check_found(force)
    reached = np.searchsorted(np.cumsum(force), CURVE_END_FORCE * force.sum())
    end = GRID_MARGIN * float(task.thresholds[min(reached, force.size - 1)])
    return min(end, float(task.thresholds[-1])), remarks if spring_remarks else []


def _with_neighbours(kept: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
    """Return the kept elements and those beside them on the grid, after `count` terms, shape (p,) of bool."""
    elements = kept[count:].copy()
    elements[1:] |= kept[count:-1]
    elements[:-1] |= kept[count + 1 :]
    return np.concatenate([kept[:count], elements])


def _covariance(
    rows: Sequence[RegressionRows],
    task: IdentificationTask,
    fitted: CompressedRows,
    coefficients: NDArray[np.float64],
    basis: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return the covariance of the coefficients of the `basis`, 0 elsewhere, shape (p, p)."""
    residuals = [(each.force - each.columns @ coefficients)[np.isin(each.cycle, task.cycles)] for each in rows]
    return fitted.inverse(basis) * long_run_variance(residuals, int(basis.sum()))


def _nested_sets(fitted: CompressedRows, terms: NDArray[np.bool_], every: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Return sets of columns with fewer and fewer elements, each of shape (p,): the least important one is removed."""
    kept = terms | (fitted.solve(every) > 0)
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
    rows: Sequence[RegressionRows],
    task: IdentificationTask,
    fitted: CompressedRows,
    elements: int,
) -> NDArray[np.bool_]:
    """Return the set of so many elements, or the smallest set with the smallest held-out error."""
    sizes = [int(kept.sum()) - len(task.terms) for kept in sets]
    if len(sets) == 1:
        return sets[0]
    if elements:
        return next((kept for kept, size in zip(sets, sizes, strict=True) if size <= elements), sets[-1])
    held_out = CompressedRows(rows, task.held_out)
    held_out = held_out if held_out.count else fitted
    errors = np.array([held_out.mean_square(fitted.solve(kept)) for kept in sets])
    good = np.flatnonzero(errors <= errors.min() * (1 + ERROR_TOLERANCE))
    return sets[int(good[-1])]


def _spring_remarks(
    rows: Sequence[RegressionRows], task: IdentificationTask, coefficients: NDArray[np.float64]
) -> list[Finding]:
    """Return a remark if a spring to ground explains a part of the force; RecordError if it explains most of it."""
    elements = [np.column_stack([record.deflections(task.thresholds), record.displacement]) for record in task.records]
    with_spring = task.rows_with(elements)
    compressed = CompressedRows(with_spring, task.cycles)
    found = compressed.solve(np.ones(with_spring[0].columns.shape[1], dtype=bool))
    stroke = max(float(np.ptp(record.displacement)) for record in task.records)
    slipping = float(np.sum(found[len(task.terms) : -1] * task.thresholds))
    spring = found[-1] * stroke / 2
    without = CompressedRows(rows, task.cycles).mean_square(coefficients)
    if spring <= REMARKED_SPRING * slipping or compressed.mean_square(found) > SPRING_ERROR_RATIO * without:
        return []
    rise = (
        Quantity(stroke, "m", "stroke"),
        Quantity(spring, "N", "rise of the force over it"),
        Quantity(spring + slipping, "N", "force at its end"),
    )
    if spring > REFUSED_SPRING * slipping:
        parts = [part for of in rise for part in (", ", of)]
        raise RecordError("the motion stays in presliding: ", *parts[1:], "; record a motion several times as wide")
    remedy = "record a wider motion to separate a spring, a Stribeck effect and wider elements"
    return [Finding("remark", rise, text="the force still rises at the end of the stroke", remedy=remedy)]


def _check_found(stiffness: NDArray[np.float64]) -> None:
    """Raise RecordError if no element has a stiffness."""
    if not np.any(stiffness > 0):
        raise RecordError(
            "no friction is identifiable: the force does not follow the motion as friction does; check its sign "
            "(friction acts with the velocity), its channel and the dead time"
        )


def _elements(
    task: IdentificationTask, coefficients: NDArray[np.float64], covariance: NDArray[np.float64]
) -> ReportedElements:
    """Return the elements of the coefficients that are above 0."""
    count = len(task.terms)
    stiffness = coefficients[count:]
    kept = np.flatnonzero(stiffness > MIN_STIFFNESS * stiffness.sum())
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
