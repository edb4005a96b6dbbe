"""The fit of a law's forces beside the terms: elements on a grid, or any law whose shape is searched."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    DIFFERENCE,
    NORMAL_QUANTILE,
    Finding,
    FrictionModel,
    Motion,
    ParameterError,
    Quantity,
    RecordError,
    interval_factor,
)
from fraexp_plugins.friction._shared.element_model import ElementModel
from fraexp_plugins.identification._shared.law_forces import (
    FreeElements,
    LawForces,
    WholeLaw,
    rolling_elements,
)
from fraexp_plugins.identification._shared.least_squares import inverse_square, minimise
from fraexp_plugins.identification._shared.usable_records import FORCE_FLOOR
from fraexp_plugins.identification.friction._friction_rows import TERM_UNITS, FrictionProblem, FrictionRecord, Rows
from fraexp_plugins.identification.friction._regression import (
    CompressedRows,
    Regression,
    Waves,
    long_run_variance,
    misfit_variance,
    regress,
)

MAX_NOISE_RATIO = 3.0
"""Error over that by the channels' noise up to which noise explains it."""
MAX_REMAINING_RATIO = 0.7
"""Error with a force along the stroke over the one without, up to which that force is fitted."""


class IdentifiedNumber(NamedTuple):
    """A number of a law or a term that was identified."""

    name: str
    unit: str
    value: float


def columns_along(forces: LawForces, record: FrictionRecord) -> NDArray[np.float64]:
    """Return the columns of a law [N] along a record, from the state before it, shape (n, N); 0 if it is not valid."""
    motion = Motion(record.displacement, record.sample_time, False, record.before, record.sample_time)
    try:
        return forces.columns(motion)
    except ParameterError:
        return np.zeros((record.displacement.size, forces.is_coulomb.size))


@dataclass(frozen=True)
class FrictionFit:
    """A law's forces of one shape beside the terms of a problem, with the sizes of least squared error."""

    problem: FrictionProblem
    forces: LawForces
    stroke: Regression | None = None
    """The change of shape and coefficients by a force along the stroke, and that force."""
    neighbours: NDArray[np.bool_] | None = None
    """Which columns have no force, but may have that of another one by an error of its threshold, shape (N,)."""

    @cached_property
    def rows(self) -> list[Rows]:
        """Terms, then the forces, in each record."""
        return self.problem.rows_with([columns_along(self.forces, record) for record in self.problem.records])

    @cached_property
    def coefficients(self) -> NDArray[np.float64]:
        """Those of the terms, then the sizes, shape (p,)."""
        compressed = CompressedRows(self.rows, self.problem.signed, self.problem.cycles)
        used = np.ones(compressed.size, dtype=bool)
        if self.neighbours is not None:
            used[len(self.problem.terms) :] = ~self.neighbours
        return compressed.solve(used)

    @property
    def shape(self) -> NDArray[np.float64]:
        """Coordinates of the law's shape, shape (q,)."""
        return self.forces.shape

    @property
    def sizes(self) -> NDArray[np.float64]:
        """Sizes of the forces, shape (N,)."""
        return self.coefficients[len(self.problem.terms) :]

    @cached_property
    def point(self) -> NDArray[np.float64]:
        """Shape and coefficients, with a force along the stroke if there is one, shape (q + p,)."""
        plain = np.concatenate([self.shape, self.coefficients])
        return plain if self.stroke is None else plain + self.stroke.values

    @cached_property
    def residuals(self) -> list[NDArray[np.float64]]:
        """Measured less modelled force in the rows of each record [N]."""
        found = [each.force - each.columns @ self.coefficients for each in self.rows]
        if self.stroke is None:
            return found
        triples = zip(found, self.slopes, self.stroke_forces, strict=True)
        return [residual - slope @ self.stroke.values - force for residual, slope, force in triples]

    @property
    def stroke_forces(self) -> list[NDArray[np.float64]]:
        """The force along the stroke in the rows of each record [N]; 0 if none is fitted."""
        sizes = [rows.force.size for rows in self.rows]
        every = np.zeros(sum(sizes)) if self.stroke is None else self.stroke.force
        return np.split(every, np.cumsum(sizes)[:-1])

    @property
    def fitted_residuals(self) -> NDArray[np.float64]:
        """Those of the fitted cycles of all records [N]."""
        return np.concatenate(self.problem.fitted(self.residuals))

    @cached_property
    def error(self) -> float:
        """Root mean square error over the cycles that are fitted [N]."""
        return _root_mean_square(self.fitted_residuals)

    @cached_property
    def held_out_error(self) -> float:
        """The same over the cycles that are held out; NaN if there are none."""
        pairs = zip(self.residuals, self.rows, strict=True)
        return _root_mean_square(np.concatenate([r[np.isin(rows.cycle, self.problem.held_out)] for r, rows in pairs]))

    @property
    def worst_error(self) -> float:
        """The larger of both errors."""
        return float(np.nanmax([self.error, self.held_out_error]))

    @cached_property
    def slopes(self) -> list[NDArray[np.float64]]:
        """Derivatives of the modelled force by the shape, then by the coefficients, in the rows of each record."""
        by_shape = []
        for record in self.problem.records:
            slopes = self.forces.slopes(partial(columns_along, record=record), self.sizes, DIFFERENCE)
            by_shape.append(np.array(slopes).reshape(-1, record.displacement.size).T)
        pairs = zip(self.problem.forces_in_rows(by_shape), self.rows, strict=True)
        return [np.hstack([each, rows.columns]) for each, rows in pairs]

    @property
    def projected_slopes(self) -> NDArray[np.float64]:
        """Derivative of the residual by the shape, with the sizes of least squares at each shape (L. Kaufman, 1975)."""
        jacobian = np.concatenate(self.problem.fitted(self.slopes))
        slopes, columns = np.split(jacobian, [self.shape.size], axis=1)
        used = columns[:, self.coefficients != 0]  # a size that stays at 0 does not follow the shape
        scale = np.linalg.norm(used, axis=0)
        basis, _ = np.linalg.qr(used / np.where(scale > 0, scale, 1.0))
        return np.asarray(basis @ (basis.T @ slopes) - slopes)

    def numbers_at(self, point: NDArray[np.float64]) -> list[IdentifiedNumber]:
        """Return the law's numbers, then the terms, at a shape and coefficients."""
        shape, terms, sizes = self._parts(point)
        of_law = replace(self.forces, shape=shape).numbers(sizes)
        return [IdentifiedNumber(each.name, each.unit, each.value) for each in of_law] + [
            IdentifiedNumber(name, TERM_UNITS[name], value)
            for name, value in zip(self.problem.terms, terms.tolist(), strict=True)
        ]

    @cached_property
    def numbers(self) -> list[IdentifiedNumber]:
        """The law's numbers, then the terms."""
        return self.numbers_at(self.point)

    @cached_property
    def model(self) -> FrictionModel:
        """The friction model."""
        shape, _, sizes = self._parts(self.point)
        viscous = self.term("viscous") if self.problem.viscous is None else self.problem.viscous
        return replace(self.forces, shape=shape).model(sizes, viscous)

    def _parts(self, point: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        return np.split(point, [self.shape.size, self.shape.size + len(self.problem.terms)])

    def term(self, name: str) -> float:
        """Return a term; 0 if it is not fitted."""
        return next((each.value for each in self.numbers if each.name == name), 0.0)

    @property
    def coulomb_force(self) -> float:
        """Force of gross sliding [N], by which errors are judged; 0 if the record shows no friction."""
        if not self.sizes.any():
            return 0.0
        forces = [each for each in self.numbers if each.unit == "N" and each.name != "offset"]
        of_elements = [each.value for each in forces if each.name.startswith("limit_force")]
        named = [each.value for each in forces if each.name == "coulomb_force"]
        return sum(of_elements) or (named or [each.value for each in forces] or [0.0])[0]

    @property
    def noise(self) -> float:
        """Error of a row [N] by noise of the channels."""
        return self.problem.noise(self.term("mass"))

    @property
    def has_model_error(self) -> bool:
        """Whether noise does not explain the error."""
        return self.worst_error > max(FORCE_FLOOR * self.coulomb_force, MAX_NOISE_RATIO * self.noise)

    @cached_property
    def inverse(self) -> NDArray[np.float64]:
        """Covariance of shape and coefficients over the variance of a row, shape (q + p, q + p)."""
        if self.stroke is not None:
            return self.stroke.inverse
        may_act = self.sizes > 0 if self.neighbours is None else self.neighbours | (self.sizes > 0)
        used = np.append(np.ones(self.point.size - self.sizes.size, dtype=bool), may_act)
        found = np.zeros((used.size, used.size))
        found[np.ix_(used, used)] = inverse_square(np.concatenate(self.problem.fitted(self.slopes))[:, used])
        return found

    @property
    def white_variance(self) -> float:
        """Variance of a row [N²] times the rows over which noise is correlated, if the residual is noise."""
        residual, per_noise = self.fitted_residuals, self.problem.rows_per_noise
        waves = 0.0 if self.stroke is None else self.stroke.waves * per_noise
        freedom = max(residual.size - self.point.size - waves, 1.0)
        return max(float(residual @ residual) / freedom * per_noise, np.finfo(float).tiny)

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the numbers: with the residual's correlation, errors of the model, and what is not known."""
        residuals = self.problem.observation.successive(self.problem.fitted(self.residuals))
        count = self.point.size + (0.0 if self.stroke is None else self.stroke.waves * self.problem.rows_per_noise)
        variance = max(long_run_variance(residuals, count), self.white_variance)
        if self.has_model_error:
            variance = max(variance, misfit_variance(self.fitted_residuals.size, self.point.size, self.error))
        covariance = self.inverse * variance + sum(np.outer(doubt, doubt) for doubt in self._doubts)
        found = self.number_slopes @ covariance @ self.number_slopes.T
        names = [each.name for each in self.numbers]
        if "mass" in names and self.problem.speed is not None:  # friction jumps at an unknown time while it stands
            place = names.index("mass")
            found[place, place] += (
                self.coulomb_force * self.problem.standstill_time / self.problem.speed / NORMAL_QUANTILE
            ) ** 2
        return found

    @property
    def _doubts(self) -> Iterator[NDArray[np.float64]]:
        """Yield the changes of shape and coefficients by a force along the stroke, and by the lead of the thrust."""
        jacobian = np.concatenate(self.problem.fitted(self.slopes))
        if self.stroke is not None:
            plain = np.diag(inverse_square(jacobian))
            yield self.stroke.values * np.clip(1 - plain / np.diag(self.stroke.inverse), 0.0, 1.0)
        if self.problem.lead_doubt:
            yield self.inverse @ (jacobian.T @ self.problem.thrust_doubt)

    @cached_property
    def number_slopes(self) -> NDArray[np.float64]:
        """Derivatives of the numbers by shape and coefficients, shape (numbers, q + p)."""
        here, columns = np.array([each.value for each in self.numbers]), []
        for place, value in enumerate(self.point.tolist()):
            step = DIFFERENCE * max(abs(value), 1.0)
            moved = self.numbers_at(self.point + step * (np.arange(self.point.size) == place))
            columns.append((np.array([each.value for each in moved]) - here) / step)
        return np.array(columns).T

    @property
    def quantile(self) -> float:
        """Half width of a 95 % interval in standard deviations (Student's t)."""
        return float(interval_factor(max(self.fitted_residuals.size - self.point.size, 1)))

    def beside_stroke_force(self) -> "FrictionFit":
        """Return the fit beside a force along the stroke, such as cogging, if that explains most of the error."""
        waves, seen = Waves.along(self.problem.records), self.problem.observation
        columns = [
            np.hstack([seen.friction(record, wave[:, None])[rows.place] for wave in waves.columns(record)])
            for record, rows in zip(self.problem.records, self.rows, strict=True)
        ]
        residual, per_noise = np.concatenate(self.residuals), self.problem.rows_per_noise
        found = regress(np.concatenate(self.slopes), np.concatenate(columns), residual, 1 / per_noise)
        beside = replace(self, stroke=found)
        return beside if beside.error < MAX_REMAINING_RATIO * self.error else self


def _root_mean_square(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.add.reduce(values**2) / values.size)) if values.size else np.nan


def fit_law(problem: FrictionProblem, model: FrictionModel, max_iterations: int) -> FrictionFit:
    """Return the fit of least squared error near a model; RecordError if the search does not converge.

    Sizes and terms are those of least squares at each shape (variable projection: G. H. Golub and V. Pereyra, SIAM J.
    Numerical Analysis 10(2), 1973, doi:10.1137/0710036).
    """
    found, has_converged = search_shape(problem, model, max_iterations)
    if not has_converged:
        raise RecordError(
            f"friction_identification did not converge in {max_iterations} steps: the record does not suit this law; "
            "raise max_iterations, use fewer elements, or record more speeds"
        )
    return found


def search_shape(problem: FrictionProblem, model: FrictionModel, max_iterations: int) -> tuple[FrictionFit, bool]:
    """Return where a search from a model ends, and whether it has converged."""
    grid = problem.thresholds
    law: LawForces = FreeElements.of(model) if isinstance(model, ElementModel) else WholeLaw.of(model)
    known = [FrictionFit(problem, law)]
    if not law.shape.size:
        return known[0], True

    def at(shape: NDArray[np.float64]) -> FrictionFit:
        if not np.array_equal(known[-1].shape, shape):
            known[:] = [FrictionFit(problem, replace(law, shape=np.array(shape)))]
        return known[-1]

    found, has_converged = minimise(
        lambda shape: at(shape).fitted_residuals,
        law.shape,
        law.bounds((float(grid[0]), float(grid[-1])) if grid.size else (0.0, np.inf)),
        max_iterations,
        lambda shape: at(shape).projected_slopes,
    )
    return at(found), has_converged


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
    fitted = CompressedRows(rows, problem.signed, problem.cycles)
    terms = np.arange(rows[0].columns.shape[1]) < count
    sets = [np.ones_like(terms)] if has_known_thresholds else _nested_sets(fitted, terms)
    coefficients = fitted.solve(_choose_set(sets, rows, problem, fitted, elements))
    kept = coefficients[count:] > 0
    if not kept.any():
        raise RecordError(
            "no friction is identifiable: the force does not follow the motion as friction does; check its sign "
            "(friction acts with the velocity), its channel and the dead time"
        )
    of_grid = kept if has_known_thresholds else (np.convolve(sets[0][count:], [1, 1, 1], "same") > 0) | kept
    chosen, own = problem.thresholds[of_grid], problem.thresholds[kept]
    # an error of an element's threshold appears as a force at its neighbours, and counts as that of the element
    owner = np.argmin(np.abs(np.log(chosen / own[:, None])), axis=0)
    return FrictionFit(problem, rolling_elements(chosen, owner=owner), neighbours=~kept[of_grid])


def grid_error(problem: FrictionProblem) -> float:
    """Return the root mean square error [N] with all elements of the grid."""
    compressed = CompressedRows(_rows(problem), problem.signed, problem.cycles)
    return float(np.sqrt(compressed.mean_square(compressed.solve(np.ones(compressed.size, dtype=bool)))))


def curve_end(problem: FrictionProblem, *, spring_remarks: bool = True) -> tuple[float, list[Finding | str]]:
    """Return the end of the virgin curve [m], which a wide motion hardly resolves, and remarks on a spring."""
    compressed = CompressedRows(_rows(problem), problem.signed, problem.cycles)
    coefficients = compressed.solve(np.ones(compressed.size, dtype=bool))
    remarks = _spring_remarks(problem, compressed.mean_square(coefficients))
    force = coefficients[len(problem.terms) :]
    reached = np.searchsorted(np.cumsum(force), CURVE_END_FORCE * force.sum())
    end = GRID_MARGIN * float(problem.thresholds[min(reached, force.size - 1)])
    return min(end, float(problem.thresholds[-1])), remarks if spring_remarks else []


def _rows(problem: FrictionProblem) -> list[Rows]:
    grid = rolling_elements(problem.thresholds)
    return problem.rows_with([columns_along(grid, record) for record in problem.records])


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
    held_out = CompressedRows(rows, problem.signed, problem.held_out)
    held_out = held_out if held_out.count else fitted
    errors = np.array([held_out.mean_square(fitted.solve(kept)) for kept in sets])
    return sets[int(np.flatnonzero(errors <= errors.min() * (1 + ERROR_TOLERANCE))[-1])]


def _spring_remarks(problem: FrictionProblem, without: float) -> list[Finding | str]:
    """Return a remark if a spring to ground explains a part of the force; RecordError if it explains most of it.

    `without` is the mean squared error without it [N²].
    """
    grid = rolling_elements(problem.thresholds)
    columns = [np.column_stack([columns_along(grid, each), each.displacement]) for each in problem.records]
    compressed = CompressedRows(problem.rows_with(columns), problem.signed, problem.cycles)
    found = compressed.solve(np.ones(compressed.size, dtype=bool))
    stroke = max(float(np.ptp(record.displacement)) for record in problem.records)
    slipping = float(np.sum(found[len(problem.terms) : -1]))
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
