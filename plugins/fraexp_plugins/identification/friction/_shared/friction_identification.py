"""The base of estimators that identify friction: channels, thresholds, terms, held-out cycles, remarks."""

from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Estimator, ParameterError, RecordError, Signals, param
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE
from fraexp_plugins.identification._shared.stop_operator import stop_operators, turning_points
from fraexp_plugins.identification.friction._shared.friction_record import (
    HOLD_MEANING,
    FrictionRecord,
    detect_zero_order_hold,
    friction_records,
    quantisation_step,
)
from fraexp_plugins.identification.friction._shared.friction_regression import (
    SIGNED_TERMS,
    CompressedRows,
    Observation,
    RegressionRows,
    long_run_variance,
    misfit_variance,
    regression_rows,
)
from fraexp_plugins.identification.friction._shared.friction_report import (
    Errors,
    ReportedElements,
    has_model_error,
    model_error_remarks,
)

MAX_THRESHOLD_RATIO = 0.35
"""Largest threshold over the stroke: an element that hardly slips is a slow rise of the force with any cause."""
MIN_SPEED_RATIO = 1.5
"""Fast over slow sliding from which viscous and Coulomb friction are separated."""
STANDSTILL_SPEED_RATIO = 0.3
"""Speed over that of sliding below which the machine turns: a jump of friction looks like inertia there."""
MIN_THRESHOLD_STEPS, MAX_THRESHOLD_SPAN, MAX_SEARCH_SPAN = 0.5, 300.0, 1e5
"""Smallest threshold in quantisation steps (below one step an element acts as Coulomb friction), and the ratio of the
largest to the smallest threshold, and that while the end of the virgin curve is searched: a drive's stroke is thousands
of times its presliding deflection."""
MIN_DEFLECTION_STEPS = 10.0
"""Quantisation steps that the presliding deflection should have."""
MIN_REVERSALS = 3
"""Reversals from which friction is separated from other forces."""
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
    remarks: tuple[str, ...]
    speed: float | None = None
    """The speed of all sliding [m/s] if there is only one."""

    def rows(self, thresholds: NDArray[np.float64]) -> list[RegressionRows]:
        """Return the rows of all records for elements with these thresholds [m], shape (N,)."""
        elements = [self.deflections(record, thresholds) for record in self.records]
        return self.rows_with(elements)

    def deflections(self, record: FrictionRecord, thresholds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the elements' deflections [m] along a record, shape (n, N)."""
        motion = np.concatenate([record.before, record.displacement])
        return stop_operators(motion, thresholds)[record.before.size :]

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
                f"the motion never spans twice the largest threshold, {max_threshold:.3g} m, for long enough; record "
                "more cycles with gross sliding, or lower max_threshold"
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

    def errors(self, rows: Sequence[RegressionRows], coefficients: NDArray[np.float64]) -> Errors:
        """Return the errors of a linear model."""
        return self.errors_from_residuals(rows, [each.force - each.columns @ coefficients for each in rows])

    def errors_from_residuals(self, rows: Sequence[RegressionRows], residuals: Sequence[NDArray[np.float64]]) -> Errors:
        """Return the errors from the residuals [N] of each record."""
        labels = np.concatenate([each.cycle for each in rows])
        squared = np.concatenate(residuals) ** 2
        held = np.isin(labels, self.held_out)
        parts = [squared[~held], squared[held]]
        fitted, held_out = (float(np.sqrt(np.add.reduce(p) / p.size)) if p.size else np.nan for p in parts)
        return Errors(fitted, held_out, residuals)


class FrictionIdentification(Estimator, ABC):
    """An estimator that identifies friction from a record of displacement and force, or of thrust and position.

    With `thrust` the friction is the thrust less the inertia of the moving mass, f = u - M a, and the mass is fitted in
    the same regression (J. Swevers, F. Al-Bender, C. Ganseman and T. Prajogo, IEEE Trans. Automatic Control 45(4),
    2000, doi:10.1109/9.847103). Thrust and motion are compared up to `max_frequency`: a mode at f1 adds its part of
    (max_frequency/f1)² to the mass, so set it to a tenth of the first mode. If friction jumps at a reversal, between
    samples, the mass includes that jump times a delay of up to one sample: sample fast, or reverse rarely. A constant
    offset is fitted too. Besides a bias it contains half the difference of the Coulomb forces of the two directions,
    because an element with unequal limits is one with equal limits and a bias.
    """

    displacement: str = param("", "channel of the displacement", "displacement")
    force: str = param("", "channel of the friction force, if it is measured", "friction")
    thrust: str = param("", "channel of the thrust that moves mass and friction, in place of `force`", "")
    acceleration: str = param("", "channel of a measured acceleration; differences of the displacement if empty", "")
    max_frequency: float = param("Hz", "frequency up to which thrust and motion are compared", 5.0, above=0)
    zero_order_hold: bool | None = param("", HOLD_MEANING, None)
    input_dead_time: float = param("s", "dead time of the thrust", 0.0, at_least=0, inherit="loop.input_dead_time")
    input_time_constants: tuple[float, ...] = param(
        "s", "time constants of the thrust's first-order lags", (), inherit="loop.input_time_constants"
    )
    output_dead_time: float = param("s", "dead time of the position", 0.0, at_least=0, inherit="loop.output_dead_time")
    output_time_constants: tuple[float, ...] = param(
        "s", "time constants of the position's first-order lags", (), inherit="loop.output_time_constants"
    )
    resolution: float = param(
        "m", "quantisation step of the encoder; detected in the record if 0", 0.0, at_least=0, inherit="loop.resolution"
    )
    fit_offset: bool = param("", "whether a constant force is fitted", True)
    fit_asymmetry: bool = param("", "whether viscous friction may differ by direction: a force D_a |v|", False)
    viscous_coefficient: float | None = param(
        "N s/m", "viscous coefficient D_v if it is known; otherwise fitted if the velocity varies", None, at_least=0
    )
    thresholds: tuple[float, ...] = param("m", "thresholds Y_mi if they are known", ())
    min_threshold: float | None = param(
        "m", "smallest threshold of the grid; chosen from the motion if it is not given", None, above=0
    )
    max_threshold: float | None = param(
        "m", "largest threshold of the grid; 0.35 of the stroke if it is not given", None, above=0
    )
    threshold_count: int = param(
        "1", "number of thresholds of the grid, spaced logarithmically", 100, at_least=1, at_most=400
    )
    holdout_fraction: float = param(
        "1", "fraction of the cycles that are held out, spread over the record", 0.25, at_least=0, at_most=0.5
    )

    def model_post_init(self, context: object) -> None:
        """Check the thresholds."""
        if self.thresholds and (min(self.thresholds) <= 0 or min(np.diff(self.thresholds), default=1.0) <= 0):
            raise ParameterError(f"{self.name}.thresholds: expected values above 0 in ascending order")
        if self.min_threshold and self.max_threshold and self.min_threshold >= self.max_threshold:
            raise ParameterError(
                f"{self.name}.min_threshold is {self.min_threshold:g} m; expected less than max_threshold, "
                f"{self.max_threshold:g} m"
            )

    def task(
        self, signals: Signals, max_threshold: float | None = None, span: float = MAX_THRESHOLD_SPAN
    ) -> IdentificationTask:
        """Return the identification task of the signals; RecordError if they do not suffice.

        Thresholds that the study does not give end at `max_threshold` [m], or at a part of the stroke, and begin at
        the `span`-th part of that.
        """
        records = tuple(friction_records(signals, self.displacement, self.thrust or self.force, self.acceleration))
        if not any(np.ptp(record.force) for record in records):
            raise RecordError(f"'{self.thrust or self.force}' does not vary; expected the friction force")
        resolution = self.resolution or quantisation_step(list(records))
        thresholds = self._grid(records, resolution, max_threshold, span)
        terms, speed, remarks = self._terms(records, float(thresholds.max()))
        cycles = np.unique(np.concatenate([record.cycle for record in records]))
        every = round(1 / self.holdout_fraction) if self.holdout_fraction else 0
        held_out = cycles[every - 1 :: every] if every and cycles.size >= every else cycles[:0]
        found = IdentificationTask(
            records=records,
            observation=self._observation(records[0].sample_time, zero_order_hold=True),
            terms=terms,
            thresholds=thresholds,
            viscous=self.viscous_coefficient,
            resolution=resolution,
            held_out=held_out,
            cycles=np.setdiff1d(cycles, held_out),
            remarks=(*remarks, *_reversal_remarks(records, float(thresholds.min()))),
            speed=speed,
        )
        return self._with_hold(found, signals) if self.thrust else found

    def _with_hold(self, task: IdentificationTask, signals: Signals) -> IdentificationTask:
        """Return the task with a thrust that is held between samples, or not."""
        tasks = {
            zero_order_hold: replace(
                task, observation=self._observation(task.records[0].sample_time, zero_order_hold=zero_order_hold)
            )
            for zero_order_hold in (True, False)
        }
        known = (
            True if self.zero_order_hold is None and task.speed is not None else self.zero_order_hold
        )  # at one speed a delay acts as mass
        zero_order_hold, remarks = detect_zero_order_hold(
            signals, known, lambda zero_order_hold: tasks[zero_order_hold].least_error
        )
        return replace(tasks[zero_order_hold], remarks=(*task.remarks, *remarks))

    def _observation(self, sample_time: float, *, zero_order_hold: bool) -> Observation:
        # a lag is a delay far below 1/τ; without a hold the thrust arrives half a sample earlier
        delay = (
            self.input_dead_time
            + self.output_dead_time
            + sum(self.input_time_constants)
            + sum(self.output_time_constants)
        )
        return Observation(bool(self.thrust), delay - (0.0 if zero_order_hold else sample_time / 2), self.max_frequency)

    def _grid(
        self, records: Sequence[FrictionRecord], resolution: float, max_threshold: float | None, span: float
    ) -> NDArray[np.float64]:
        """Return the thresholds [m]: those given, or a grid up to `max_threshold`, limited by encoder and study."""
        if self.thresholds:
            return np.array(self.thresholds)
        stroke = max(float(np.ptp(record.displacement)) for record in records)
        widest = self.max_threshold or max_threshold or MAX_THRESHOLD_RATIO * stroke
        min_threshold = self.min_threshold or min(max(MIN_THRESHOLD_STEPS * resolution, widest / span), widest / 2)
        if min_threshold >= widest:
            raise RecordError(
                f"the motion's stroke is {stroke:.3g} m; expected more than twice the smallest threshold, "
                f"{min_threshold:.3g} m"
            )
        return (
            np.geomspace(min_threshold, widest, self.threshold_count)
            if self.threshold_count > 1
            else np.array([widest])
        )

    def _terms(
        self, records: Sequence[FrictionRecord], max_threshold: float
    ) -> tuple[tuple[str, ...], float | None, list[str]]:
        """Return the terms that are fitted with the elements, the speed of all sliding if there is one, and remarks."""
        terms = [name for name in SIGNED_TERMS if getattr(self, f"fit_{name}")] + (["mass"] if self.thrust else [])
        speeds = np.concatenate([_sliding_speeds(record, max_threshold) for record in records])
        slow, fast = _speed_quantile(speeds, 0.1), _speed_quantile(speeds, 0.9)
        if fast > MIN_SPEED_RATIO * slow:
            return (*terms, *(["viscous"] if self.viscous_coefficient is None else [])), None, []
        effects, advice = [], "record several speeds"
        if self.viscous_coefficient is None:
            effects.append("the Coulomb force includes viscous friction")
            advice += ", or give viscous_coefficient"
            terms = [name for name in terms if name != "asymmetry"]
        if self.thrust:
            effects.append(
                "the mass is identifiable at reversals only, and includes the delay of friction by a standstill"
            )
        remarks = [f"all sliding is at one speed, so {' and '.join(effects)}: {advice}"] if effects else []
        return tuple(terms), fast if speeds.size else None, remarks


def _standstill_time(record: FrictionRecord, speed: float) -> float:
    """Return the standstill time at a reversal of a motion at this speed [m/s], plus one sample [s]."""
    turns = turning_points(record.displacement, speed * record.sample_time).size
    slow = int(np.sum(np.abs(record.velocity()) < STANDSTILL_SPEED_RATIO * speed))
    return (1 + slow / max(turns, 1)) * record.sample_time


def _sliding_speeds(record: FrictionRecord, max_threshold: float) -> NDArray[np.float64]:
    """Return the speeds [m/s] at which all elements slip, the largest included."""
    motion = np.concatenate([record.before, record.displacement])
    deflection = stop_operators(motion, np.array([max_threshold]))[record.before.size :, 0]
    speeds = np.abs(record.velocity())[np.abs(deflection) >= max_threshold]
    return speeds[speeds > 0]


def _speed_quantile(speeds: NDArray[np.float64], share: float) -> float:
    """Return the speed [m/s] below which this part of the travel takes place: dwells at the ends do not count."""
    if not speeds.size:
        return 1.0
    ordered = np.sort(speeds)
    travel = np.cumsum(ordered)
    return float(ordered[np.searchsorted(travel, share * travel[-1])])


def _reversal_remarks(records: Sequence[FrictionRecord], min_threshold: float) -> list[str]:
    count = sum(
        turning_points(np.concatenate([record.before, record.displacement]), 2 * min_threshold).size
        for record in records
    )
    if count >= MIN_REVERSALS:
        return []
    return [f"the motion has {count} reversals, too few to separate friction from other forces; record several cycles"]


def resolution_remarks(resolution: float, deflection: float) -> list[str]:
    """Return a remark if the encoder is too coarse for a presliding deflection [m]."""
    if resolution * MIN_DEFLECTION_STEPS <= deflection:
        return []
    return [
        f"the encoder's quantisation step of {resolution:.3g} m is more than a tenth of the presliding deflection of "
        f"{deflection:.3g} m: the stiffness is uncertain; use a finer encoder"
    ]
