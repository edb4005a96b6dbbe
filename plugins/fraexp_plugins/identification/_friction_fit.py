"""The fit of a law's forces beside the terms: elements on a grid, or any law whose shape is searched."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    CONVERGED,
    DIFFERENCE,
    MAX_ITERATIONS,
    NORMAL_QUANTILE,
    ROUNDING,
    Finding,
    FrictionModel,
    Motion,
    ParameterError,
    Quantity,
    RecordError,
    interval_factor,
)
from fraexp_plugins.friction._shared.element_model import ElementModel
from fraexp_plugins.identification._friction_rows import TERM_UNITS, FrictionProblem, FrictionRecord, Rows
from fraexp_plugins.identification._law_forces import (
    FreeElements,
    LawForces,
    WholeLaw,
    rolling_elements,
)
from fraexp_plugins.identification._law_numbers import Number
from fraexp_plugins.identification._least_squares import derivatives, inverse_square, minimise, solve_non_negative
from fraexp_plugins.identification._usable_records import FORCE_FLOOR

LAG_WINDOW = 5.0
"""Lags, in correlation times, over which a residual's autocorrelation is summed (A. D. Sokal, 1997)."""


class CompressedRows:
    """The rows of some cycles, compressed by orthogonal transformations: small, with the same condition number."""

    def __init__(self, rows: Sequence[Rows], free: int, cycles: NDArray[np.int64]) -> None:
        self.free = free
        parts, self.count = [], 0
        for each in rows:
            chosen = np.isin(each.cycle, cycles)
            self.count += int(chosen.sum())
            parts.append(np.linalg.qr(np.column_stack([each.columns[chosen], each.force[chosen]]), mode="r"))
        self.triangle = np.asarray(np.linalg.qr(np.concatenate(parts), mode="r"))
        self.size = self.triangle.shape[1] - 1

    def solve(self, used: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the coefficients, shape (p,), of least squared error: those not `used` are 0, those not free ≥ 0."""
        found, free = np.zeros(self.size), int(np.sum(used[: self.free]))
        found[used] = solve_non_negative(self.triangle[:, :-1][:, used], self.triangle[:, -1], free)
        return found

    def mean_square(self, coefficients: NDArray[np.float64]) -> float:
        """Return the mean squared error [N²] of these coefficients."""
        error = self.triangle[:, :-1] @ coefficients - self.triangle[:, -1]
        return float(np.add.reduce(error**2)) / max(self.count, 1)


def long_run_variance(residuals: Sequence[NDArray[np.float64]], parameters: float) -> float:
    """Return the variance of the residuals [N²] times their correlation time in samples, for slowly varying columns."""
    count = sum(each.size for each in residuals)
    squared = sum(float(np.add.reduce(each**2)) for each in residuals)
    if not squared:
        return 0.0
    size = 2 * max(each.size for each in residuals)
    total = np.zeros(size // 2)
    for each in residuals:
        correlation = np.fft.irfft(np.abs(np.fft.rfft(each, size)) ** 2, size)[: each.size]
        total[: each.size] += correlation
    time = 2 * np.cumsum(total / squared) - 1
    enough = np.flatnonzero(np.arange(time.size) >= LAG_WINDOW * time)
    return squared / max(count - parameters, 1) * max(float(time[enough[0]]) if enough.size else 1.0, 1.0)


def misfit_variance(count: int, parameters: int, error: float) -> float:
    """Return the variance [N²] of `count` rows whose root mean square `error` [N] is an error of the model.

    Such an error does not average out: as much of it may be in the parameters as in the residuals, so that the rows
    count as one for each parameter.
    """
    return error**2 * count / max(parameters, 1)


WAVES = 64
"""Waves of the force along the stroke, the shortest one a sixty-fourth of it."""
PERIOD_RATIO = 1.25
"""Length of the longest wave over the stroke: the force at its ends need not be the same."""


class Regression(NamedTuple):
    """The solution of a regression beside an unknown force along the stroke."""

    values: NDArray[np.float64]
    """Coefficients of the columns, shape (p,)."""
    inverse: NDArray[np.float64]
    """Their covariance over the variance of a row, shape (p, p)."""
    force: NDArray[np.float64]
    """The unknown force in each row [N], shape (rows,)."""
    waves: float
    """Number of waves that the rows determine."""


@dataclass(frozen=True)
class Waves:
    """Sines and cosines along the stroke: alike in both directions of the motion, and with its sign."""

    first: float
    """Least position [m]."""
    length: float
    """Length of the longest wave [m]."""

    @classmethod
    def along(cls, records: Sequence[FrictionRecord]) -> "Waves":
        """Return the waves for the stroke of all records."""
        positions = np.concatenate([record.displacement for record in records])
        return cls(float(positions.min()), PERIOD_RATIO * float(np.ptp(positions)))

    def columns(self, record: FrictionRecord) -> Iterator[NDArray[np.float64]]:
        """Yield the waves along a record one by one, each of shape (n,): all of a long record are too much at once."""
        phase = 2 * np.pi * (record.displacement - self.first) / self.length
        for sign in (np.ones_like(phase), np.sign(record.velocity)):
            for function in (np.cos, np.sin):
                for number in range(1, WAVES + 1):
                    yield sign * function(number * phase)

    @staticmethod
    def octaves() -> NDArray[np.int64]:
        """Return the number of the octave of each column, shape (4 WAVES,): each has a variance of its own."""
        octave = np.floor(np.log2(np.arange(1, WAVES + 1))).astype(np.int64)
        both = np.concatenate([octave, octave])
        return np.concatenate([both, both + 1 + int(octave.max())])


def regress(
    columns: NDArray[np.float64], waves: NDArray[np.float64], force: NDArray[np.float64], independent: float
) -> Regression:
    """Return the coefficients of the columns by generalised least squares beside random waves.

    Each octave of waves has a variance, which is that of the greatest likelihood of the rows (type II: D. J. C. MacKay,
    Neural Computation 4(3), 1992, doi:10.1162/neco.1992.4.3.415; M. E. Tipping, J. Machine Learning Research 1, 2001).
    What the motion does not separate from the terms, such as a force along a stroke that is always accelerated alike,
    stays in their covariance. `independent` is the part of the rows that is independent of each other.
    """
    octaves = Waves.octaves()
    scale = np.sqrt(np.add.reduce(columns**2, axis=0) / len(columns))
    table = np.sqrt(independent) * np.column_stack([waves, columns / scale, force])
    triangle = np.asarray(np.linalg.qr(table, mode="r"))
    count = independent * len(force)
    ratio = np.full(octaves.max() + 1, 1.0 / octaves.size)
    for _ in range(MAX_ITERATIONS):
        solution = _solve(triangle, ratio[octaves], columns.shape[1], count)
        updated = _updated(solution, ratio, octaves)
        change = np.max(np.abs(np.log(updated / ratio)))
        ratio = updated
        if change < CONVERGED:
            break
    # all of an octave may be in one of its waves: of the waves that the motion hardly separates from the terms the
    # variance decides, so it is that of such a wave
    ratio = ratio * np.bincount(octaves)
    solution = _solve(triangle, ratio[octaves], columns.shape[1], count)
    return Regression(
        solution.terms / scale,
        independent * solution.inverse / np.outer(scale, scale),
        waves @ solution.amplitudes,
        float(np.sum(1 - solution.spread)),
    )


class _Solution(NamedTuple):
    terms: NDArray[np.float64]
    inverse: NDArray[np.float64]
    """Covariance of the terms over the variance of a row, shape (p, p)."""
    amplitudes: NDArray[np.float64]
    """Amplitudes of the waves [N], shape (q,)."""
    spread: NDArray[np.float64]
    """Their variances after the rows are known, over their variances before, shape (q,)."""
    variance: float
    """Of a row [N²]."""


def _solve(triangle: NDArray[np.float64], ratio: NDArray[np.float64], terms: int, count: float) -> _Solution:
    """Return the solution for waves whose variances are `ratio` times that of a row.

    The waves count as rows of their own, which say that their amplitudes are 0 with a standard deviation of 1.
    """
    size = ratio.size
    scaled = triangle.copy()
    scaled[:, :size] *= np.sqrt(ratio)
    prior = np.eye(size, scaled.shape[1])
    root = np.asarray(np.linalg.qr(np.concatenate([scaled, prior]), mode="r"))
    variance = max(float(root[-1, -1] ** 2) / max(count - terms, 1.0), np.finfo(float).tiny)
    inverse = np.linalg.inv(root[:-1, :-1])
    values = inverse @ root[:-1, -1]
    block = inverse[size:]
    return _Solution(
        values[size:],
        block @ block.T,
        np.sqrt(ratio) * values[:size],
        np.add.reduce(inverse[:size] ** 2, axis=1),
        variance,
    )


def _updated(solution: _Solution, ratio: NDArray[np.float64], octaves: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the next variances of the octaves over that of a row: energy of their waves over how many are known."""
    energy = np.bincount(octaves, solution.amplitudes**2) / solution.variance
    known = np.bincount(octaves, 1 - solution.spread)
    return np.maximum(energy / np.maximum(known, ROUNDING), ROUNDING)


def least_squares(columns: NDArray[np.float64], force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients of the columns, shape (p,)."""
    scale = np.sqrt(np.add.reduce(columns**2, axis=0) / len(columns))
    return np.asarray(np.linalg.lstsq(columns / scale, force, ROUNDING)[0] / scale)


MAX_NOISE_RATIO = 3.0
"""Error over that by the channels' noise up to which noise explains it."""
MAX_ERROR_RATIO = 0.8
"""Error with a further effect over the one without, up to which it is in the record: a thrust that goes on between
samples, a force along the stroke, a spring. An unknown error of the model correlates the rows, so that no F test tells;
with half of it an effect would have to explain most of the error."""
EQUAL_ERROR = 1.01
"""Held-out error over the least one up to which models are equal, and that with the fewest numbers is chosen. Half of
the difference takes an element more now and then."""


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

    def numbers_at(self, point: NDArray[np.float64]) -> list[Number]:
        """Return the law's numbers, then the terms, at a shape and coefficients."""
        shape, terms, sizes = self._parts(point)
        of_law = replace(self.forces, shape=shape).numbers(sizes)
        named = zip(self.problem.terms, terms.tolist(), strict=True)
        return of_law + [Number(name, value, TERM_UNITS[name]) for name, value in named]

    @cached_property
    def numbers(self) -> list[Number]:
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
        residuals = [] if self.problem.observation.is_independent else self.problem.fitted(self.residuals)
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
        steps = DIFFERENCE * np.maximum(np.abs(self.point), 1.0)
        return derivatives(lambda at: np.array([each.value for each in self.numbers_at(at)]), self.point, steps)

    @property
    def quantile(self) -> float:
        """Half width of a 95 % interval in standard deviations (Student's t)."""
        return float(interval_factor(max(self.fitted_residuals.size - self.point.size, 1)))

    def beside_stroke_force(self) -> "FrictionFit":
        """Return the fit beside a force along the stroke, such as cogging, if that explains most of the error."""
        waves = Waves.along(self.problem.records)
        columns = [
            np.column_stack([rows.weights.friction @ wave for wave in waves.columns(record)])
            for record, rows in zip(self.problem.records, self.rows, strict=True)
        ]
        residual, per_noise = np.concatenate(self.residuals), self.problem.rows_per_noise
        found = regress(np.concatenate(self.slopes), np.concatenate(columns), residual, 1 / per_noise)
        beside = replace(self, stroke=found)
        return beside if beside.error < MAX_ERROR_RATIO * self.error else self


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
CURVE_END_FORCE, GRID_MARGIN = 0.98, 1.5
"""Part of the Coulomb force at which the virgin curve ends, and the factor by which the grid extends beyond."""


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
    return sets[int(np.flatnonzero(errors <= errors.min() * EQUAL_ERROR**2)[-1])]


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
    if spring <= REMARKED_SPRING * slipping or compressed.mean_square(found) > MAX_ERROR_RATIO**2 * without:
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
