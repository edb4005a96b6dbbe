"""A friction law from a record of displacement and force, or of thrust and position."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Curve,
    Estimator,
    Finding,
    Fit,
    FrictionModel,
    Metric,
    ParameterError,
    PositionDependentFriction,
    Quantity,
    RecordError,
    Result,
    Signals,
    did_you_mean,
    param,
)
from fraexp_plugins.friction._shared.element_model import ElementModel
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE
from fraexp_plugins.identification._shared.law_numbers import LawNumbers, rough_model
from fraexp_plugins.identification._shared.stop_operator import turning_points
from fraexp_plugins.identification.friction._friction_record import (
    HOLD_MEANING,
    FrictionRecord,
    detect_zero_order_hold,
    friction_records,
    quantisation_step,
)
from fraexp_plugins.identification.friction._friction_regression import SIGNED_TERMS, Observation, RegressionRows
from fraexp_plugins.identification.friction._friction_report import (
    TITLES,
    UNITS,
    ReportedElements,
    force_curve,
    model_error_remarks,
    outcome_of_fit,
    report,
)
from fraexp_plugins.identification.friction._friction_task import IdentificationTask, curve_end, element_solution
from fraexp_plugins.identification.friction._shape_fit import (
    DIFFERENCE_STEP,
    FreeElements,
    LawShape,
    ShapedForces,
    fit_shape,
    search_shape,
)

LAWS: dict[str, type[FrictionModel]] = {
    law.name: law for law in (Rolling, GeneralizedMaxwellSlip, Elastoplastic, LuGre, Dahl)
}
LAW_ELEMENTS = 4
"""Elements of a law with a Stribeck effect, if the study does not give their number."""
START_VELOCITY_RATIOS, TRIAL_STEPS = (0.3, 1.0, 3.0), 20
"""Stribeck velocities to start from, over the slowest tenth's sliding speed, and steps from each of them, after which
only the best search goes on."""
MAX_RELATIVE_STD = 2.0
"""Relative standard deviation from which a parameter is not identifiable."""
START_DAMPING = 1e-3
"""Force of the elements' dampers at the largest speed over the Coulomb force, at which a search begins."""
NEGLIGIBLE_FORCE = 1e-6
"""Force over the Coulomb force below which an element counts as none."""
MAX_THRESHOLD_RATIO = 0.35
"""Largest threshold over the stroke: an element that hardly slips is a slow rise of the force with any cause."""
MIN_SPEED_RATIO = 1.5
"""Fast over slow sliding from which viscous and Coulomb friction are separated."""
MIN_THRESHOLD_STEPS, MAX_THRESHOLD_SPAN, MAX_SEARCH_SPAN = 0.5, 300.0, 1e5
"""Smallest threshold in quantisation steps (below one step an element acts as Coulomb friction), and the ratio of the
largest to the smallest threshold, and that while the end of the virgin curve is searched: a drive's stroke is thousands
of times its presliding deflection."""
MIN_DEFLECTION_STEPS = 10.0
"""Quantisation steps that the presliding deflection should have."""
MIN_REVERSALS = 3
"""Reversals from which friction is separated from other forces."""


class FrictionIdentification(Estimator, name="friction_identification", version=1):
    """The parameters of a friction law, with mass, viscous friction and offset, by least squares along a record.

    `law` names the law. `rolling` is elements whose number need not be known: on a grid of thresholds Y_mi the
    deflections z_i of stop operators are known, eqs (6), (9), and min ‖f - Σ K_i z_i - …‖² over K_i ≥ 0 is convex (D.
    D. Rizos and S. D. Fassois, Chaos 14(2), 2004, with preassigned thresholds; C. L. Lawson and R. J. Hanson, Solving
    Least Squares Problems, 1974). Elements are removed one by one, always the one whose removal increases the error
    least; their number is the one with the smallest squared error over held-out cycles. Single K_i are
    ill-conditioned under noise: assess the force and the virgin curve, whose bands include the residuals' correlation
    and thresholds between those of the grid.

    With `back_propagation` the thresholds of these elements are free, too, and `fit_damping` adds their D_i: the
    paper's way (section V-A), with Gauss-Newton steps in place of its steepest descent. The problem is not convex:
    another `start` may lead to a worse minimum; compare the held-out errors. The bands assume the number of elements:
    for a smooth virgin curve, which has none, they cover about 89 %.

    Any other law is driven by the measured motion and fitted as a whole, from the elements and several Stribeck
    velocities, or from a model that `start` states: any law, your own included. The numbers that `start` states are
    estimated, those that it leaves at their defaults are not. A law with a Stribeck effect needs sliding at speeds
    from well below to well above its velocity; the message names parameters that are not identifiable. Do not use
    such a law if rolling elements already explain the force: its Stribeck numbers then have no meaning.

    The record is displacement and force. With `thrust` in place of `force` the friction is the thrust less the
    inertia of the moving mass, f = u - M a, and the mass is fitted in the same regression (J. Swevers, F. Al-Bender,
    C. Ganseman and T. Prajogo, IEEE Trans. Automatic Control 45(4), 2000, doi:10.1109/9.847103). Thrust and motion
    are compared up to `max_frequency`: a mode at f1 adds its part of (max_frequency/f1)² to the mass, so set it to a
    tenth of the first mode. If friction jumps at a reversal, between samples, the mass includes that jump times a
    delay of up to one sample: sample fast, or reverse rarely. A constant offset is fitted too. Besides a bias it
    contains half the difference of the Coulomb forces of the two directions. Do not use it if the motion stays in
    presliding, or friction depends on position or load.
    """

    law: str = param("", "friction law: rolling, gms, elastoplastic, lugre, dahl, or that of `start`", "")
    start: FrictionModel | None = param("", "friction model to start from; least squares if it is not given", None)
    elements: int = param(
        "1", "number of elements; chosen by held-out cycles if 0, and 4 in a law with a Stribeck effect", 0,
        at_least=0, at_most=400,
    )  # fmt: skip
    back_propagation: bool = param("", "whether the thresholds of rolling elements are free", False)
    fit_damping: bool = param("", "whether D_i of free elements, or the damping of bristles, is identified too", False)
    max_iterations: int = param("1", "maximum number of steps of a search", 300, at_least=1, at_most=100_000)
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

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses the frictionless machine with which it is tried here.",
    )

    def model_post_init(self, context: object) -> None:
        """Check law, start and thresholds."""
        if self.start is None and self.law not in ("", *LAWS):
            raise ParameterError(
                f"{self.name}.law is '{self.law}'{did_you_mean(self.law, LAWS)}; known: {', '.join(LAWS)}; for another "
                "one give a model as `start`"
            )
        if self.start is not None and self.law not in ("", self.start.name):
            raise ParameterError(f"{self.name}.start is {self.start.name}; expected a model of the law {self.law}")
        if isinstance(self.start, PositionDependentFriction):
            raise ParameterError(f"{self.name}.start has a position_dependence, which is not fitted; leave it out")
        if self.back_propagation and not issubclass(self._law, ElementModel):
            raise ParameterError(
                f"{self.name}.back_propagation frees the thresholds of rolling elements; leave it out with the law "
                f"{self._law.name}"
            )
        if self.thresholds and (min(self.thresholds) <= 0 or min(np.diff(self.thresholds), default=1.0) <= 0):
            raise ParameterError(f"{self.name}.thresholds: expected values above 0 in ascending order")
        if self.min_threshold and self.max_threshold and self.min_threshold >= self.max_threshold:
            raise ParameterError(
                f"{self.name}.min_threshold is ",
                Quantity(self.min_threshold, "m"),
                "; expected less than max_threshold, ",
                Quantity(self.max_threshold, "m"),
            )

    def estimate(self, signals: Signals) -> Result:
        """Return the law's parameters, terms, errors, forces and the friction model."""
        if not issubclass(self._law, ElementModel):
            return self._law_result(signals, self._law)
        task = self._focused_task(signals) if self.start is None else self._task(signals)
        if self.start is not None or self.back_propagation or self.fit_damping:
            task, found = self._free_elements(task)
            elements, rows, residuals = _reported_elements(task, found), found.rows, found.residuals
        else:
            elements, rows, coefficients = element_solution(task, self.elements, bool(self.thresholds))
            residuals = [each.force - each.columns @ coefficients for each in rows]
        return _element_result(signals, task, elements, rows, residuals)

    @property
    def _law(self) -> type[FrictionModel]:
        """The law that is fitted."""
        return LAWS[self.law or "rolling"] if self.start is None else type(self.start)

    def _focused_task(self, signals: Signals, *, spring_remarks: bool = True) -> IdentificationTask:
        """Return the task with a grid that ends at the end of the virgin curve."""
        task = self._task(signals, span=MAX_SEARCH_SPAN)
        if self.thresholds:
            return task
        end, remarks = curve_end(task, spring_remarks=spring_remarks)
        focused = self._task(signals, end)
        return replace(focused, remarks=(*focused.remarks, *remarks))

    def _free_elements(self, task: IdentificationTask) -> tuple[IdentificationTask, ShapedForces]:
        """Return task and elements with free thresholds, and with free dampers if they are asked for."""
        if isinstance(self.start, ElementModel):
            thresholds, stiffness = self.start.limit_deflection, np.array(self.start.elements[0])
            task = replace(task, thresholds=np.union1d(thresholds, task.thresholds[-1:]))
            damping = np.array(self.start.damping)
        else:
            found, _, _ = element_solution(task, self.elements, bool(self.thresholds))
            thresholds, stiffness, damping = found.limit_force / found.stiffness, found.stiffness, np.empty(0)
        forces = FreeElements(thresholds.size, float(task.thresholds.max()))
        springs = fit_shape(task, forces, np.log(thresholds), self.max_iterations)
        if not self.fit_damping:  # the springs come first: damping in their place leads to a wrong minimum
            return task, springs
        speed = max(float(np.abs(record.velocity()).max()) for record in task.records)
        least = START_DAMPING * float((stiffness * thresholds).sum()) / speed / stiffness.size
        relaxation = np.maximum(damping if damping.size else least, least) / stiffness
        return task, fit_shape(task, forces, np.concatenate([springs.shape, np.log(relaxation)]), self.max_iterations)

    def _law_result(self, signals: Signals, law: type[FrictionModel]) -> Result:
        """Return the fit of a law as a whole."""
        # the law itself shows a spring or a Stribeck effect: no remarks on their effect on the elements
        task = self._focused_task(signals, spring_remarks=False)
        if "viscous" not in task.terms and task.viscous is None:
            raise RecordError(
                f"{self.name}: all sliding is at one speed, so the dependence of friction on the velocity is not "
                "identifiable; record several speeds, or take the law rolling"
            )
        starts = [self.start] if self.start is not None else self._law_starts(task, law)
        trials = []
        for start in starts:
            shape = LawShape(LawNumbers(start))
            trial, _ = search_shape(task, shape, shape.numbers.coordinates, min(TRIAL_STEPS, self.max_iterations))
            trials.append(trial)
        nearest = min(trials, key=lambda each: each.cost)
        return _law_result(signals, fit_shape(task, nearest.forces, nearest.shape, self.max_iterations))

    def _law_starts(self, task: IdentificationTask, law: type[FrictionModel]) -> list[FrictionModel]:
        """Return models of the law with the force of the elements and several velocities."""
        is_of_elements = any("tuple" in str(info.annotation) for info in law.model_fields.values())
        count = self.elements or (LAW_ELEMENTS if is_of_elements else 0)
        found, _, _ = element_solution(task, count, bool(self.thresholds))
        speeds = np.sort(np.abs(np.concatenate([record.velocity() for record in task.records])))
        slow = _speed_quantile(speeds, 0.1)
        elements = found.stiffness, found.limit_force
        return [rough_model(law, elements, ratio * slow, self.fit_damping) for ratio in START_VELOCITY_RATIOS]

    def _task(
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
                "the motion's stroke is ",
                Quantity(stroke, "m"),
                "; expected more than twice the smallest threshold, ",
                Quantity(min_threshold, "m"),
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


def _element_result(
    signals: Signals,
    task: IdentificationTask,
    found: ReportedElements,
    rows: Sequence[RegressionRows],
    residuals: Sequence[NDArray[np.float64]],
) -> Result:
    """Return the result for elements with these residuals [N] of each record."""
    deflection = found.coulomb[0] / float(found.stiffness.sum())
    errors = task.errors(rows, residuals)
    found, doubts = task.with_model_error(found, rows, errors)
    remarks = [*task.remarks, *_resolution_remarks(task.resolution, deflection), *doubts]
    return report(signals, found, rows, errors, (task.cycles.size, task.held_out.size), remarks)


def _reported_elements(task: IdentificationTask, found: ShapedForces) -> ReportedElements:
    """Return the elements of non-negligible force, by ascending threshold, and the terms, with their covariance."""
    stiffness, count, terms = found.sizes, found.sizes.size, len(task.terms)
    thresholds, relaxation = np.exp(found.shape[:count]), np.exp(found.shape[count:])
    kept = np.argsort(thresholds)
    kept = kept[(stiffness * thresholds)[kept] > NEGLIGIBLE_FORCE * float(stiffness @ thresholds)]
    unit, first = np.eye(count)[kept], found.shape.size + terms
    slopes = np.zeros((kept.size * (3 if relaxation.size else 2) + terms, found.covariance.shape[0]))
    slopes[: kept.size, first:] = unit
    slopes[kept.size : 2 * kept.size, :count] = unit * (stiffness * thresholds)
    slopes[kept.size : 2 * kept.size, first:] = unit * thresholds
    if relaxation.size:
        slopes[2 * kept.size : 3 * kept.size, count : 2 * count] = unit * (stiffness * relaxation)
        slopes[2 * kept.size : 3 * kept.size, first:] = unit * relaxation
    slopes[len(slopes) - terms :, found.shape.size : first] = np.eye(terms)
    covariance = slopes @ found.covariance @ slopes.T
    values = dict(zip(task.terms, found.coefficients[:terms].tolist(), strict=True))
    if task.viscous is not None:
        values["viscous"] = task.viscous
        covariance = np.pad(covariance, (0, 1))
    damping = (stiffness * relaxation)[kept] if relaxation.size else np.empty(0)
    return ReportedElements(stiffness[kept], (stiffness * thresholds)[kept], damping, values, covariance)


def _law_result(signals: Signals, found: ShapedForces) -> Result:
    """Return the result for a law that was fitted as a whole."""
    task, forces = found.task, found.forces
    assert isinstance(forces, LawShape)
    numbers, terms, scale = forces.numbers, found.coefficients[: len(task.terms)], float(found.sizes[0])
    if scale <= 0:
        raise RecordError(
            "friction_identification: the record shows no force of this law; check its sign (friction acts with the "
            "velocity), its channel and the dead time, or take the law rolling"
        )
    own = numbers.values(found.shape, scale)
    slopes = np.zeros((own.size + terms.size, found.shape.size + terms.size + 1))
    for place, row in enumerate(DIFFERENCE_STEP * np.eye(found.shape.size)):
        slopes[: own.size, place] = (numbers.values(found.shape + row, scale) - own) / DIFFERENCE_STEP
    slopes[: own.size, -1] = (
        (numbers.values(found.shape, scale * (1 + DIFFERENCE_STEP)) - own) / DIFFERENCE_STEP / scale
    )
    slopes[own.size :, found.shape.size : -1] = np.eye(terms.size)
    names, values = [each.name for each in numbers.numbers] + list(task.terms), np.concatenate([own, terms])
    units = [each.unit for each in numbers.numbers] + [UNITS[term] for term in task.terms]
    coulomb = float(values[names.index("coulomb_force")]) if "coulomb_force" in names else numbers.force(scale)
    mass = float(values[names.index("mass")]) if "mass" in names else 0.0
    errors = task.errors(found.rows, found.residuals)
    covariance = slopes @ found.covariance @ slopes.T
    covariance *= task.inflation(found.rows, errors, coulomb, mass, values.size)
    deviations = np.sqrt(np.diag(covariance))
    metrics = [Metric("rms error, fitted cycles", errors.fitted, "N")]
    if np.isfinite(errors.held_out):
        metrics.append(Metric("rms error, held-out cycles", errors.held_out, "N"))
    for name, value, unit, deviation in zip(names, values.tolist(), units, deviations.tolist(), strict=True):
        title = TITLES.get(name, name.replace("_", " "))
        metrics += [Metric(title, value, unit), Metric(f"{title}, 95 %", NORMAL_QUANTILE * deviation, unit)]
    loose = [
        name for name, value, std in zip(names, values, deviations, strict=True)
        if name not in SIGNED_TERMS and not std < MAX_RELATIVE_STD * abs(value)
    ]  # fmt: skip
    found_remarks: list[Finding | str] = [*task.remarks]
    if loose:
        remedy = "vary the speed from presliding to sliding"
        found_remarks.append(Finding("not identifiable", place=", ".join(loose), remedy=remedy))
    found_remarks += model_error_remarks(coulomb, errors.worst, task.noise(mass))
    inside = [place for place, name in enumerate(names) if name not in (*SIGNED_TERMS, "mass")]
    viscous = task.viscous if task.viscous is not None else float(values[names.index("viscous")])
    fit = Fit(
        "friction",
        numbers.model(found.shape, scale, viscous).spec(),
        tuple("viscous_coefficient" if names[place] == "viscous" else names[place] for place in inside),
        tuple(units[place] for place in inside),
        values[inside],
        covariance[np.ix_(inside, inside)],
    )
    curves: tuple[Curve, ...] = (force_curve(found.rows, errors),)
    outcome = outcome_of_fit(signals.outcome, coulomb, errors.worst)
    result = Result(outcome, signals.findings, metrics=tuple(metrics), curves=curves, fits=(fit,))
    return result.with_findings(*found_remarks)


def _sliding_speeds(record: FrictionRecord, max_threshold: float) -> NDArray[np.float64]:
    """Return the speeds [m/s] at which all elements slip, the largest included."""
    deflection = record.deflections(np.array([max_threshold]))[:, 0]
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


def _resolution_remarks(resolution: float, deflection: float) -> list[Finding]:
    """Return a remark if the encoder is too coarse for a presliding deflection [m]."""
    if resolution * MIN_DEFLECTION_STEPS <= deflection:
        return []
    steps = Quantity(resolution, "m", "encoder step"), Quantity(deflection, "m", "presliding deflection")
    return [Finding("not identifiable", steps, place="stiffness", remedy="use a finer encoder")]
