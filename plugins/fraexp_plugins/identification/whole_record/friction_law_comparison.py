"""Which friction law? Several laws are fitted to the same records, and compared on records that none of them saw."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Curve,
    Finding,
    FrictionModel,
    Metric,
    Outcome,
    Plant,
    RecordError,
    Result,
    Segment,
    Signals,
    param,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE
from fraexp_plugins.identification._shared.law_numbers import shape_parameters
from fraexp_plugins.identification._shared.usable_records import check_one_contact, usable_signals
from fraexp_plugins.identification.whole_record._fitted_records import Fitted
from fraexp_plugins.identification.whole_record._free_parameters import DEAD_TIME, SCALES
from fraexp_plugins.identification.whole_record._joint_fit import likely_noise, noise_in_records
from fraexp_plugins.identification.whole_record._motion_fit import MotionFit, fit_along_motion, rough_friction
from fraexp_plugins.identification.whole_record._staged_fit import StagedFit
from fraexp_plugins.identification.whole_record.maximum_likelihood import MaximumLikelihood

HELD_OUT_STEP, FIRST_HELD_OUT, MIN_SEGMENTS = 4, 2, 8
"""Every fourth record is held out, from the third one on, and the fewest records of which some can be."""
MAX_HELD_OUT_RATIO = 1.3
"""Residual of held-out records over what noise and rounding explain, up to which a law fits."""
EQUAL_RATIO = 1.05
"""Ratio of two such residuals up to which the laws are equal, and an information criterion decides."""
RACE_RATIO, MIN_MOTION_RESIDUAL = 5.0, 0.1
"""Residual along the measured motion over that of the best law, and the least that counts, up to which a law is fitted
by replays although another one fits."""
COULOMB_PARAMETERS = ("coulomb_force", "limit_force")
"""Parameters of a friction law whose sum is its force in gross sliding."""


class FrictionLawComparison(DelayedEstimator, name="friction_law_comparison", version=10):
    """Plant, friction law and its parameters, from records alone: the law that predicts records it has not seen.

    Every candidate is fitted to three quarters of the records by maximum likelihood, as `maximum_likelihood` does,
    with the scales of its force and deflection and its own shape parameters free (viscous coefficient, static force,
    Stribeck velocity, damping, attraction). What it leaves of the other records, over what noise and rounding explain,
    is 1 where law and plant are right (cross-validation: M. Stone, J. Royal Statistical Society B 36(2), 1974). The law
    with the least residual wins; of equals, such as Dahl's law and LuGre's, which contains it, that with the least
    Bayesian information criterion, which is the simpler one unless the other is much more likely. P̂, plant, friction
    and their bands are then those of `maximum_likelihood` with this law.

    Before that the measured motion drives every law, with a plant beside it. What is left of the control input at the
    excited lines and, of sines, their odd harmonics, tells in which order laws are fitted, and where each fit begins.
    Where a law fits, those that left five times as much, or more with no fewer parameters, are not carried to the end;
    the message names them.

    Without `candidates` it begins with rolling elements, Dahl and LuGre, at a Coulomb force and a presliding distance
    that the observer finds from the records: nothing but units need be known of the machine. A dead time is estimated,
    too, if `estimate_dead_time` is set.

    Metrics: the Coulomb force with its 95 % interval, and for each law the residual along the measured motion, that of
    held-out records and the log-likelihood per sample of the others. `verdict` is 1 if a law fits. If none does the
    outcome is not ok, and the message gives what each of them leaves.

    Take some 16 frequencies or more, from presliding to gross sliding, or two amplitudes (`concatenated`). Laws that
    differ only in what the records do not show, such as the Stribeck effect without slow sliding, are not told apart.
    It takes some seconds where one of the laws fits. If none does, several starts are tried for those that left least.
    Laws that are not replayed in lanes (elastoplastic, GMS) take minutes; they are tried last, if no other law fits.
    """

    candidates: tuple[FrictionModel, ...] = param(
        "", "friction models at the start, each with its name and parameters; three laws if none is given", ()
    )
    estimate_dead_time: bool = param("", "whether the dead time is estimated, from `input_dead_time` on", False)
    nominal_plant: Plant | None = param("", "plant at the harmonics; fitted to the response if it is not given", None)
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

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It needs eight records or more; here it is tried with three.",
    )

    def model_post_init(self, context: object) -> None:
        """Check that every candidate can be fitted."""
        for model in self.candidates:
            self._method(model)

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with the law that predicts best, what all laws leave, and the verdict."""
        signals.unit(self.input), signals.unit(self.output)
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        check_one_contact(signals, self.name)
        used = usable_signals(signals, self.output, self.name)
        if len(used.segments) < MIN_SEGMENTS:
            raise RecordError(
                f"friction_law_comparison: there are {len(used.segments)} records; expected {MIN_SEGMENTS} or more, a "
                "quarter of which is held out: record more frequencies"
            )
        trials = self._trials(used)
        least = min(trial.ratio for trial in trials)
        best = min((trial for trial in trials if trial.ratio <= EQUAL_RATIO * least), key=lambda each: each.criterion)
        return _report(best.method.estimate(signals), trials, best)

    def _trials(self, signals: Signals) -> list["_LawTrial"]:
        """Return how well the laws explain the records: all of them along the motion, the best ones by replays.

        A law that leaves what noise and rounding explain cannot be beaten, but a simpler one may be as good. If there
        is one, laws that left much more along the motion are not carried to the end, nor those that left more with no
        fewer parameters; slow ones do not begin. If there is none, several starts are tried for the laws that left
        least.
        """
        held_out = np.arange(len(signals.segments)) % HELD_OUT_STEP == FIRST_HELD_OUT
        kept = replace(signals, segments=_select(signals, ~held_out))
        others = replace(signals, segments=_select(signals, held_out))
        trials = [_LawTrial(model, self._method(model)) for model in self.candidates or self._starts(signals)]
        for is_fast in (True, False):
            group = [place for place, trial in enumerate(trials) if trial.model.is_vectorisable is is_fast]
            if _has_fitting(trials):
                break
            for place in group:
                along = fit_along_motion(self._staged_fit(trials[place].method, kept))
                trials[place] = replace(trials[place], along=along)
            for place in sorted(group, key=lambda each: trials[each].motion_residual):
                if not _has_fitting(trials) or (_is_near(trials[place], trials) and _may_win(trials[place], trials)):
                    trials[place] = self._carried(trials[place], kept, others)
        for place in sorted(range(len(trials)), key=lambda each: trials[each].motion_residual):
            if _is_near(trials[place], trials) and not _has_fitting(trials):
                again = self._carried(trials[place], kept, others, is_thorough=True)
                trials[place] = min(trials[place], again, key=lambda trial: trial.ratio)
        return trials

    def _common_parameters(self) -> dict[str, object]:
        names = set(type(self).model_fields) & set(MaximumLikelihood.model_fields)
        return {name: getattr(self, name) for name in names}

    def _method(self, model: FrictionModel) -> MaximumLikelihood:
        free = (*SCALES, *shape_parameters(model), *((DEAD_TIME,) if self.estimate_dead_time else ()))
        return MaximumLikelihood(friction=model, free=free, **self._common_parameters())

    def _starts(self, signals: Signals) -> list[FrictionModel]:
        fields = set(EffectiveInput.model_fields) & set(type(self).model_fields)
        given = {name: getattr(self, name) for name in fields}
        observer = EffectiveInput(friction=Frictionless(), **{**given, "noise": self._noise(signals)})
        return rough_friction(signals, observer).models()

    def _noise(self, signals: Signals) -> float:
        return noise_in_records(signals, self.output, self.resolution) if self.noise is None else self.noise

    def _staged_fit(self, method: MaximumLikelihood, signals: Signals) -> StagedFit:
        return method.staged_fit(signals, self._noise(signals), method.own_free)

    def _carried(self, trial: "_LawTrial", kept: Signals, held_out: Signals, is_thorough: bool = False) -> "_LawTrial":
        """Return how a law fits the records that are kept, and predicts those that are held out."""
        staged, along = self._staged_fit(self._method(trial.model), kept), trial.along
        assert along is not None
        found = staged.joint() if is_thorough else staged.joint_from(along.plant, along.shared)
        method = self._method(found.friction or trial.model)
        frequency = np.array([float(segment.frequency.min()) for segment in held_out.segments])
        ratios = staged.predicted_ratios(found, held_out)
        return replace(trial, method=method, found=found, frequency=frequency, ratios=ratios)


@dataclass(frozen=True, eq=False)
class _LawTrial:
    """One law, and how far it was carried."""

    model: FrictionModel
    method: MaximumLikelihood
    """The estimator that begins with the parameters found."""
    along: MotionFit | None = None
    """Its fit along the measured motion; None if it did not begin."""
    found: Fitted | None = None
    """Its fit to some of the records, by replays."""
    frequency: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    """Lowest frequency of each held-out record [Hz], shape (n,)."""
    ratios: NDArray[np.float64] = field(default_factory=lambda: np.full(1, np.inf))
    """Their residuals over what noise and rounding explain, shape (n,)."""

    @property
    def motion_residual(self) -> float:
        """What it leaves along the measured motion, over what is allowed for; infinite if it did not begin."""
        return self.along.residual if self.along else np.inf

    @property
    def ratio(self) -> float:
        """Geometric mean of the held-out residuals; infinite if the model diverges, or was not carried to the end."""
        mean = float(np.exp(np.mean(np.log(self.ratios))))
        return mean if np.isfinite(mean) else np.inf

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood per sample of the records to which it was fitted, with the noise that suits them best."""
        assert self.found is not None
        return likely_noise(self.found.linear.records, float(self.found.fit.freedom.sum())).log_likelihood

    @property
    def criterion(self) -> float:
        """Bayesian information criterion, of which the least is best (G. Schwarz, Annals of Statistics 6(2), 1978)."""
        assert self.found is not None
        samples = sum(record.residual.size for record in self.found.linear.records)
        return len(self.method.own_free) * float(np.log(samples)) - 2 * samples * self.log_likelihood


def _has_fitting(trials: Sequence[_LawTrial]) -> bool:
    """Say whether a law leaves no more of the held-out records than noise and rounding explain."""
    return any(trial.ratio <= EQUAL_RATIO for trial in trials)


def _may_win(trial: _LawTrial, trials: Sequence[_LawTrial]) -> bool:
    """Say whether no law that fits leaves less along the motion with as few free parameters."""
    return not any(
        other.ratio <= EQUAL_RATIO
        and other.motion_residual <= trial.motion_residual
        and len(other.method.own_free) <= len(trial.method.own_free)
        for other in trials
    )


def _is_near(trial: _LawTrial, trials: Sequence[_LawTrial]) -> bool:
    """Say whether a law leaves about as little along the motion as the best one."""
    least = min(each.motion_residual for each in trials)
    return trial.motion_residual <= RACE_RATIO * max(least, MIN_MOTION_RESIDUAL)


def _select(signals: Signals, places: NDArray[np.bool_]) -> tuple[Segment, ...]:
    return tuple(segment for segment, is_chosen in zip(signals.segments, places, strict=True) if is_chosen)


def _report(result: Result, trials: Sequence[_LawTrial], best: _LawTrial) -> Result:
    """Return the result of the best law with what all of them leave."""
    fits, labels = best.ratio <= MAX_HELD_OUT_RATIO, _labels(trials)
    pairs = list(zip(labels, trials, strict=True))
    left = ", ".join(f"{label} {trial.ratio:.3g}" for label, trial in pairs if trial.found)
    verdict = "predicts the records best" if fits else f"none of {len(trials)} laws fits"
    text = f"{verdict}; residual of held-out records over what noise and rounding explain: {left}"
    behind = ", ".join(
        f"{label} ({trial.motion_residual / best.motion_residual:.3g} times)"
        for label, trial in pairs
        if trial.along and not trial.found
    )
    if behind:
        text += f"; not carried to the end, as they leave more along the measured motion: {behind}"
    untried = ", ".join(label for label, trial in pairs if not trial.along)
    if untried:
        text += f"; not tried, as a law explains the records: {untried}"
    chosen = Finding("remark", place=labels[trials.index(best)], text=text) if fits else Finding("misfit", text=text)
    result = replace(result, findings=()).with_findings(chosen, *result.findings, is_doubt=not fits)
    curves = [_held_out_curve(label, trial) for label, trial in pairs if trial.found]
    is_right = float(fits and result.outcome is Outcome.OK)
    metrics = (Metric("verdict", is_right, "1"), *_coulomb_force(result), *_table(pairs), *result.metrics)
    return replace(result, metrics=metrics, curves=(*curves, *result.curves))


def _held_out_curve(label: str, trial: _LawTrial) -> Curve:
    columns = {"frequency": trial.frequency, "held-out residual over expectation": trial.ratios}
    return Curve(label, columns, dict(zip(columns, ("Hz", "1"), strict=True)))


def _table(pairs: Sequence[tuple[str, _LawTrial]]) -> Iterator[Metric]:
    for label, trial in pairs:
        if trial.along:
            yield Metric(f"{label}: residual along the motion", trial.motion_residual, "1")
        if trial.found:
            yield Metric(f"{label}: held-out residual", trial.ratio, "1")
            yield Metric(f"{label}: log-likelihood", trial.log_likelihood, "1")


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


def _labels(trials: Sequence[_LawTrial]) -> list[str]:
    """Return the names of the laws, numbered where there are several models of one."""
    names = [trial.model.name for trial in trials]
    numbers = [names[: place + 1].count(name) for place, name in enumerate(names)]
    return [f"{name} {k}" if names.count(name) > 1 else name for name, k in zip(names, numbers, strict=True)]
