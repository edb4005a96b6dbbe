"""Friction from force and motion: a law's parameters, beside mass, viscous friction and offset."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    ROUNDING,
    Estimator,
    Finding,
    FrictionModel,
    ParameterError,
    PositionDependentFriction,
    Quantity,
    RecordError,
    Result,
    Signals,
    param,
)
from fraexp_plugins.friction._shared.element_model import ElementModel
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._friction_fit import (
    FrictionFit,
    columns_along,
    curve_end,
    fit_elements,
    fit_law,
    search_shape,
    with_dead_time,
)
from fraexp_plugins.identification._friction_report import report
from fraexp_plugins.identification._friction_rows import (
    ConstantVelocityRuns,
    FrictionProblem,
    FrictionRecord,
    MeasuredFriction,
    Observation,
    ThrustAndMotion,
    disturbed_start,
    friction_records,
    quantisation_step,
    slides,
    speed_quantile,
    turning_points,
)
from fraexp_plugins.identification._law_comparison import best_of, fit_each
from fraexp_plugins.identification._law_forces import FreeElements, Law, WholeLaw, rolling_elements
from fraexp_plugins.identification._law_numbers import DAMPING_RATIO, LAW_ELEMENTS, LawNumbers, rough_model
from fraexp_plugins.identification._usable_records import HELD_OUT_STEP, MIN_SIZE_RATIO

START_VELOCITY_RATIOS, TRIAL_STEPS = (0.3, 1.0, 3.0), 20
"""Stribeck velocities to start from, over the slowest tenth's sliding speed, and steps from each of them, after which
only the best search goes on."""
MAX_THRESHOLD_RATIO = 0.35
"""Largest threshold over the stroke: an element that hardly slips is a slow rise of the force with any cause."""
GRID_SIZE, MAX_THRESHOLD_SPAN, MAX_SEARCH_SPAN = 100, 300.0, 1e5
"""Thresholds of the grid, the ratio of the largest to the smallest, and that while the end of the virgin curve is
searched: a drive's stroke is thousands of times its presliding deflection."""
MIN_REVERSALS = 3
"""Reversals from which friction is separated from other forces."""


class FrictionIdentification(Estimator, name="friction_identification", version=8):
    """The parameters of a friction law, with mass, viscous friction and offset, by least squares along a record.

    `laws` names one law, or several, your own included, of which the one with the smallest error over held-out cycles
    is chosen; `starts` are models to start from. The numbers that such a model states are estimated, those that it
    leaves at their defaults are not.

    **Elements** (`rolling`): on a grid of thresholds Y_mi the deflections z_i of stop operators are known, eqs (6),
    (9), and min ‖f - Σ K_i z_i - …‖² over K_i ≥ 0 is convex (D. D. Rizos and S. D. Fassois, Chaos 14(2), 2004, with
    preassigned thresholds; C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974). Elements are removed
    one by one, always the one whose removal increases the error least; their number is the one with the smallest
    squared error over held-out cycles. Single K_i are ill-conditioned under noise: assess the force and the virgin
    curve, whose bands include the residuals' correlation and thresholds between those of the grid. With
    `back_propagation` the thresholds are free, too, and `fit_damping` adds their D_i: the paper's way (section V-A),
    with Gauss-Newton steps in place of its steepest descent. The problem is not convex: another start may lead to a
    worse minimum. The bands assume the number of elements: for a smooth virgin curve they cover about 89 %.

    **Sliding** (`coulomb`, and other laws that are set-valued at rest): u = M a + F_c sgn(v) + D_v v + F_o (+ D_a |v|)
    over the time in which the machine slides, as at a standstill friction is any force that holds it.
    Any motion in both directions and at several speeds is suitable (M. Gautier and Ph. Poignet, Control Engineering
    Practice 9(12), 2001, doi:10.1016/S0967-0661(01)00087-9).
    A start of the record, up to a quarter of it, that the model of the rest does not explain is left out. If the terms
    leave more than noise explains, a force along the stroke, such as cogging or the ripple of a screw, is fitted beside
    them; where all moves are alike it looks like a term, and what it changes is then a part of the interval. With
    `constant_velocity` the mean of each run at constant velocity is one row: D_v as the paper has it, eq (12).

    **Other laws** are driven by the measured motion and fitted as a whole, from the elements and several Stribeck
    velocities. A law with a Stribeck effect needs sliding at speeds from well below to well above its velocity; the
    message names parameters that are not identifiable. Do not use such a law if rolling elements already explain the
    force: its Stribeck numbers then have no meaning.

    The record is displacement and force. With `thrust` in place of `force` the friction is the thrust less the
    inertia of the moving mass, f = u - M a, and the mass is fitted in the same regression (J. Swevers, F. Al-Bender,
    C. Ganseman and T. Prajogo, IEEE Trans. Automatic Control 45(4), 2000, doi:10.1109/9.847103). Thrust and motion
    are compared up to `max_frequency`: a mode at f1 adds its part of (max_frequency/f1)² to the mass, so set it to a
    tenth of the first mode. If friction jumps at a reversal, between samples, the mass includes that jump times a
    delay of up to one sample: sample fast, or reverse rarely. A constant offset is fitted too. Besides a bias it
    contains half the difference of the Coulomb forces of the two directions. A dead time of a measured thrust beyond
    the stated one is fitted too, with what is known in advance as one more row: it is that of a thrust that is held
    between samples, or half a sample less. Where the record does not tell it, the other intervals contain it.

    The intervals include the correlation of the residuals (A. D. Sokal, 1997). The metric 'Cramér-Rao bound' is the
    smallest interval of the viscous coefficient that an unbiased estimator has with white residuals of that size: if
    the interval is near it, only another record (longer, faster, less noise) can narrow it.
    """

    laws: tuple[type[FrictionModel], ...] = param(
        "", "names of friction laws, your own included; rolling if no start is given either", ()
    )
    starts: tuple[FrictionModel, ...] = param("", "friction models to start from, of any law", ())
    elements: int = param(
        "1", "number of elements; chosen by held-out cycles if 0, and 4 in a law with a Stribeck effect", 0,
        at_least=0, at_most=400,
    )  # fmt: skip
    back_propagation: bool = param("", "whether the thresholds of rolling elements are free", False)
    fit_damping: bool = param("", "whether D_i of free elements, or the damping of bristles, is identified too", False)
    constant_velocity: bool = param("", "whether runs at constant velocity are compared, of the law coulomb", False)
    presliding_distance: float = param(
        "m", "travel after each reversal that is left out, because friction rises there, of the law coulomb", 0.0,
        at_least=0,
    )  # fmt: skip
    max_iterations: int = param("1", "maximum number of steps of a search", 300, at_least=1, at_most=100_000)
    displacement: str = param("", "channel of the displacement", "displacement")
    force: str = param("", "channel of the friction force, if it is measured", "friction")
    thrust: str = param("", "channel of the thrust that moves mass and friction, in place of `force`", "")
    max_frequency: float = param("Hz", "frequency up to which thrust and motion are compared", 5.0, above=0)
    zero_order_hold: bool | None = param(
        "",
        "whether the thrust is held between samples; if it is not given, a measured thrust has a further dead time",
        None,
    )  # fmt: skip
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
    fit_asymmetry: bool = param("", "whether viscous friction may differ by direction: a force D_a |v|", False)
    viscous_coefficient: float | None = param(
        "N s/m", "viscous coefficient D_v if it is known; otherwise fitted if the velocity varies", None, at_least=0
    )
    thresholds: tuple[float, ...] = param("m", "thresholds Y_mi if they are known", ())

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses the frictionless machine with which it is tried here.",
    )

    def model_post_init(self, context: object) -> None:
        """Check laws, starts and thresholds."""
        for law in self.laws:
            try:
                numbers = issubclass(law, ElementModel) or LawNumbers(_unit_model(law)).numbers
            except ParameterError as error:
                raise ParameterError(f"{self.name}.laws: ", *error.args, "; give a model in `starts`") from None
            if not numbers:
                raise ParameterError(f"{self.name}.laws: {law.name} has no numbers to fit; expected another law")
        if any(isinstance(start, PositionDependentFriction) for start in self.starts):
            raise ParameterError(f"{self.name}.starts: a position_dependence is not fitted; leave it out")
        kinds = {*self._laws, *map(type, self.starts)}
        if self.back_propagation and not any(issubclass(kind, ElementModel) for kind in kinds):
            raise ParameterError(f"{self.name}.back_propagation frees the thresholds of the law rolling; leave it out")
        if self.constant_velocity and not self._is_sliding:
            raise ParameterError(
                f"{self.name}.constant_velocity is for the law coulomb alone; expected laws = ['coulomb']"
            )
        if self.thresholds and (min(self.thresholds) <= 0 or min(np.diff(self.thresholds), default=1.0) <= 0):
            raise ParameterError(f"{self.name}.thresholds: expected values above 0 in ascending order")

    @property
    def _laws(self) -> tuple[type[FrictionModel], ...]:
        """The laws without a start."""
        return self.laws or (() if self.starts else (Rolling,))

    @property
    def _is_sliding(self) -> bool:
        """Whether no law says anything of a standstill, as none has a state there."""
        return all(map(_is_set_valued, self._laws)) and all(s.velocity_law for s in self.starts)

    def estimate(self, signals: Signals) -> Result:
        """Return the numbers of the law that predicts best, terms, errors, forces and the friction model."""
        records = tuple(friction_records(signals, self.displacement, self.thrust or self.force))
        if not any(np.ptp(record.force) for record in records):
            raise RecordError(f"'{self.thrust or self.force}' does not vary; expected the friction force")
        problem = (self._sliding_problem if self._is_sliding else self._presliding_problem)(signals, records)
        candidates: list[Law] = [*self._laws, *self.starts]
        fits, left_out = fit_each(candidates, partial(self._fit, problem), lambda each: each.name)
        best = best_of(fits, lambda fit: fit.prediction)
        errors = tuple(Quantity(fit.worst_error, "N", f"error of {fit.model.name}") for fit in fits)
        chosen = Finding("remark", errors, place=best.model.name, text="predicts the held-out cycles best")
        return report(signals, best, [*([chosen] if len(candidates) > 1 else []), *left_out])

    def _sliding_problem(self, signals: Signals, records: tuple[FrictionRecord, ...]) -> FrictionProblem:
        """Return the problem of laws that say nothing of a standstill: the rows in which the machine slides."""
        known = slides(records, self.presliding_distance)
        problem = self._problem(signals, records, known, known, np.empty(0))
        if isinstance(problem.observation, ThrustAndMotion):
            plain = FrictionFit(problem, WholeLaw.of(Coulomb(coulomb_force=1.0)))
            duration = min(record.displacement.size * record.sample_time for record in records)
            skipped, remarks = disturbed_start(plain.rows, duration)
            late = [np.arange(slide.size) * records[0].sample_time >= skipped for slide in known]
            known = tuple(slide & is_late for slide, is_late in zip(known, late, strict=True))
            problem = replace(problem, known=known, findings=(*problem.findings, *remarks))
            problem = with_dead_time(problem, plain.forces)
        self._check_directions(problem)
        return problem

    def _check_directions(self, problem: FrictionProblem) -> None:
        """Raise RecordError unless the machine slides in both directions."""
        velocity = problem.rows.velocity
        least = problem.observation.min_rows // 2
        count = min(int(np.sum(velocity > 0)), int(np.sum(velocity < 0)))
        if count < least:
            raise RecordError(
                f"the machine slides in {count} {problem.observation.rows_name} in one direction; expected {least} or "
                "more in both: record longer moves back and forth, or raise max_frequency"
            )

    def _presliding_problem(self, signals: Signals, records: tuple[FrictionRecord, ...]) -> FrictionProblem:
        """Return the problem of laws with presliding: all rows in which their state is known."""
        is_whole = not all(issubclass(law, ElementModel) for law in (*self._laws, *map(type, self.starts)))
        problem, remarks = self._grid_problem(signals, records, MAX_SEARCH_SPAN), list[Finding | str]()
        if is_whole and "viscous" not in problem.terms and problem.viscous is None:
            raise RecordError(
                f"{self.name}: all sliding is at one speed, so the dependence of friction on the velocity is not "
                "identifiable; record several speeds, or take the law rolling"
            )
        if not self.thresholds:
            # a law as a whole shows a spring or a Stribeck effect itself: no remarks on their effect on the elements
            end, remarks = curve_end(problem, spring_remarks=not is_whole)
            problem = self._grid_problem(signals, records, MAX_THRESHOLD_SPAN, end)
        problem = with_dead_time(problem, rolling_elements(problem.thresholds))
        return replace(problem, findings=(*problem.findings, *remarks))

    def _fit(self, problem: FrictionProblem, candidate: Law) -> FrictionFit:
        """Return the fit of a law, or from a model."""
        if not self._is_sliding:
            if isinstance(candidate, FrictionModel):
                return self._fit_from(problem, candidate)
            return self._fit_law(problem, candidate)
        slow = speed_quantile(problem.rows.velocity, 0.1)
        start = candidate if isinstance(candidate, FrictionModel) else _unit_model(candidate, slow)
        fit = _checked_signs(fit_law(problem, start, self.max_iterations))
        has_stroke = isinstance(problem.observation, ThrustAndMotion)
        return fit.beside_stroke_force() if has_stroke and fit.has_model_error else fit

    def _fit_from(self, problem: FrictionProblem, start: FrictionModel) -> FrictionFit:
        """Return the fit of a law from a start; of elements with their thresholds, and dampers if they have any."""
        if not isinstance(start, ElementModel):
            return fit_law(problem, start, self.max_iterations)
        stiffness, force = start.elements
        springs = self._fit_elements(problem, Rolling(stiffness=stiffness, limit_force=force))
        if not (self.fit_damping or start.damping):
            return springs
        # the springs come first: damping in their place leads to a wrong minimum
        found = springs.model
        assert isinstance(found, Rolling)
        speed = max(float(np.abs(record.velocity).max()) for record in problem.records)
        least = DAMPING_RATIO * springs.coulomb_force / speed / len(found.stiffness)
        return self._fit_elements(problem, found.model_copy(update={"damping": (least,) * len(found.stiffness)}))

    def _fit_law(self, problem: FrictionProblem, law: type[FrictionModel]) -> FrictionFit:
        """Return the fit of elements on the grid, or of a law whose search begins with them."""
        is_rolling = issubclass(law, ElementModel)
        is_of_elements = any("tuple" in str(info.annotation) for info in law.model_fields.values())
        count = self.elements or (LAW_ELEMENTS if is_of_elements and not is_rolling else 0)
        grid = fit_elements(problem, count, bool(self.thresholds))
        model = grid.model
        assert isinstance(model, Rolling)
        if is_rolling:
            return self._fit_from(problem, model) if self.back_propagation or self.fit_damping else grid
        slow = speed_quantile(problem.rows.velocity, 0.1)
        elements = np.array(model.stiffness), np.array(model.limit_force)
        models = [rough_model(law, elements, ratio * slow, self.fit_damping) for ratio in START_VELOCITY_RATIOS]
        trials = [search_shape(problem, model, min(TRIAL_STEPS, self.max_iterations))[0] for model in models]
        nearest = min(trials, key=lambda each: each.error)
        if nearest.coefficients[-1] <= 0:
            raise RecordError(
                "friction_identification: the record shows no force of this law; check its sign (friction acts with "
                "the velocity), its channel and the dead time, or take the law rolling"
            )
        return fit_law(problem, nearest.model, self.max_iterations)

    def _fit_elements(self, problem: FrictionProblem, start: Rolling) -> FrictionFit:
        """Return the fit of elements, without those of negligible force, in the order of their thresholds."""
        fit = fit_law(problem, start, self.max_iterations)
        assert isinstance(fit.forces, FreeElements)
        return replace(fit, forces=fit.forces.order(fit.sizes, ROUNDING))

    def _problem(
        self,
        signals: Signals,
        records: tuple[FrictionRecord, ...],
        known: tuple[NDArray[np.bool_], ...],
        sliding: Sequence[NDArray[np.bool_]],
        thresholds: NDArray[np.float64],
    ) -> FrictionProblem:
        """Return the problem of records in which friction is known, and the machine slides, at some samples."""
        cycles = np.unique(np.concatenate([record.cycle for record in records]))
        is_chosen = not self._is_sliding or len(self._laws) + len(self.starts) > 1
        held_out = cycles[HELD_OUT_STEP - 1 :: HELD_OUT_STEP] if is_chosen else cycles[:0]
        speeds = np.concatenate([record.velocity[at] for record, at in zip(records, sliding, strict=True)])
        terms, speed, remarks = self._terms(speeds, bool(signals.numerics))
        return FrictionProblem(
            records=records,
            observation=self._observation(records[0].sample_time),
            terms=terms,
            known=known,
            thresholds=thresholds,
            viscous=self.viscous_coefficient,
            resolution=self.resolution or quantisation_step(records),
            held_out=held_out,
            findings=tuple(remarks),
            speed=speed,
            is_sliding=self._is_sliding,
        )

    def _grid_problem(
        self, signals: Signals, records: tuple[FrictionRecord, ...], span: float, max_threshold: float | None = None
    ) -> FrictionProblem:
        """Return the problem of laws with presliding; RecordError if the motion does not suffice.

        Thresholds that the study does not give end at `max_threshold` [m], or at a part of the stroke, and begin at
        the `span`-th part of that.
        """
        thresholds = np.array(self.thresholds)
        if not thresholds.size:
            resolution = self.resolution or quantisation_step(records)
            stroke = max(float(np.ptp(record.displacement)) for record in records)
            widest = max_threshold or MAX_THRESHOLD_RATIO * stroke
            # an element within the rounding error acts as Coulomb friction
            narrowest = min(max(resolution / 2, widest / span), widest / 2)
            thresholds = np.geomspace(narrowest, widest, GRID_SIZE)
        widest = float(thresholds.max())
        known = tuple(np.arange(record.displacement.size) >= record.first_known_sample(widest) for record in records)
        elements = rolling_elements(np.array([widest]))
        sliding = [np.abs(columns_along(elements, record)[:, 0]) >= 1 - ROUNDING for record in records]
        problem = self._problem(signals, records, known, sliding, thresholds)
        motions = [np.concatenate([record.before, record.displacement]) for record in records]
        count = sum(turning_points(motion, 2 * float(thresholds.min())).size for motion in motions)
        if count >= MIN_REVERSALS:
            return problem
        remark = (
            f"the motion has {count} reversals, too few to separate friction from other forces; record several cycles"
        )
        return replace(problem, findings=(*problem.findings, remark))

    def _observation(self, sample_time: float) -> Observation:
        if self.constant_velocity:
            return ConstantVelocityRuns()
        if not self.thrust:
            return MeasuredFriction()
        lags = sum(self.input_time_constants) + sum(self.output_time_constants)  # each a delay, far below 1/τ
        later = -sample_time / 2 if self.zero_order_hold is False else 0.0
        return ThrustAndMotion(self.max_frequency, self.input_dead_time + self.output_dead_time + lags, later)

    def _terms(
        self, speeds: NDArray[np.float64], is_simulated: bool
    ) -> tuple[tuple[str, ...], float | None, list[str]]:
        """Return the terms beside the law, the speed of all sliding if there is one, and remarks."""
        has_mass = bool(self.thrust) or self.constant_velocity
        is_delayed = self.thrust and not self.constant_velocity and not is_simulated
        terms = ["offset", *(["asymmetry"] if self.fit_asymmetry else [])]
        terms += ["dead_time"] if is_delayed and self.zero_order_hold is None else []
        terms += ["mass"] if has_mass else []
        slow, fast = speed_quantile(speeds, 0.1), speed_quantile(speeds, 0.9)
        if fast > MIN_SIZE_RATIO * slow:
            return (*terms, *(["viscous"] if self.viscous_coefficient is None else [])), None, []
        if self._is_sliding:
            raise RecordError(
                "all sliding is at one speed, ",
                Quantity(fast, "m/s"),
                "; expected several speeds, to separate viscous friction, Coulomb friction and the mass",
            )
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
        return tuple(terms), fast if speeds.any() else None, remarks


def _unit_model(law: type[FrictionModel], speed: float = 1.0) -> FrictionModel:
    """Return a model of a law with a force of 1 N, which states the numbers that the law needs."""
    return rough_model(law, (np.ones(1), np.ones(1)), speed, needed_alone=True)


def _is_set_valued(law: type[FrictionModel]) -> bool:
    """Return whether the force of a law may have any value at a standstill, unless more numbers are stated."""
    return not issubclass(law, ElementModel) and _unit_model(law).velocity_law is not None


def _checked_signs(fit: FrictionFit) -> FrictionFit:
    """Return a fit; RecordError for a mass or a Coulomb force that is negative."""
    force, mass = fit.coulomb_force, fit.term("mass")
    if force <= 0 or (mass < 0 and isinstance(fit.problem.observation, ThrustAndMotion)):
        raise RecordError(
            "the mass is ",
            Quantity(mass, "kg"),
            " and the Coulomb force ",
            Quantity(force, "N"),
            "; expected both above 0: check signs and gains of the channels, the dead times and max_frequency",
        )
    return fit
