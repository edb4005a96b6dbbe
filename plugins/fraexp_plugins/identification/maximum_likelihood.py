"""Plant and friction parameters of greatest likelihood: every sample of the records, through a simulated machine."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    NORMAL_QUANTILE,
    Curve,
    Finding,
    FraexpError,
    FrictionModel,
    Metric,
    ParameterError,
    Plant,
    PositionDependentFriction,
    RecordError,
    Result,
    Segment,
    Signals,
    param,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._law_numbers import shape_parameters
from fraexp_plugins.identification._likelihood import (
    greatest_ratio,
    greatest_variance_ratio,
    likely_noise,
    noise_in_records,
)
from fraexp_plugins.identification._machine_fit import (
    FitReport,
    Fitted,
    fit_machine,
    joint_fit,
    least_told,
    predicted_ratios,
)
from fraexp_plugins.identification._machine_problem import (
    DEAD_TIME,
    NOISE,
    SCALES,
    FreeParameters,
    MachineProblem,
)
from fraexp_plugins.identification._motion_start import (
    EXPLAINED,
    MAX_STARTS,
    MotionFit,
    RoughFriction,
    fits_along_motion,
    rough_friction,
    spread_records,
)
from fraexp_plugins.identification._usable_records import (
    HELD_OUT_STEP,
    check_one_contact,
    check_one_thrust,
    check_segments,
    usable_signals,
)


class MaximumLikelihood(DelayedEstimator, name="maximum_likelihood", version=13):
    """P̂, plant and friction parameters with which a simulated machine most probably gives all samples of the records.

    The observer of `effective_input` drives its friction model by measured positions, and takes the small difference of
    two forces. Here the machine itself is simulated along the recorded control input. A sample is an interval as wide
    as the encoder's step q, blurred by noise of standard deviation σ: the likelihood of a residual r is
    Φ((r + q/2)/σ) - Φ((r - q/2)/σ) (F. Gustafsson and R. Karlsson, Automatica 45(12), 2009). Rounding then hardly costs
    accuracy, and the parameters of friction are estimated as well.

    The search begins where the measured motion, driving the friction law beside a plant, explains the control input at
    the excited lines and, for sines, at their odd harmonics. The friction model may be wrong by a factor of three.

    All records share the parameters named in `free`: by default one factor on friction's force and one on its
    deflections. Each record has a response of its own. At harmonics of the excitation, which friction causes, the plant
    is `nominal_plant`, or a modal plant that is fitted to all records. `input_dead_time` stands for all dead time of
    the loop, and may be some samples wrong at the start, or 0. `noise` is estimated from the residual, and must not
    exceed what scatter or spectrum of the records show.

    The band is that of the information in the likelihood, uncertain parameters included. Metrics are the parameters
    with their 95 % intervals, and the geometric mean of the residuals over what noise and rounding explain, which is 1
    for a right model. If it is larger than chance allows (a χ² test), or if noise covers the encoder's steps and the
    residual is not white, the outcome is not ok: the law, a dead time or the noise is wrong. Unidentifiable parameters
    are fixed and named. Plant and friction are also results as components, if the law's parameters can express the
    scales.

    **Which law?** Each of several `laws` or `starts` is fitted to three quarters of the records with its scales and
    shape parameters free (viscous coefficient, static force, Stribeck velocity, damping, attraction, and pure numbers
    without a default), and predicts the others (cross-validation: M. Stone, J. Royal Statistical Society B 36(2),
    1974). The law with the smallest residual wins; among laws that an F test finds equal it is the one with the
    smallest Bayesian information criterion, which is the simpler one unless the other is much more likely. `laws` are
    names of any laws, your own included: the search begins at numbers of the sizes that their units imply, and at those
    of the law's first preset where units do not imply any. If a law fits, those with a residual five times as large
    along the measured motion, or with a larger one and no fewer parameters, are not fitted further; laws that cannot
    run in lanes (elastoplastic, GMS) take minutes and are tried only if no other law fits. A law that cannot be
    computed is named. It is ok if a law fits. Use 16 frequencies or more, from presliding to gross sliding, or
    two amplitudes (`concatenated`).

    **Several contacts.** One thrust and one position do not show how friction at another contact moves the machine. So
    P̂ is the response of a plant with ports whose numbers are estimated, beginning with `nominal_plant`; a mode that it
    lacks shows in the residual. The records need frequencies below and above the modes: below them all contacts move
    alike. There is one start, which must be within some ten percent. A number that is 0 at the start stays 0.

    The records are the steady state of stepped sines or multisines of up to 64 lines. If friction holds the machine
    nearly still at all frequencies, this method does not help either. A fit takes about 0.03 s for each frequency.
    """

    friction: FrictionModel | None = param("", "friction model at the start", None, inherit="friction")
    frictions: dict[str, FrictionModel] = param(
        "", "friction model of each contact at the start, of a machine with several", {}, inherit="friction"
    )
    laws: tuple[type[FrictionModel], ...] = param("", "names of friction laws to choose from", ())
    starts: tuple[FrictionModel, ...] = param("", "friction models to choose from, of any law, in place of one", ())
    free: tuple[str, ...] | None = param(
        "",
        "what is estimated: force_scale, displacement_scale, names of the model's numbers, input_dead_time, noise; of "
        "several contacts such as motor.force_scale or stiffness. By default the scales, and with several contacts "
        "their viscous coefficients and all numbers of the plant, too; of laws to choose from all that it may be",
        None,
    )
    nominal_plant: Plant | None = param(
        "", "plant at the harmonics, fitted to the response if it is not given; the start, with several contacts", None
    )
    thrust: str = param("", "thrust that is excited, as in the loop", "", inherit="loop.thrust")
    position: str = param("", "position that is fed back, as in the loop", "", inherit="loop.position")
    modes: int | None = param("1", "modes of the fitted plant; chosen if not given", None, at_least=0, at_most=12)
    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")
    noise: float | None = param(
        "m",
        "standard deviation of the encoder's noise; from scatter or spectrum of the periods if it is not given",
        None,
        at_least=0,
        inherit="loop.noise",
    )
    interpolation_tolerance: float = param(
        "1", "relative error of y'/u that is tolerated", 1e-4, at_least=1e-5, at_most=0.1, inherit="numerics.tolerance"
    )

    def model_post_init(self, context: object) -> None:
        """Check the names of the free parameters, and that plant and friction can be replayed."""
        self._check_choice()
        models: dict[str, FrictionModel | None] = {"friction": self.friction}
        models |= {f"frictions.{contact}": model for contact, model in self.frictions.items()}
        models |= {f"starts.{place}": model for place, model in enumerate(self.starts)}
        for place, model in models.items():
            if isinstance(model, PositionDependentFriction):
                raise ParameterError(
                    f"maximum_likelihood.{place} has a position_dependence, and a replay does not know where on the "
                    "stroke the record was; leave it out, or use an effective input"
                )
        contacts = [] if self.nominal_plant is None else list(self.nominal_plant.ports().contacts)
        if self.frictions and not self._is_open:
            if self.nominal_plant is None:
                raise ParameterError("maximum_likelihood.nominal_plant is missing; expected the plant of all contacts")
            for contact in self.frictions:
                if contact not in contacts:
                    raise ParameterError(
                        f"maximum_likelihood.frictions: the nominal plant has no contact '{contact}'; known: "
                        f"{', '.join(contacts)}"
                    )
        elif len(contacts) > 1:
            raise ParameterError(
                f"maximum_likelihood.nominal_plant has friction at {len(contacts)} contacts ({', '.join(contacts)}); "
                "give the model of each one in frictions"
            )
        for model in self.starts if self._is_open else (self.friction,):
            if model is not None or self.frictions:
                self._free_of(model)

    def _check_choice(self) -> None:
        """Check that each law to choose from has a model to begin with, and that nothing of it is said to be fixed."""
        for law in self.laws:
            try:
                RoughFriction(1.0, 1e-5, 1e-2).model(law)
            except ParameterError as error:
                raise ParameterError("maximum_likelihood.laws: ", *error.args, "; give a model in `starts`") from None
        fixed = [name for name in self.free or () if self._is_open and name not in (DEAD_TIME, NOISE)]
        if fixed:
            raise ParameterError(
                f"maximum_likelihood.free names '{fixed[0]}', and laws to choose from have all their numbers free; "
                f"leave it out: {DEAD_TIME} and {NOISE} can be named"
            )

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with its band, the friction parameters, and how well the model repeats the records."""
        signals.unit(self.input), signals.unit(self.output)
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        if not self._is_open:
            return self.fit(signals).result()
        check_one_contact(signals, self.name)
        used, noise = self._used(signals)
        best, trials = _try_laws([self.problem(used, noise, model) for model in self._candidates(used, noise)])
        return _with_trials(self._report(best.problem, best.found).result(), best, trials)

    @property
    def _is_open(self) -> bool:
        """Whether a law is chosen from several."""
        return bool(self.laws or self.starts)

    @property
    def law(self) -> FrictionModel:
        """Friction model of the one contact; ParameterError if there is none."""
        if self.friction is None:
            raise ParameterError("maximum_likelihood.friction is missing; expected the friction model at the start")
        return self.friction

    def fit(self, signals: Signals) -> FitReport:
        """Return the fit of the one machine at the start to signals that have segments."""
        (check_one_thrust if self.frictions else check_one_contact)(signals, self.name)
        used, noise = self._used(signals)
        return self._report(self.problem(used, noise, None if self.frictions else self.law))

    def _used(self, signals: Signals) -> tuple[Signals, float]:
        """Return the records that can be fitted, and their noise [m]."""
        used = usable_signals(signals, self.output, self.name)
        check_segments(used, self.name)
        return used, noise_in_records(used, self.output, self.resolution) if self.noise is None else self.noise

    def _report(self, problem: MachineProblem, known: Fitted | None = None) -> FitReport:
        """Return the fit without parameters that the records do not tell."""
        held: list[str] = []
        found, starts = fit_machine(problem, known)
        while untold := least_told(found):  # one at a time: of two that only their sum is told, one remains
            held.append(untold)
            problem = problem.leave_out(untold)
            found, starts = fit_machine(problem)
        if NOISE not in (self.free or ()):
            return FitReport(problem.signals, found, starts, held)
        level = likely_noise(found.linear.records, float(found.fit.freedom.sum()))
        return FitReport(problem.signals, found.with_noise(level.value), starts, held, level)

    def _candidates(self, signals: Signals, noise: float) -> Sequence[FrictionModel]:
        """Return the models of the laws to choose from."""
        rough = rough_friction(signals, self._observer(Frictionless(), noise)) if self.laws else None
        return [*([rough.model(law) for law in self.laws] if rough else []), *self.starts]

    def _free_of(self, model: FrictionModel | None) -> FreeParameters:
        """Return what is free of a friction model at the one contact, or of all contacts and the plant."""
        if self._is_open:
            assert model is not None
            shape = shape_parameters(model)
            return FreeParameters((*SCALES, *shape, *(name for name in self.free or () if name == DEAD_TIME)))
        if self.frictions:
            return FreeParameters.chosen(self.free, self.frictions, self.nominal_plant)
        assert model is not None
        return FreeParameters.chosen(self.free, {"": model}, None)

    def problem(self, signals: Signals, noise: float, friction: FrictionModel | None = None) -> MachineProblem:
        """Return what is fitted to signals with this noise [m], if friction is this at the start of the one contact."""
        law = Frictionless() if friction is None else friction
        contacts = {} if self._is_open else self.frictions
        return MachineProblem(
            signals, self._observer(law, noise), self._free_of(friction), self.nominal_plant, self.modes, contacts,
            (self.thrust, self.position) if contacts else ("", ""),
        )  # fmt: skip

    def _observer(self, friction: FrictionModel, noise: float) -> EffectiveInput:
        shared = {name: getattr(self, name) for name in DelayedEstimator.model_fields}
        return EffectiveInput(
            friction=friction,
            resolution=self.resolution,
            noise=noise,
            interpolation_tolerance=self.interpolation_tolerance,
            **shared,
        )


MIN_SEGMENTS = 2 * HELD_OUT_STEP
"""The fewest records of which some can be held out: two are, six are fitted."""
RACE_RATIO = 5.0
"""Residual along the measured motion over that of a law that fits, up to which another one is fitted by replays. It
costs time alone: with half of it a simpler law may be given up that rounded positions make look worse."""
COULOMB_PARAMETERS = ("coulomb_force", "limit_force")
"""Parameters of a friction law whose sum is its force in gross sliding."""


@dataclass(frozen=True, eq=False)
class LawCandidate:
    """One law, and how far it was carried."""

    problem: MachineProblem
    """All records, and what is free of the law."""
    along: Sequence[MotionFit] = ()
    """Its fits along the measured motion, the best first; none if it did not begin."""
    found: Fitted | None = None
    """Its fit to some of the records, by replays."""
    frequency: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    """Lowest frequency of each held-out record [Hz], shape (n,)."""
    ratios: NDArray[np.float64] = field(default_factory=lambda: np.full(1, np.inf))
    """Their residuals over what noise and rounding explain, shape (n,)."""
    freedom: float = 1.0
    """Degrees of freedom of all of them."""
    failure: str = ""
    """Why it cannot be computed."""

    @property
    def model(self) -> FrictionModel:
        """The law at the start."""
        return self.problem.observer.law

    @property
    def motion_residual(self) -> float:
        """What it leaves along the measured motion, over what is allowed for; infinite if it did not begin."""
        return self.along[0].residual if self.along else np.inf

    @property
    def free(self) -> int:
        """Number of free parameters of friction."""
        return len(self.problem.free.friction)

    @property
    def ratio(self) -> float:
        """Geometric mean of the held-out residuals; infinite if the model diverges, or was not carried to the end."""
        mean = float(np.exp(np.mean(np.log(self.ratios))))
        return mean if np.isfinite(mean) else np.inf

    @property
    def criterion(self) -> float:
        """Bayesian information criterion of friction's parameters."""
        assert self.found is not None
        return self.found.criterion(self.free)

    @property
    def fits(self) -> bool:
        """Whether it leaves no more of the held-out records than noise and rounding explain."""
        return self.ratio <= float(greatest_ratio(self.freedom))

    def equals(self, other: "LawCandidate") -> bool:
        """Return whether it leaves no more of the held-out records than another law, but for chance."""
        return self.ratio**2 <= greatest_variance_ratio(self.freedom, self.freedom) * other.ratio**2

    def beats(self, other: "LawCandidate") -> bool:
        """Return whether it fits, and left less along the motion: much less, or with no more parameters."""
        is_far = other.motion_residual > RACE_RATIO * max(self.motion_residual, EXPLAINED)
        is_simple = self.motion_residual <= other.motion_residual and self.free <= other.free
        return self.fits and (is_far or is_simple)

    def begun(self, kept: Signals, start: int) -> "LawCandidate":
        """Return how the law explains the measured motion of the records that are kept, from one start more."""
        try:
            found = fits_along_motion(replace(self.problem, signals=kept), start, start + 1)
            return replace(self, along=sorted([*self.along, *found], key=lambda each: each.residual))
        except FraexpError as error:  # the other laws, and its other start, go on
            return self if self.along else replace(self, failure=str(error))

    def carried(self, kept: Signals, held_out: Signals) -> "LawCandidate":
        """Return how the law fits the records that are kept, and predicts those that are held out."""
        try:
            found, _ = joint_fit(replace(self.problem, signals=kept), self.along)
            ratios, freedom = predicted_ratios(self.problem, found, held_out)
        except FraexpError as error:
            return replace(self, failure=str(error))
        frequency = np.array([float(segment.frequency.min()) for segment in held_out.segments])
        return replace(self, found=found, frequency=frequency, ratios=ratios, freedom=freedom)


def _try_laws(problems: Sequence[MachineProblem]) -> tuple[LawCandidate, list[LawCandidate]]:
    """Return the law that predicts held-out records best, and how well all of them explain the records.

    All are fitted along the motion, the best ones by replays. A law that leaves what noise and rounding explain cannot
    be beaten, but a simpler one may be as good. If there is one, laws that left much more along the motion are not
    carried to the end, nor those that left more with no fewer parameters; slow ones do not begin.
    """
    signals = problems[0].signals
    if len(signals.segments) < MIN_SEGMENTS:
        raise RecordError(
            f"maximum_likelihood: there are {len(signals.segments)} records; expected {MIN_SEGMENTS} or more to "
            "choose a law, a quarter of which is held out: record more frequencies"
        )
    held_out = np.arange(len(signals.segments)) % HELD_OUT_STEP == HELD_OUT_STEP // 2
    kept, others = (replace(signals, segments=_select(signals, chosen)) for chosen in (~held_out, held_out))
    kept, trials = spread_records(kept), [LawCandidate(problem) for problem in problems]
    for is_fast in (True, False):
        group = [place for place, trial in enumerate(trials) if trial.model.is_vectorisable is is_fast]
        for start, place in product(range(MAX_STARTS), group if not any(trial.fits for trial in trials) else ()):
            is_explained = min(trial.motion_residual for trial in trials) < EXPLAINED
            if not start or not (is_explained or trials[place].failure):
                trials[place] = trials[place].begun(kept, start)
        for place in sorted(group, key=lambda each: trials[each].motion_residual):
            if trials[place].along and not any(other.beats(trials[place]) for other in trials):
                trials[place] = trials[place].carried(kept, others)
    if not any(trial.found for trial in trials):
        raise RecordError(f"maximum_likelihood: no law can be computed: {trials[0].failure}")
    least = min((trial for trial in trials if trial.found), key=lambda each: each.ratio)
    equal = [trial for trial in trials if trial is least or (trial.found and trial.equals(least))]
    return min(equal, key=lambda each: each.criterion), trials


def _select(signals: Signals, places: NDArray[np.bool_]) -> tuple[Segment, ...]:
    return tuple(segment for segment, is_chosen in zip(signals.segments, places, strict=True) if is_chosen)


def _with_trials(result: Result, best: LawCandidate, trials: Sequence[LawCandidate]) -> Result:
    """Return the result of the best law with what all of them leave."""
    fits, labels = best.fits, _labels(trials)
    pairs = list(zip(labels, trials, strict=True))
    left = ", ".join(f"{label} {trial.ratio:.3g}" for label, trial in pairs if trial.found)
    verdict = "predicts the records best" if fits else f"none of {len(trials)} laws fits"
    text = f"{verdict}; residual of held-out records over what noise and rounding explain: {left}"
    behind = ", ".join(
        f"{label} ({trial.motion_residual / best.motion_residual:.3g} times)"
        for label, trial in pairs
        if trial.along and not (trial.found or trial.failure)
    )
    if behind:
        text += f"; not carried to the end, as they leave more along the measured motion: {behind}"
    untried = ", ".join(label for label, trial in pairs if not (trial.along or trial.failure))
    if untried:
        text += f"; not tried, as a law explains the records: {untried}"
    chosen = Finding("remark", place=labels[trials.index(best)], text=text) if fits else Finding("misfit", text=text)
    failed = [
        Finding("remark", place=label, text=f"left out, as it cannot be computed: {trial.failure}")
        for label, trial in pairs
        if trial.failure
    ]
    result = replace(result, findings=()).with_findings(chosen, *failed, *result.findings, is_doubt=not fits)
    curves = [_held_out_curve(label, trial) for label, trial in pairs if trial.found]
    metrics = (*_coulomb_force(result), *_table(pairs), *result.metrics)
    return replace(result, metrics=metrics, curves=(*curves, *result.curves))


def _held_out_curve(label: str, trial: LawCandidate) -> Curve:
    columns = {"frequency": trial.frequency, "held-out residual over expectation": trial.ratios}
    return Curve(label, columns, dict(zip(columns, ("Hz", "1"), strict=True)))


def _table(pairs: Sequence[tuple[str, LawCandidate]]) -> Iterator[Metric]:
    for label, trial in pairs:
        if trial.along:
            yield Metric(f"{label}: residual along the motion", trial.motion_residual, "1")
        if trial.found:
            yield Metric(f"{label}: held-out residual", trial.ratio, "1")
            yield Metric(f"{label}: log-likelihood", trial.found.log_likelihood, "1")


def _coulomb_force(result: Result) -> Iterator[Metric]:
    """Yield the force of gross sliding in the friction model that was found, with its 95 % interval."""
    for fit in result.fits:
        names = [name.removeprefix("curve.").split(".")[0] for name in fit.parameters]
        is_force = np.array([name in COULOMB_PARAMETERS for name in names], dtype=bool)
        if fit.kind == "friction" and is_force.any():
            std = float(np.sqrt(fit.covariance[np.ix_(is_force, is_force)].sum()))
            unit = fit.units[int(np.argmax(is_force))]
            yield Metric("Coulomb force", float(fit.values[is_force].sum()), unit)
            yield Metric("Coulomb force, 95 %", NORMAL_QUANTILE * std, unit)


def _labels(trials: Sequence[LawCandidate]) -> list[str]:
    """Return the names of the laws, numbered where there are several models of one."""
    names = [trial.model.name for trial in trials]
    numbers = [names[: place + 1].count(name) for place, name in enumerate(names)]
    return [f"{name} {k}" if names.count(name) > 1 else name for name, k in zip(names, numbers, strict=True)]
