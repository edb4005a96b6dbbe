"""Mass, Coulomb, viscous and constant friction of a sliding machine, by linear least squares."""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, Estimator, Finding, Metric, Quantity, RecordError, Result, Signals, param, remarks
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE, force_over_velocity
from fraexp_plugins.identification.friction._friction_record import (
    HOLD_MEANING,
    FrictionRecord,
    detect_zero_order_hold,
    friction_records,
    quantisation_step,
)
from fraexp_plugins.identification.friction._friction_regression import (
    Observation,
    long_run_variance,
    misfit_variance,
)
from fraexp_plugins.identification.friction._friction_report import has_model_error
from fraexp_plugins.identification.friction._sliding_rows import (
    MIN_ROWS,
    Regression,
    SlidingRows,
    Waves,
    coulomb_fit,
    disturbed_start,
    least_squares,
    regress,
    rows_after,
)

TERMS = {
    "mass": "kg",
    "Coulomb force": "N",
    "viscous coefficient": "N s/m",
    "offset": "N",
    "viscous asymmetry": "N s/m",
}
"""Identified terms in this order, with their units."""
HELD, EVEN = 0.0, 0.5
"""Samples by which a thrust arrives earlier than a held one: one that is held, and one that is not."""
MAX_REMAINING_RATIO = 0.7
"""Error with a force along the stroke over the one without, up to which that force is fitted."""
MIN_SPEED_RATIO = 0.03
"""Slowest over fast sliding, if the study does not give it."""
MIN_STEPS_PER_SAMPLE = 4.0
"""Quantisation steps per sample in the slowest sliding: with fewer steps its direction is uncertain."""
MAX_STANDSTILL_WEIGHT = 1e-3
"""Weight of standstill in a row's low-pass up to which the row counts as sliding."""
MIN_MIXED_FRACTION = 0.1
"""Distance from both the held and the interpolated thrust from which a thrust is neither."""
MIN_VARIANCE = 1e-300
"""Variance of residuals that are 0."""
UNKNOWN_THRUST = (
    "the thrust between samples is unknown: neither a hold (zero_order_hold) nor its absence fits, as in a record with "
    "fewer samples than its controller; the intervals are widened: record every sample of the controller"
)
MIN_SPEED_SPREAD = 1.5
"""Fast over slow sliding from which viscous and Coulomb friction are separated."""


class _Solution(NamedTuple):
    """The least squares over all records: rows as in `SlidingRows`, and their solution."""

    columns: NDArray[np.float64]
    force: NDArray[np.float64]
    velocity: NDArray[np.float64]
    residuals: list[NDArray[np.float64]]
    """Residuals of each record [N]."""
    values: NDArray[np.float64]
    """Values of TERMS, shape (p,)."""
    inverse: NDArray[np.float64]
    """Covariance of the values over the variance of the residuals, shape (p, p)."""
    variance: float
    """Variance of the residuals times their correlation time in rows [N²]."""
    white_variance: float
    """The same if the residuals are white but for the low-pass [N²]: it gives the Cramér-Rao bound."""
    doubt: NDArray[np.float64]
    """Change of the values by a force along the stroke, as far as that takes the information on them, shape (p,)."""
    error: float
    """Root mean square residual [N]."""
    stroke_force: float = 0.0
    """Root mean square force that depends on the position [N]; 0 if none is fitted."""


class _Task(NamedTuple):
    """What is solved: records, and which of their rows."""

    records: Sequence[FrictionRecord]
    min_sliding_speed: float
    """Speed from which the machine slides [m/s]."""
    skipped: float = 0.0
    """Start of the records that is left out [s]."""
    waves: Waves | None = None
    """Waves of a force along the stroke that is fitted too."""


class SlidingIdentification(Estimator, name="sliding_identification", version=5):
    """u = M a + F_c sgn(v) + D_v v + F_o (+ D_a |v|) by least squares over the time in which the machine slides.

    Any motion in both directions and at several speeds is suitable: moves from point to point, a triangle with sines.
    Thrust and motion are compared after the same low-pass, and only if no standstill is within its length: at a
    standstill friction is any force that holds the machine. M. Gautier and Ph. Poignet, Control Engineering Practice
    9(12), 2001 (inverse model and parallel filtering), doi:10.1016/S0967-0661(01)00087-9. The intervals include the
    correlation of the residuals (A. D. Sokal, 1997). A start of the records, up to a quarter of them, that the model of
    the rest does not explain is left out, and the message says so.

    If the terms leave more than noise explains, a force along the stroke, such as cogging or the ripple of a screw, is
    fitted beside them, one for both directions and one with the sign of the motion; it stays if it explains most of
    the rest. Where all moves are alike, such a force looks like a term; what it changes is then a part of the interval.
    The metric 'Cramér-Rao bound' is the least 95 % interval of the viscous coefficient that an unbiased estimator has
    with residuals of that size. An interval near it leaves nothing of the record unused: only another record (longer,
    faster, less noise) can narrow it.

    A mode at f1 adds its part of (max_frequency/f1)² to the mass: set `max_frequency` to a tenth of f1. Half the
    difference of the Coulomb forces of the two directions is part of the offset. Do not use it for motions of the size
    of the presliding deflection (use `friction_identification`), nor with a Stribeck effect at the record's speeds.
    """

    displacement: str = param("", "channel of the position", "y")
    thrust: str = param("", "channel of the thrust", "u")
    acceleration: str = param("", "channel of a measured acceleration; differences of the position if empty", "")
    max_frequency: float = param("Hz", "frequency up to which thrust and motion are compared", 15.0, above=0)
    min_sliding_speed: float = param(
        "m/s", "speed from which the machine counts as sliding; chosen from the motion if 0", 0.0, at_least=0
    )
    presliding_distance: float = param(
        "m", "travel after each reversal that is left out, because friction rises there", 0.0, at_least=0
    )
    fit_asymmetry: bool = param("", "whether viscous friction may differ by direction: a force D_a |v|", False)
    zero_order_hold: bool | None = param("", HOLD_MEANING, None)
    input_dead_time: float = param("s", "dead time of the thrust", 0.0, at_least=0, inherit="loop.input_dead_time")
    output_dead_time: float = param("s", "dead time of the position", 0.0, at_least=0, inherit="loop.output_dead_time")

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "the stepped sine with which it is tried here moves a machine without friction back and forth, at one speed",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return mass, forces and coefficients with 95 % intervals, the forces over velocity, and a Coulomb model."""
        records = friction_records(signals, self.displacement, self.thrust, self.acceleration)
        task = _Task(records, self.min_sliding_speed or _min_sliding_speed(records))
        duration = min(record.displacement.size * record.sample_time for record in records)
        start = disturbed_start([self._rows(task, early) for early in (HELD, EVEN)], duration)
        task = task._replace(skipped=start.duration)
        solutions = self._solutions(task)
        if self._has_model_error(task, min(solutions.values(), key=lambda solution: solution.error)):
            task, solutions = self._beside_waves(task, solutions)
        zero_order_hold, hold = detect_zero_order_hold(
            signals, self.zero_order_hold, lambda zero_order_hold: solutions[zero_order_hold].error
        )
        chosen, other = solutions[zero_order_hold], solutions[not zero_order_hold]
        values, covariance = chosen.values, chosen.inverse * chosen.variance + np.outer(chosen.doubt, chosen.doubt)
        if values[0] <= 0 or values[1] <= 0:
            raise RecordError(
                "the mass is ",
                Quantity(values[0], "kg"),
                " and the Coulomb force ",
                Quantity(values[1], "N"),
                "; expected both above 0: check signs and gains of the channels, the dead times and max_frequency",
            )
        if self._has_model_error(task, chosen):
            misfit = misfit_variance(chosen.force.size, values.size, chosen.error)
            covariance = covariance + chosen.inverse * max(misfit - chosen.variance, 0.0)
        elif not signals.numerics:
            fraction = _hold_fraction(chosen, other, self._solve(task, (HELD + EVEN) / 2))
            error_by_hold = fraction * (other.values - values)
            covariance = covariance + np.outer(error_by_hold, error_by_hold)
            if MIN_MIXED_FRACTION < fraction < 1 - MIN_MIXED_FRACTION:
                hold = [UNKNOWN_THRUST]
        return Result(
            signals.outcome,
            (*signals.findings, *remarks(start.remark, *hold, *_remarks(chosen, self._noise(task, chosen)))),
            metrics=_metrics(chosen, covariance),
            curves=(_curve(chosen),),
            fits=(coulomb_fit(values, covariance),),
        )

    def _solutions(self, task: _Task) -> dict[bool, _Solution]:
        """Return the solution for a held thrust, and for one that is not."""
        return {True: self._solve(task, HELD), False: self._solve(task, EVEN)}

    def _beside_waves(self, task: _Task, plain: dict[bool, _Solution]) -> tuple[_Task, dict[bool, _Solution]]:
        """Return task and solutions with a force along the stroke if it explains most of the error, or as they are."""
        beside = task._replace(waves=Waves.along(task.records))
        solutions = self._solutions(beside)
        errors = [min(solution.error for solution in each.values()) for each in (solutions, plain)]
        return (beside, solutions) if errors[0] < MAX_REMAINING_RATIO * errors[1] else (task, plain)

    def _has_model_error(self, task: _Task, solution: _Solution) -> bool:
        return has_model_error(solution.values[1], solution.error, self._noise(task, solution))

    def _noise(self, task: _Task, solution: _Solution) -> float:
        """Return the error of a row [N] by white noise of the channels."""
        return self._observation(task.records[0], HELD).noise(task.records[0], max(solution.values[0], 0.0))

    def _rows(self, task: _Task, early: float) -> list[SlidingRows]:
        found = [self._sliding(record, task.min_sliding_speed, early) for record in task.records]
        return rows_after(found, task.skipped)

    def _solve(self, task: _Task, early: float) -> _Solution:
        """Return the solution for a thrust that arrives so many samples earlier than a held one."""
        found = self._rows(task, early)
        columns, force = np.concatenate([f.columns for f in found]), np.concatenate([f.force for f in found])
        velocity = np.concatenate([f.velocity for f in found])
        _check(velocity, task.min_sliding_speed)
        fit = plain = Regression(*least_squares(columns, force), np.zeros_like(force), 0.0)
        if task.waves:
            waves = [self._wave_columns(*pair, task.waves, early) for pair in zip(task.records, found, strict=True)]
            fit = regress(columns, np.concatenate(waves), force, 1 / self._rows_per_noise(task))
        remainders = np.split(force - fit.force, np.cumsum([f.force.size for f in found])[:-1])
        residuals = [rest - f.columns @ fit.values for rest, f in zip(remainders, found, strict=True)]
        count = columns.shape[1] + fit.waves * self._rows_per_noise(task)
        white = self._white_variance(task, residuals, count)
        return _Solution(
            columns,
            force - fit.force,
            velocity,
            residuals,
            fit.values,
            inverse=fit.inverse,
            variance=max(long_run_variance(residuals, count), white),
            white_variance=white,
            doubt=(fit.values - plain.values) * _lost_information(plain.inverse, fit.inverse),
            error=_root_mean_square(residuals),
            stroke_force=float(np.std(fit.force)),
        )

    def _wave_columns(
        self, record: FrictionRecord, found: SlidingRows, waves: Waves, early: float
    ) -> NDArray[np.float64]:
        """Return the columns of a force along the stroke in the rows of a record, shape (rows, q)."""
        observation = self._observation(record, early)
        return np.concatenate(
            [observation.friction(record, wave[:, None])[found.row] for wave in waves.columns(record)], axis=1
        )

    def _white_variance(self, task: _Task, residuals: Sequence[NDArray[np.float64]], parameters: float) -> float:
        """Return the variance of the residuals [N²] times the rows over which the low-pass correlates white noise."""
        size = sum(each.size for each in residuals)
        squared = _root_mean_square(residuals) ** 2 * size
        return max(squared / max(size - parameters, 1.0) * self._rows_per_noise(task), MIN_VARIANCE)

    def _observation(self, record: FrictionRecord, early: float) -> Observation:
        """Return the observation of a thrust that arrives so many samples earlier than a held one."""
        delay = self.input_dead_time + self.output_dead_time - early * record.sample_time
        return Observation(inertia=True, delay=delay, max_frequency=self.max_frequency)

    def _rows_per_noise(self, task: _Task) -> float:
        """Return over how many rows the low-pass correlates white noise.

        White noise after a Gaussian of standard deviation s is correlated over 2 √π s. Rows that a standstill separates
        do not show this correlation.
        """
        record = task.records[0]
        std = np.sqrt(np.log(2)) / (2 * np.pi * self.max_frequency)
        first, second = self._observation(record, HELD).rows(record, 0)[:2]
        return float(max(2 * np.sqrt(np.pi) * std / ((second - first) * record.sample_time), 1.0))

    def _sliding(self, record: FrictionRecord, min_sliding_speed: float, early: float) -> SlidingRows:
        observation = self._observation(record, early)
        v = record.velocity()
        excluded = (np.abs(v) < min_sliding_speed) | (
            _travel_since_reversal(record.displacement, v) < self.presliding_distance
        )
        standstill = observation.friction(record, excluded.astype(float)[:, None])[:, 0]
        plain = [np.sign(v), v, np.ones_like(v), *([np.abs(v)] if self.fit_asymmetry else [])]
        columns = np.column_stack(
            [observation.acceleration(record), observation.friction(record, np.column_stack(plain))]
        )
        sliding = standstill < MAX_STANDSTILL_WEIGHT
        velocity = observation.friction(record, v[:, None])[:, 0]
        samples = observation.rows(record, 0)
        time = (samples - samples[0]) * record.sample_time
        row = np.arange(samples.size)
        return SlidingRows(columns, observation.force(record)[:, 0], velocity, time, row).select(sliding)


def _lost_information(plain: NDArray[np.float64], beside: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part of the information on each value that unknown forces beside the terms take, shape (p,).

    It is near 1 where all moves are alike, so that a force along the stroke looks like a term, and small otherwise.
    """
    return np.clip(1 - np.diag(plain) / np.diag(beside), 0.0, 1.0)


def _root_mean_square(residuals: Sequence[NDArray[np.float64]]) -> float:
    values = np.concatenate(residuals)
    return float(np.sqrt(np.add.reduce(values**2) / values.size))


def _min_sliding_speed(records: Sequence[FrictionRecord]) -> float:
    """Return the speed [m/s] from which the direction of the motion is certain."""
    speeds = np.abs(np.concatenate([record.velocity() for record in records]))
    step = quantisation_step(list(records)) / records[0].sample_time
    return max(MIN_SPEED_RATIO * float(np.percentile(speeds, 95)), MIN_STEPS_PER_SAMPLE * step)


def _travel_since_reversal(displacement: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the travel of each sample since the last reversal [m], shape (n,)."""
    turned = np.diff(np.sign(velocity), prepend=np.sign(velocity[0])) != 0
    turned[0] = True  # the motion before is unknown
    last = np.maximum.accumulate(np.where(turned, np.arange(velocity.size), 0))
    return np.abs(displacement - displacement[last])


def _check(velocity: NDArray[np.float64], min_sliding_speed: float) -> None:
    """Raise RecordError unless the machine slides in both directions and at several speeds."""
    rows = min(int(np.sum(velocity > 0)), int(np.sum(velocity < 0)))
    if rows < MIN_ROWS:
        raise RecordError(
            "the machine slides faster than ",
            Quantity(min_sliding_speed, "m/s"),
            f" for {rows} rows in one direction; expected {MIN_ROWS}: record longer moves back and forth, "
            "raise max_frequency or lower min_sliding_speed",
        )
    slow, fast = np.percentile(np.abs(velocity), [10, 90])
    if fast < MIN_SPEED_SPREAD * slow:
        raise RecordError(
            f"all sliding is at {slow:.3g} to ",
            Quantity(fast, "m/s"),
            "; expected several speeds, to separate viscous friction, Coulomb friction and the mass",
        )


def _hold_fraction(chosen: _Solution, other: _Solution, middle: _Solution) -> float:
    """Return where the thrust lies between two assumptions, 0 to 1, by the parabola of the squared error."""
    first, half, last = (solution.error**2 for solution in (chosen, middle, other))
    curvature = first - 2 * half + last
    return float(np.clip((3 * first - 4 * half + last) / (4 * curvature), 0, 1)) if curvature > 0 else 0.5


def _remarks(solution: _Solution, noise: float) -> list[Finding | str]:
    error, coulomb = solution.error, solution.values[1]
    if solution.values[2] < 0:
        return [
            "friction falls with the velocity: a Stribeck effect or a wrong dead time; fit a law with a Stribeck effect"
        ]
    found: list[Finding | str] = []
    if solution.stroke_force:
        text = (
            "a force along the stroke, such as cogging or the ripple of a screw, is fitted too; the offset contains "
            "its mean"
        )
        found.append(Finding("remark", (Quantity(solution.stroke_force, "N", "rms"),), text=text))
    if has_model_error(coulomb, error, noise):
        found.append(
            f"the error is {error / coulomb:.0%} of the Coulomb force, of which noise explains {noise / coulomb:.1g}: "
            "the intervals are widened, but may not cover the true values; possible causes: another force, a Stribeck "
            "effect, a mode below ten times max_frequency, a position that was not measured, or a wrong gain or dead "
            "time; see the curve 'force over velocity'"
        )
    return found


def _metrics(solution: _Solution, covariance: NDArray[np.float64]) -> tuple[Metric, ...]:
    half_widths, bounds = (
        NORMAL_QUANTILE * np.sqrt(np.diag(each)) for each in (covariance, solution.inverse * solution.white_variance)
    )
    found: list[Metric] = []
    for (name, unit), value, half in zip(TERMS.items(), solution.values, half_widths, strict=False):  # offset last
        found += [Metric(name, float(value), unit), Metric(f"{name}, 95 %", float(half), unit)]
    bound = Metric("viscous coefficient, 95 %, Cramér-Rao bound", float(bounds[2]), TERMS["viscous coefficient"])
    along = [Metric("force along the stroke, rms", solution.stroke_force, "N")] if solution.stroke_force else []
    rows = Metric("rows", float(len(solution.columns)), "1")
    return (*found, bound, *along, Metric("rms error", solution.error, "N"), rows)


def _curve(solution: _Solution) -> Curve:
    """Return the law at the velocity of each row, a straight line for each direction, and the residuals around it.

    The filtered sign of a row also depends on what was before it: drawn over velocity it would make the line jagged.
    """
    velocity = solution.velocity
    steady = np.column_stack([np.sign(velocity), velocity, np.ones_like(velocity), np.abs(velocity)])
    law = steady[:, : len(solution.values) - 1] @ solution.values[1:]
    return force_over_velocity(velocity, law + solution.force - solution.columns @ solution.values, law)
