"""Plant and friction parameters of greatest likelihood: every sample of the records, through a simulated machine."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    NORMAL_QUANTILE,
    Curve,
    Finding,
    FrictionModel,
    Metric,
    ParameterError,
    Plant,
    PositionDependentFriction,
    RecordError,
    Result,
    Signals,
    param,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._law_comparison import Prediction, best_of, fit_each
from fraexp_plugins.identification._law_numbers import shape_parameters
from fraexp_plugins.identification._likelihood import greatest_ratio, likely_noise, noise_in_records
from fraexp_plugins.identification._machine_fit import (
    FitReport,
    Fitted,
    fit_machine,
    joint_fit,
    least_told,
    predicted_ratios,
)
from fraexp_plugins.identification._machine_problem import DEAD_TIME, NOISE, SCALES, FreeParameters, MachineProblem
from fraexp_plugins.identification._motion_start import RoughFriction, fits_along_motion, rough_friction, spread_records
from fraexp_plugins.identification._usable_records import (
    HELD_OUT_STEP,
    check_one_contact,
    check_one_thrust,
    check_segments,
    usable_signals,
)


class MaximumLikelihood(DelayedEstimator, name="maximum_likelihood", version=17):
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
    shape parameters free (viscous coefficient, static force, Stribeck velocity, damping, attraction, and pure
    numbers without a default), and predicts the others (cross-validation: M. Stone, J. Royal Statistical Society B
    36(2), 1974). The simplest law that an F test does not tell from the one with the smallest residual wins. `laws`
    are names of any laws, your own included: the search begins at numbers of the sizes that their units imply, and
    at those of the law's first preset where units do not imply any. Laws that cannot run in lanes (elastoplastic,
    GMS) take minutes and are tried only if no other law fits. A law that cannot be computed is named. It is ok if a
    law fits. Use 16 frequencies or more, from presliding to gross sliding, or two amplitudes (`concatenated`).

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
        trials, remarks = _try_laws([self.problem(used, noise, model) for model in self._candidates(used, noise)])
        best = best_of(trials, lambda trial: trial.prediction)
        return _with_trials(self._report(best.problem, best.found).result(), best, trials, remarks)

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
COULOMB_PARAMETERS = ("coulomb_force", "limit_force")
"""Parameters of a friction law whose sum is its force in gross sliding."""


@dataclass(frozen=True, eq=False)
class LawTrial:
    """One law, as it was fitted to some of the records."""

    problem: MachineProblem
    """All records, and what is free of the law."""
    motion_residual: float
    """What it leaves along the measured motion, over what is allowed for."""
    found: Fitted
    """Its fit to some of the records, by replays."""
    frequency: NDArray[np.float64]
    """Lowest frequency of each held-out record [Hz], shape (n,)."""
    ratios: NDArray[np.float64]
    """Their residuals over what noise and rounding explain, shape (n,)."""
    freedom: float
    """Degrees of freedom of all of them."""

    @classmethod
    def of(cls, kept: Signals, held_out: Signals, problem: MachineProblem) -> "LawTrial":
        """Return how a law fits the records that are kept, and predicts those that are held out."""
        few = replace(problem, signals=kept)
        along = fits_along_motion(few)
        found, _ = joint_fit(few, along)
        ratios, freedom = predicted_ratios(problem, found, held_out)
        frequency = np.array([float(segment.frequency.min()) for segment in held_out.segments])
        return cls(problem, along[0].residual, found, frequency, ratios, freedom)

    @cached_property
    def prediction(self) -> Prediction:
        """The geometric mean of the held-out residuals; infinite if the model diverges."""
        mean = float(np.exp(np.mean(np.log(self.ratios))))
        return Prediction(mean if np.isfinite(mean) else np.inf, self.freedom, len(self.problem.free.friction))

    @property
    def fits(self) -> bool:
        """Whether it leaves no more of the held-out records than noise and rounding explain."""
        return self.prediction.error <= float(greatest_ratio(self.freedom))


def _try_laws(problems: Sequence[MachineProblem]) -> tuple[list[LawTrial], list[Finding]]:
    """Return how well laws predict held-out records, those that cannot run in lanes only if no other one fits.

    The remarks are on laws that cannot be computed, or are not tried.
    """
    signals = problems[0].signals
    if len(signals.segments) < MIN_SEGMENTS:
        raise RecordError(
            f"maximum_likelihood: there are {len(signals.segments)} records; expected {MIN_SEGMENTS} or more to "
            "choose a law, a quarter of which is held out: record more frequencies"
        )
    held_out = np.arange(len(signals.segments)) % HELD_OUT_STEP == HELD_OUT_STEP // 2
    kept, others = (replace(signals, segments=tuple(compress(signals.segments, at))) for at in (~held_out, held_out))
    fast, slow = ([p for p in problems if p.observer.law.is_vectorisable is each] for each in (True, False))
    few, trials = spread_records(kept), list[LawTrial]()

    def candidates() -> Iterator[MachineProblem]:
        yield from fast
        if not any(trial.fits for trial in trials):
            yield from slow
            slow.clear()

    def fit(problem: MachineProblem) -> LawTrial:
        trials.append(LawTrial.of(few, others, problem))
        return trials[-1]

    _, remarks = fit_each(candidates(), fit, lambda problem: problem.observer.law.name)
    text = "not tried, as another law explains the records"
    return trials, [*remarks, *(Finding("remark", place=each.observer.law.name, text=text) for each in slow)]


def _with_trials(result: Result, best: LawTrial, trials: Sequence[LawTrial], remarks: Sequence[Finding]) -> Result:
    """Return the result of the best law with what all of them leave."""
    fits, labels = best.fits, _labels(trials)
    pairs = list(zip(labels, trials, strict=True))
    left = ", ".join(f"{label} {trial.prediction.error:.3g}" for label, trial in pairs)
    verdict = "predicts the records best" if fits else f"none of {len(trials)} laws fits"
    text = f"{verdict}; residual of held-out records over what noise and rounding explain: {left}"
    chosen = Finding("remark", place=labels[trials.index(best)], text=text) if fits else Finding("misfit", text=text)
    result = replace(result, findings=()).with_findings(chosen, *remarks, *result.findings, is_doubt=not fits)
    curves = [_held_out_curve(label, trial) for label, trial in pairs]
    metrics = (*_coulomb_force(result), *_table(pairs), *result.metrics)
    return replace(result, metrics=metrics, curves=(*curves, *result.curves))


def _held_out_curve(label: str, trial: LawTrial) -> Curve:
    columns = {"frequency": trial.frequency, "held-out residual over expectation": trial.ratios}
    return Curve(label, columns, dict(zip(columns, ("Hz", "1"), strict=True)))


def _table(pairs: Sequence[tuple[str, LawTrial]]) -> Iterator[Metric]:
    for label, trial in pairs:
        yield Metric(f"{label}: residual along the motion", trial.motion_residual, "1")
        yield Metric(f"{label}: held-out residual", trial.prediction.error, "1")
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


def _labels(trials: Sequence[LawTrial]) -> list[str]:
    """Return the names of the laws, numbered where there are several models of one."""
    names = [trial.problem.observer.law.name for trial in trials]
    numbers = [names[: place + 1].count(name) for place, name in enumerate(names)]
    return [f"{name} {k}" if names.count(name) > 1 else name for name, k in zip(names, numbers, strict=True)]
