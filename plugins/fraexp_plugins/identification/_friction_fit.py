"""The fit of a law's forces beside the terms: elements on a grid, or any law whose shape is searched."""

from collections.abc import Callable, Sequence
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
from fraexp_plugins.identification._law_comparison import Prediction, best_of
from fraexp_plugins.identification._law_forces import FreeElements, LawForces, WholeLaw, rolling_elements
from fraexp_plugins.identification._law_numbers import Number
from fraexp_plugins.identification._least_squares import derivatives, inverse_square, minimise, solve_non_negative
from fraexp_plugins.identification._usable_records import FORCE_FLOOR, MAX_NOISE_RATIO

LAG_WINDOW = 5.0
"""Lags, in correlation times, over which a residual's autocorrelation is summed (A. D. Sokal, 1997)."""


class CompressedRows:
    """The rows of some cycles, compressed by orthogonal transformations: small, with the same condition number."""

    def __init__(self, rows: Rows, problem: FrictionProblem, chosen: NDArray[np.bool_]) -> None:
        self.free, self.size, self.count = problem.signed, rows.columns.shape[1], int(chosen.sum())
        table = np.column_stack([rows.columns[chosen], rows.force[chosen]])
        self.triangle = np.asarray(np.linalg.qr(np.concatenate([problem.prior_rows(self.size), table]), mode="r"))

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


WAVES = 64
"""Waves of the force along the stroke, the shortest one a sixty-fourth of it."""
PERIOD_RATIO = 1.25
"""Length of the longest wave over the stroke: the force at its ends need not be the same."""


def stroke_waves(records: Sequence[FrictionRecord], rows: Rows) -> NDArray[np.float64]:
    """Return sines and cosines along the stroke in the rows of all records, shape (rows, 4 WAVES).

    They are alike in both directions of the motion, and then with its sign.
    """
    y, velocity = (np.concatenate([getattr(r, name) for r in records]) for name in ("displacement", "velocity"))
    phase = 2 * np.pi * (y - y.min()) / (PERIOD_RATIO * np.ptp(y))
    signs, numbers = (np.ones_like(phase), np.sign(velocity)), range(1, WAVES + 1)
    waves = (sign * function(k * phase) for sign in signs for function in (np.cos, np.sin) for k in numbers)
    return np.column_stack([rows.weights.friction @ wave for wave in waves])  # all at once would fill the memory


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


def regress(
    columns: NDArray[np.float64], waves: NDArray[np.float64], force: NDArray[np.float64], independent: float
) -> Regression:
    """Return the coefficients of the columns by generalised least squares beside random waves.

    Each octave of waves has a variance, which is that of the greatest likelihood of the rows (type II: D. J. C. MacKay,
    Neural Computation 4(3), 1992, doi:10.1162/neco.1992.4.3.415; M. E. Tipping, J. Machine Learning Research 1, 2001).
    What the motion does not separate from the terms, such as a force along a stroke that is always accelerated alike,
    stays in their covariance. `independent` is the part of the rows that is independent of each other.
    """
    count = columns.shape[1]
    scale = np.sqrt(np.add.reduce(columns**2, axis=0) / len(columns))
    table = np.sqrt(independent) * np.column_stack([columns / scale, waves, force])
    triangle = np.asarray(np.linalg.qr(table, mode="r"))
    # below the rows of the terms, waves and force are those that the terms do not explain
    seen, left = triangle[count:, count:-1], triangle[count:, -1]
    gram, moment, square = seen.T @ seen, seen.T @ left, float(left @ left)
    freedom = max(independent * len(force) - count, 1.0)
    octave = np.floor(np.log2(np.arange(1, WAVES + 1))).astype(np.int64)
    octaves = np.concatenate([octave, octave, octave + 1 + octave[-1], octave + 1 + octave[-1]])

    def solve(ratio: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return amplitudes, and their covariance over the variance of a row, for variances over that of a row."""
        root = np.sqrt(ratio)[octaves]
        inverse = root[:, None] * np.linalg.inv(root[:, None] * gram * root + np.eye(root.size)) * root
        return inverse @ moment, inverse

    ratio = np.full(octaves.max() + 1, 1.0 / octaves.size)
    for _ in range(MAX_ITERATIONS):
        amplitudes, inverse = solve(ratio)
        variance = max((square - float(moment @ amplitudes)) / freedom, np.finfo(float).tiny)
        energy = np.bincount(octaves, amplitudes**2) / variance
        known = np.bincount(octaves, 1 - np.diag(inverse) / ratio[octaves])
        updated = np.maximum(energy / np.maximum(known, ROUNDING), ROUNDING)
        change, ratio = np.max(np.abs(np.log(updated / ratio))), updated
        if change < CONVERGED:
            break
    # all of an octave may be in one of its waves: of the waves that the motion hardly separates from the terms the
    # variance decides, so it is that of such a wave
    ratio = ratio * np.bincount(octaves)
    amplitudes, inverse = solve(ratio)
    own, beside = np.linalg.inv(triangle[:count, :count]) / scale[:, None], triangle[:count, count:-1]
    return Regression(
        own @ (triangle[:count, -1] - beside @ amplitudes),
        independent * own @ (np.eye(count) + beside @ inverse @ beside.T) @ own.T,
        waves @ amplitudes,
        float(np.sum(1 - np.diag(inverse) / ratio[octaves])),
    )


MAX_ERROR_RATIO = 0.8
"""Error with a further effect over the one without, up to which it is in the record: a thrust that goes on between
samples, a force along the stroke, a spring. An unknown error of the model correlates the rows, so that no F test tells;
with half of it an effect would have to explain most of the error."""


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

    def _in_rows(self, along: Callable[[FrictionRecord], NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return forces at the samples of each record, shape (n, N), in the rows of all, shape (rows, N)."""
        return np.asarray(self.problem.rows.weights.friction @ np.concatenate([along(r) for r in self.problem.records]))

    @cached_property
    def rows(self) -> Rows:
        """Terms, then the forces, in all records."""
        forces = self._in_rows(lambda record: columns_along(self.forces, record))
        return replace(self.problem.rows, columns=np.hstack([self.problem.rows.columns, forces]))

    @cached_property
    def compressed(self) -> CompressedRows:
        """The rows of the fitted cycles."""
        return CompressedRows(self.rows, self.problem, self.problem.is_fitted)

    @cached_property
    def coefficients(self) -> NDArray[np.float64]:
        """Those of the terms, then the sizes, shape (p,)."""
        used = np.ones(self.compressed.size, dtype=bool)
        if self.neighbours is not None:
            used[len(self.problem.terms) :] = ~self.neighbours
        return self.compressed.solve(used)

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
    def residuals(self) -> NDArray[np.float64]:
        """Measured less modelled force in the rows [N], shape (rows,)."""
        found = self.rows.force - self.rows.columns @ self.coefficients
        return found if self.stroke is None else found - self.slopes @ self.stroke.values - self.stroke.force

    @property
    def fitted_residuals(self) -> NDArray[np.float64]:
        """Those of the fitted cycles [N]."""
        return self.residuals[self.problem.is_fitted]

    @cached_property
    def error(self) -> float:
        """Root mean square error over the cycles that are fitted [N]."""
        return _root_mean_square(self.fitted_residuals)

    @cached_property
    def held_out_error(self) -> float:
        """The same over the cycles that are held out; NaN if there are none."""
        return _root_mean_square(self.residuals[~self.problem.is_fitted])

    @property
    def worst_error(self) -> float:
        """The larger of both errors."""
        return float(np.nanmax([self.error, self.held_out_error]))

    @property
    def prediction(self) -> Prediction:
        """How well it predicts the cycles that are held out."""
        return Prediction(self.worst_error, self.problem.judging_rows, len(self.numbers))

    @cached_property
    def slopes(self) -> NDArray[np.float64]:
        """Derivatives of the modelled force by the shape, then by the coefficients, shape (rows, q + p)."""

        def by_shape(record: FrictionRecord) -> NDArray[np.float64]:
            slopes = self.forces.slopes(partial(columns_along, record=record), self.sizes, DIFFERENCE)
            return np.array(slopes).reshape(-1, record.displacement.size).T

        return np.hstack([self._in_rows(by_shape), self.rows.columns])

    @cached_property
    def prior(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What is known before as rows: their slopes, shape (k, q + p), and deviations [N], shape (k,)."""
        table = self.problem.prior_rows(self.coefficients.size)
        slopes = np.pad(table[:, :-1], ((0, 0), (self.shape.size, 0)))
        return slopes, table[:, -1] - table[:, :-1] @ self.coefficients

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Residuals of the fitted cycles, and deviations from what is known before [N]."""
        return np.append(self.fitted_residuals, self.prior[1])

    @cached_property
    def jacobian(self) -> NDArray[np.float64]:
        """Derivatives of the forces in these rows by shape and coefficients, shape (rows + k, q + p)."""
        return np.concatenate([self.slopes[self.problem.is_fitted], self.prior[0]])

    @property
    def projected_slopes(self) -> NDArray[np.float64]:
        """Derivative of deviations by the shape, with the sizes of least squares at each shape (L. Kaufman, 1975)."""
        slopes, columns = np.split(self.jacobian, [self.shape.size], axis=1)
        used = columns[:, self.coefficients != 0]  # a size that stays at 0 does not follow the shape
        scale = np.linalg.norm(used, axis=0)
        basis, _ = np.linalg.qr(used / np.where(scale > 0, scale, 1.0))
        return np.asarray(basis @ (basis.T @ slopes) - slopes)

    def numbers_at(self, point: NDArray[np.float64]) -> list[Number]:
        """Return the law's numbers, then the terms, at a shape and coefficients."""
        shape, terms, sizes = self._parts(point)
        of_law = replace(self.forces, shape=shape).numbers(sizes)
        found = dict(zip(self.problem.terms, terms.tolist(), strict=True))
        if "dead_time" in found:
            found["dead_time"] += self.problem.observation.later
        return of_law + [Number(name, value, TERM_UNITS[name]) for name, value in found.items()]

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

    @cached_property
    def is_coulomb(self) -> NDArray[np.float64]:
        """Which numbers add up to the force of gross sliding, as 0 and 1: of another law its first force."""
        forces = [each.name for each in self.numbers if each.unit == "N" and each.name not in TERM_UNITS]
        elements = [name for name in forces if name.startswith("limit_force")]
        chosen = elements or [name for name in forces if name == "coulomb_force"] or forces[:1]
        return np.array([each.name in chosen for each in self.numbers], dtype=float)

    @property
    def coulomb_force(self) -> float:
        """Force of gross sliding [N], by which errors are judged; 0 if the record shows no friction."""
        values = np.array([each.value for each in self.numbers])
        return float(self.is_coulomb @ values) if self.sizes.any() else 0.0

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
        found[np.ix_(used, used)] = inverse_square(self.jacobian[:, used])
        return found

    @property
    def white_variance(self) -> float:
        """Variance of a row [N²] times the rows over which noise is correlated, if the residual is noise."""
        residual, per_noise = self.fitted_residuals, self.problem.rows_per_noise
        waves = 0.0 if self.stroke is None else self.stroke.waves * per_noise
        freedom = max(residual.size - self.point.size - waves, 1.0)
        return max(float(residual @ residual) / freedom * per_noise, np.finfo(float).tiny)

    @property
    def variance(self) -> float:
        """Variance of a row [N²] if the rows were independent: with the residual's correlation, and model errors."""
        place = self.problem.rows.record[self.problem.is_fitted]
        residuals = [self.fitted_residuals[place == k] for k in np.unique(place)]
        residuals = [] if self.problem.observation.is_independent else residuals
        count = self.point.size + (0.0 if self.stroke is None else self.stroke.waves * self.problem.rows_per_noise)
        variance = max(long_run_variance(residuals, count), self.white_variance)
        # A model error does not average out: as much of it may be in the parameters as in the residuals, so that the
        # rows count as one for each parameter. One up to the floor is allowed for where noise explains the residual.
        rows = self.fitted_residuals.size / max(self.point.size, 1)
        allowed = np.inf if self.has_model_error else FORCE_FLOOR * self.coulomb_force
        return max(variance, min(self.error, allowed) ** 2 * rows)

    @cached_property
    def point_covariance(self) -> NDArray[np.float64]:
        """Covariance of shape and coefficients: with the residual's correlation, and errors of the model."""
        covariance = self.inverse * self.variance
        if self.stroke is not None:  # what the force along the stroke changes, where it widens the covariance
            plain = np.diag(inverse_square(self.jacobian))
            change = self.stroke.values * np.clip(1 - plain / np.diag(self.stroke.inverse), 0.0, 1.0)
            covariance += np.outer(change, change)
        return covariance

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the numbers."""
        found = self.number_slopes @ self.point_covariance @ self.number_slopes.T
        names = [each.name for each in self.numbers]
        if "mass" in names and self.problem.speed is not None:  # friction jumps at an unknown time while it stands
            place = names.index("mass")
            jump = self.coulomb_force * self.problem.standstill_time / self.problem.speed
            found[place, place] += (jump / NORMAL_QUANTILE) ** 2
        return found

    @cached_property
    def number_slopes(self) -> NDArray[np.float64]:
        """Derivatives of the numbers by shape and coefficients, shape (numbers, q + p)."""
        steps = DIFFERENCE * np.maximum(np.abs(self.point), 1.0)
        return derivatives(lambda at: np.array([each.value for each in self.numbers_at(at)]), self.point, steps)

    @property
    def quantile(self) -> float:
        """Half width of a 95 % interval in standard deviations (Student's t)."""
        return float(interval_factor(max(self.fitted_residuals.size - self.point.size, 1)))

    def half_width(self, weights: NDArray[np.float64]) -> float:
        """Return half of the 95 % interval of a weighted sum of the numbers."""
        return self.quantile * float(np.sqrt(max(float(weights @ self.covariance @ weights), 0.0)))

    def virgin_curve(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the force [N] of a first slow displacement x [m], ascending, and its standard deviation, (n,) each."""
        own = np.delete(np.arange(self.point.size), self.shape.size + np.arange(len(self.problem.terms)))
        return self.forces.virgin_band(x, self.sizes, self.point_covariance[np.ix_(own, own)])

    def beside_stroke_force(self) -> "FrictionFit":
        """Return the fit beside a force along the stroke, such as cogging, if that explains most of the error."""
        waves, best = stroke_waves(self.problem.records, self.rows), self
        for _ in range(MAX_ITERATIONS):
            prior, deviation = best.prior
            every, residual = np.pad(waves, ((0, len(prior)), (0, 0))), replace(best, stroke=None).residuals
            slopes, force = np.concatenate([best.slopes, prior]), np.append(residual, deviation)
            found = regress(slopes, every, force, 1 / self.problem.rows_per_noise)
            beside = replace(best, stroke=found._replace(force=found.force[: residual.size]))
            std = float(np.sqrt(beside.variance))
            if not len(prior) or std > MAX_ERROR_RATIO * best.problem.row_std:
                break
            best = replace(self, problem=replace(self.problem, row_std=std))
        return beside if beside.error < MAX_ERROR_RATIO * self.error else self


def _root_mean_square(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.add.reduce(values**2) / values.size)) if values.size else np.nan


def with_dead_time(problem: FrictionProblem, forces: LawForces) -> FrictionProblem:
    """Return a problem at the dead time that these forces tell, and with the deviation of rows that they leave.

    What is known before of a dead time is compared to that deviation, which begins with the rows alone.
    """
    if "dead_time" not in problem.terms:
        return problem
    problem = replace(problem, row_std=float(np.sqrt(FrictionFit(problem, forces).variance)))
    for _ in range(MAX_ITERATIONS):
        fit = FrictionFit(problem, forces)
        step, std = fit.term("dead_time") - problem.observation.later, float(np.sqrt(fit.variance))
        has_converged = abs(step) < CONVERGED * problem.records[0].sample_time
        if has_converged and MAX_ERROR_RATIO < std / max(problem.row_std, np.finfo(float).tiny) < 1 / MAX_ERROR_RATIO:
            break
        problem = problem.moved(step, std)
    return problem


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
        lambda shape: at(shape).deviations,
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
    grid, count = grid_fit(problem), len(problem.terms)
    fitted = grid.compressed
    terms = np.arange(fitted.size) < count
    sets = [np.ones_like(terms)] if has_known_thresholds else _nested_sets(fitted, terms)
    coefficients = fitted.solve(_choose_set(sets, grid, elements))
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


def grid_fit(problem: FrictionProblem) -> FrictionFit:
    """Return the fit of all elements of the grid."""
    return FrictionFit(problem, rolling_elements(problem.thresholds))


def curve_end(problem: FrictionProblem, *, spring_remarks: bool = True) -> tuple[float, list[Finding | str]]:
    """Return the end of the virgin curve [m], which a wide motion hardly resolves, and remarks on a spring."""
    grid = grid_fit(problem)
    remarks = _spring_remarks(grid)
    reached = np.searchsorted(np.cumsum(grid.sizes), CURVE_END_FORCE * grid.sizes.sum())
    end = GRID_MARGIN * float(problem.thresholds[min(reached, grid.sizes.size - 1)])
    return min(end, float(problem.thresholds[-1])), remarks if spring_remarks else []


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


def _choose_set(sets: Sequence[NDArray[np.bool_]], grid: FrictionFit, elements: int) -> NDArray[np.bool_]:
    """Return the set of so many elements, or the smallest set with the smallest held-out error."""
    if len(sets) == 1:
        return sets[0]
    problem = grid.problem
    if elements:
        sizes = [int(kept.sum()) - len(problem.terms) for kept in sets]
        return next((kept for kept, size in zip(sets, sizes, strict=True) if size <= elements), sets[-1])
    held_out = CompressedRows(grid.rows, problem, problem.is_judge)

    def prediction(kept: NDArray[np.bool_]) -> Prediction:
        error = np.sqrt(held_out.mean_square(grid.compressed.solve(kept)))
        return Prediction(float(error), problem.judging_rows, int(kept.sum()))

    return best_of(sets, prediction)


def _spring_remarks(grid: FrictionFit) -> list[Finding | str]:
    """Return a remark if a spring to ground explains a part of the force; RecordError if it explains most of it."""
    stroke = max(float(np.ptp(record.displacement)) for record in grid.problem.records)
    wide = replace(grid, forces=rolling_elements(np.append(grid.problem.thresholds, stroke)))  # the last never slips
    slipping, spring = float(wide.sizes[:-1].sum()), float(wide.sizes[-1]) / 2
    if spring <= REMARKED_SPRING * slipping or wide.error > MAX_ERROR_RATIO * grid.error:
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
