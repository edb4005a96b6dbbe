"""Mass, Coulomb, viscous and constant friction of a sliding machine, by linear least squares."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, Estimator, Fit, Metric, RecordError, Result, Signals, param
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE, force_over_velocity
from fraexp_plugins.identification.friction._shared.friction_record import (
    HOLD_MEANING,
    FrictionRecord,
    detect_zero_order_hold,
    friction_records,
    quantisation_step,
)
from fraexp_plugins.identification.friction._shared.friction_regression import (
    Observation,
    long_run_variance,
    misfit_variance,
    pseudo_inverse,
)
from fraexp_plugins.identification.friction._shared.friction_report import has_model_error

TERMS = {
    "mass": "kg",
    "Coulomb force": "N",
    "viscous coefficient": "N s/m",
    "offset": "N",
    "viscous asymmetry": "N s/m",
}
"""Identified terms in this order, with their units."""
MIN_SPEED_RATIO = 0.03
"""Slowest over fast sliding, if the study does not give it."""
MIN_STEPS_PER_SAMPLE = 4.0
"""Quantisation steps per sample in the slowest sliding: with fewer steps its direction is uncertain."""
MAX_STANDSTILL_WEIGHT = 1e-3
"""Weight of standstill in a row's low-pass up to which the row counts as sliding."""
MIN_ROWS = 40
"""Rows needed in each direction."""
MIN_MIXED_FRACTION = 0.1
"""Distance from both the held and the interpolated thrust from which a thrust is neither."""
MIN_VARIANCE = 1e-300
"""Variance of residuals that are 0."""
UNKNOWN_THRUST = (
    "the thrust between samples is unknown: neither a hold (zero_order_hold) nor its absence fits, as in a record with "
    "fewer samples than its controller; the intervals are widened: record every sample of the controller"
)
START_FRACTIONS = 0.0, 1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4
"""Parts of a record between which its start may end; the rest of it is fitted."""
MIN_START_RATIO, MIN_NEXT_RATIO = 4.0, 2.0
"""Residual in a part over that in the rest, root mean squares, from which the start is disturbed, and a next part."""
MIN_START_ERROR = 1e-3
"""Residual in the start over the thrust, root mean squares, up to which it may be rounding."""
MIN_START_ROWS = 5
"""Rows of a start of which the residual tells something."""
MIN_SPEED_SPREAD = 1.5
"""Fast over slow sliding from which viscous and Coulomb friction are separated."""


@dataclass(frozen=True)
class _Sliding:
    """The rows of a record in which the machine slides."""

    columns: NDArray[np.float64]
    """Shape (rows, p)."""
    force: NDArray[np.float64]
    """Shape (rows,) [N]."""
    velocity: NDArray[np.float64]
    """Shape (rows,) [m/s]."""
    time: NDArray[np.float64]
    """Time from the record's begin to the first sample that a row contains [s], shape (rows,)."""

    def rows(self, chosen: NDArray[np.bool_]) -> "_Sliding":
        """Return some of the rows."""
        return _Sliding(self.columns[chosen], self.force[chosen], self.velocity[chosen], self.time[chosen])


class _Solution(NamedTuple):
    """The least squares over all records: rows as in `_Sliding`, and their solution."""

    columns: NDArray[np.float64]
    force: NDArray[np.float64]
    velocity: NDArray[np.float64]
    residuals: list[NDArray[np.float64]]
    """Residuals of each record [N]."""
    values: NDArray[np.float64]
    """Values of TERMS, shape (p,)."""
    covariance: NDArray[np.float64]
    """Shape (p, p)."""
    error: float
    """Root mean square residual [N]."""


class SlidingIdentification(Estimator, name="sliding_identification", version=5):
    """u = M a + F_c sgn(v) + D_v v + F_o (+ D_a |v|) by least squares over the time in which the machine slides.

    Any motion in both directions and at several speeds is suitable: moves from point to point, a triangle with sines.
    Thrust and motion are compared after the same low-pass, and only if no standstill is within its length: at a
    standstill friction is any force that holds the machine. M. Gautier and Ph. Poignet, Control Engineering Practice
    9(12), 2001 (inverse model and parallel filtering), doi:10.1016/S0967-0661(01)00087-9. The intervals include the
    correlation of the residuals (A. D. Sokal, 1997). A start of the records, up to a quarter of them, that the model of
    the rest does not explain is left out, and the message says so.

    A mode at f1 adds its part of (max_frequency/f1)² to the mass: set `max_frequency` to a tenth of f1. Half the
    difference of the Coulomb forces of the two directions is part of the offset. Do not use it for motions of the size
    of the presliding deflection (use `rolling_identification`), nor with a Stribeck effect at the speeds of the record.
    """

    renamed: ClassVar[Mapping[str, str]] = {
        "highest": "max_frequency",
        "slowest": "min_sliding_speed",
        "presliding": "presliding_distance",
        "asymmetry": "fit_asymmetry",
        "hold": "zero_order_hold",
    }

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
        min_sliding_speed = self.min_sliding_speed or _min_sliding_speed(records)
        early = {True: 0.0, False: 0.5}  # samples by which the thrust arrives earlier than a held one
        sliding = {hold: self._sliding_rows(records, min_sliding_speed, part) for hold, part in early.items()}
        duration = min(record.displacement.size * record.sample_time for record in records)
        start = _disturbed_start(list(sliding.values()), duration)
        solutions = {
            hold: self._solve(records, _after(rows, start.duration), min_sliding_speed)
            for hold, rows in sliding.items()
        }
        zero_order_hold, remarks = detect_zero_order_hold(
            signals, self.zero_order_hold, lambda zero_order_hold: solutions[zero_order_hold].error
        )
        chosen, other = solutions[zero_order_hold], solutions[not zero_order_hold]
        values, covariance, error = chosen.values, chosen.covariance, chosen.error
        noise = self._observation(records[0], early[zero_order_hold]).noise(records[0], max(values[0], 0.0))
        if values[0] <= 0 or values[1] <= 0:
            raise RecordError(
                f"the mass is {values[0]:.3g} kg and the Coulomb force {values[1]:.3g} N; expected both above 0: check "
                "signs and gains of the channels, the dead times and max_frequency"
            )
        if has_model_error(values[1], error, noise):
            correlated = self._variance(records, chosen.residuals)
            covariance = covariance * max(misfit_variance(chosen.force.size, values.size, error) / correlated, 1.0)
        elif not signals.numerics:
            middle_rows = self._sliding_rows(records, min_sliding_speed, (early[True] + early[False]) / 2)
            middle = self._solve(records, _after(middle_rows, start.duration), min_sliding_speed)
            fraction = _hold_fraction(chosen, other, middle)
            error_by_hold = fraction * (other.values - values)
            covariance = covariance + np.outer(error_by_hold, error_by_hold)
            if MIN_MIXED_FRACTION < fraction < 1 - MIN_MIXED_FRACTION:
                remarks = [UNKNOWN_THRUST]
        return Result(
            signals.outcome,
            "; ".join([*filter(None, (signals.message, start.remark)), *remarks, *_remarks(error, noise, values)]),
            metrics=_metrics(values, covariance, error, chosen.columns),
            curves=(_curve(chosen),),
            fits=(_fit(values, covariance),),
        )

    def _sliding_rows(
        self, records: Sequence[FrictionRecord], min_sliding_speed: float, early: float
    ) -> list[_Sliding]:
        return [self._sliding(record, min_sliding_speed, early) for record in records]

    def _solve(
        self, records: Sequence[FrictionRecord], found: Sequence[_Sliding], min_sliding_speed: float
    ) -> _Solution:
        columns, force = np.concatenate([f.columns for f in found]), np.concatenate([f.force for f in found])
        velocity = np.concatenate([f.velocity for f in found])
        _check(velocity, min_sliding_speed)
        values, inverse = _least_squares(columns, force)
        residuals = [f.force - f.columns @ values for f in found]
        covariance = inverse * self._variance(records, residuals)
        error = float(np.sqrt(np.add.reduce(np.concatenate(residuals) ** 2) / force.size))
        return _Solution(columns, force, velocity, residuals, values, covariance, error)

    def _variance(self, records: Sequence[FrictionRecord], residuals: Sequence[NDArray[np.float64]]) -> float:
        """Return the variance of the residuals [N²] times their correlation time in rows."""
        count = len(TERMS) if self.fit_asymmetry else len(TERMS) - 1
        return max(long_run_variance(residuals, count), self._filtered_variance(records[0], residuals), MIN_VARIANCE)

    def _observation(self, record: FrictionRecord, early: float) -> Observation:
        """Return the observation of a thrust that arrives so many samples earlier than a held one."""
        delay = self.input_dead_time + self.output_dead_time - early * record.sample_time
        return Observation(inertia=True, delay=delay, max_frequency=self.max_frequency)

    def _filtered_variance(self, record: FrictionRecord, residuals: Sequence[NDArray[np.float64]]) -> float:
        """Return the variance of the residuals [N²] times their correlation time in rows by the low-pass.

        White noise after a Gaussian of standard deviation s is correlated over 2 √π s. Rows that a standstill separates
        do not show this correlation.
        """
        std = np.sqrt(np.log(2)) / (2 * np.pi * self.max_frequency)
        first, second = Observation(inertia=True, max_frequency=self.max_frequency).rows(record, 0)[:2]
        squares = np.concatenate(residuals) ** 2
        mean_square = float(np.add.reduce(squares)) / squares.size
        return mean_square * max(2 * np.sqrt(np.pi) * std / ((second - first) * record.sample_time), 1.0)

    def _sliding(self, record: FrictionRecord, min_sliding_speed: float, early: float) -> _Sliding:
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
        return _Sliding(columns, observation.force(record)[:, 0], velocity, time).rows(sliding)


class _Start(NamedTuple):
    """The beginning of the records that is left out."""

    duration: float
    """Its duration [s]."""
    remark: str


def _least_squares(
    columns: NDArray[np.float64], force: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the coefficients of the columns, shape (p,), and (AᵀA)⁻¹, shape (p, p)."""
    scale = np.sqrt(np.add.reduce(columns**2, axis=0) / len(columns))
    root = pseudo_inverse(columns / scale)
    return root @ (root.T @ ((columns / scale).T @ force)) / scale, (root @ root.T) / np.outer(scale, scale)


def _after(found: Sequence[_Sliding], time: float) -> list[_Sliding]:
    """Return the rows that contain no sample before a time [s]."""
    return [each.rows(each.time >= time) for each in found]


def _disturbed_start(assumptions: Sequence[Sequence[_Sliding]], duration: float) -> _Start:
    """Return the beginning of the records that the model of the rest does not explain; 0 s if it explains all.

    After a jump of the reference, a transient of the drive or of a mode, the beginning differs from the rest. The rows
    come once for each of several assumptions on the thrust, of which the one counts that fits better. One part more is
    left out than differs clearly, because such a transient decays.
    """
    limits = duration * np.array(START_FRACTIONS)
    rest, ratios = min((_start_ratios(rows, limits) for rows in assumptions), key=lambda found: found[0])
    if not np.isfinite(rest) or max(ratios) < MIN_START_RATIO:
        return _Start(0.0, "")
    last = int(np.flatnonzero(np.array(ratios) > MIN_NEXT_RATIO)[-1])
    end = float(limits[min(last + 2, limits.size - 1)])
    return _Start(
        end,
        f"the first {end:.3g} s are left out, because their error is up to {max(ratios):.2g} times that of the rest, "
        "as after a jump of the reference; to choose that time yourself set skip_time in [record] (--skip-time)",
    )


def _start_ratios(found: Sequence[_Sliding], limits: NDArray[np.float64]) -> tuple[float, list[float]]:
    """Return the root mean square residual [N] after the last limit [s], and those between the limits over it."""
    rest = _after(found, float(limits[-1]))
    columns, force = np.concatenate([f.columns for f in rest]), np.concatenate([f.force for f in rest])
    if min(np.sum(columns[:, 1] > 0), np.sum(columns[:, 1] < 0)) < MIN_ROWS:
        return np.inf, [0.0]
    values, _ = _least_squares(columns, force)
    error = _root_mean_square(force - columns @ values)
    time = np.concatenate([f.time for f in found])
    residual = np.concatenate([f.force - f.columns @ values for f in found])
    parts = [residual[(time >= low) & (time < high)] for low, high in itertools.pairwise(limits)]
    sizes = [_root_mean_square(part) if part.size >= MIN_START_ROWS else 0.0 for part in parts]
    least = MIN_START_ERROR * _root_mean_square(force)
    return error, [size / error if size > least and error else 0.0 for size in sizes]


def _root_mean_square(values: NDArray[np.float64]) -> float:
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
            f"the machine slides faster than {min_sliding_speed:.3g} m/s for {rows} rows in one direction; expected "
            f"{MIN_ROWS}: record longer moves back and forth, raise max_frequency or lower min_sliding_speed"
        )
    slow, fast = np.percentile(np.abs(velocity), [10, 90])
    if fast < MIN_SPEED_SPREAD * slow:
        raise RecordError(
            f"all sliding is at {slow:.3g} to {fast:.3g} m/s; expected several speeds, to separate viscous friction, "
            "Coulomb friction and the mass"
        )


def _hold_fraction(chosen: _Solution, other: _Solution, middle: _Solution) -> float:
    """Return where the thrust lies between two assumptions, 0 to 1, by the parabola of the squared error."""
    first, half, last = (solution.error**2 for solution in (chosen, middle, other))
    curvature = first - 2 * half + last
    return float(np.clip((3 * first - 4 * half + last) / (4 * curvature), 0, 1)) if curvature > 0 else 0.5


def _remarks(error: float, noise: float, values: NDArray[np.float64]) -> list[str]:
    if values[2] < 0:
        return [
            "friction falls with the velocity: a Stribeck effect or a wrong dead time; fit a law with a Stribeck effect"
        ]
    if not has_model_error(values[1], error, noise):
        return []
    return [
        f"the error is {error / values[1]:.0%} of the Coulomb force, of which noise explains {noise / values[1]:.1g}: "
        "the intervals are widened, but may not cover the true values; possible causes: another force, a Stribeck "
        "effect, a mode below ten times max_frequency, a position that was not measured, or a wrong gain or dead time; "
        "see the curve 'force over velocity'"
    ]


def _metrics(
    values: NDArray[np.float64], covariance: NDArray[np.float64], error: float, columns: NDArray[np.float64]
) -> tuple[Metric, ...]:
    half_widths = NORMAL_QUANTILE * np.sqrt(np.diag(covariance))
    found: list[Metric] = []
    for (name, unit), value, half in zip(TERMS.items(), values, half_widths, strict=False):  # offset last
        found += [Metric(name, float(value), unit), Metric(f"{name}, 95 %", float(half), unit)]
    return (*found, Metric("rms error", error, "N"), Metric("rows", float(len(columns)), "1"))


def _curve(solution: _Solution) -> Curve:
    """Return the law at the velocity of each row, a straight line for each direction, and the residuals around it.

    The filtered sign of a row also depends on what was before it: drawn over velocity it would make the line jagged.
    """
    velocity = solution.velocity
    steady = np.column_stack([np.sign(velocity), velocity, np.ones_like(velocity), np.abs(velocity)])
    law = steady[:, : len(solution.values) - 1] @ solution.values[1:]
    return force_over_velocity(velocity, law + solution.force - solution.columns @ solution.values, law)


def _fit(values: NDArray[np.float64], covariance: NDArray[np.float64]) -> Fit:
    model = Coulomb(coulomb_force=float(values[1]), viscous_coefficient=max(float(values[2]), 0.0))
    names, units = ("coulomb_force", "viscous_coefficient"), ("N", "N s/m")
    return Fit("friction", model.spec(), names, units, values[1:3], covariance[1:3, 1:3])
