"""Which friction law? Several laws are fitted to the same records, and compared on records that none of them saw."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, FrictionModel, Metric, Outcome, Plant, RecordError, Result, Segment, Signals, param
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE
from fraexp_plugins.identification._shared.usable_signals import usable_signals
from fraexp_plugins.identification.whole_record._shared.contact_check import check_one_contact
from fraexp_plugins.identification.whole_record._shared.free_parameters import DEAD_TIME, SCALES
from fraexp_plugins.identification.whole_record._shared.law_starts import rough_friction
from fraexp_plugins.identification.whole_record._shared.noise_level import likely_noise, noise_in_records
from fraexp_plugins.identification.whole_record._shared.scaled_friction import shape_parameters
from fraexp_plugins.identification.whole_record._shared.staged_fit import Fitted
from fraexp_plugins.identification.whole_record.maximum_likelihood import MaximumLikelihood

HELD_OUT_STEP, FIRST_HELD_OUT, MIN_SEGMENTS = 4, 2, 8
"""Every fourth record is held out, from the third one on, and the fewest records of which some can be."""
MAX_HELD_OUT_RATIO = 1.3
"""Residual of held-out records over what noise and rounding explain, up to which a law fits."""
EQUAL_RATIO = 1.05
"""Ratio of two such residuals up to which the simpler law is taken."""
COULOMB_PARAMETERS = ("coulomb_force", "limit_force")
"""Parameters of a friction law whose sum is its force in gross sliding."""


class FrictionLawComparison(DelayedEstimator, name="friction_law_comparison", version=5):
    """Plant, friction law and its parameters, from records alone: the law that predicts records it has not seen.

    Every candidate is fitted to three quarters of the records by maximum likelihood, as `maximum_likelihood` does,
    with the scales of its force and deflection and its own shape parameters free (viscous coefficient, static force,
    Stribeck velocity, damping, attraction). What it leaves of the other records, over what noise and rounding explain,
    is 1 where law and plant are right (cross-validation: M. Stone, J. Royal Statistical Society B 36(2), 1974). The law
    with the least residual wins; of equals, that with the fewest free parameters. P̂, plant, friction and their bands
    are then those of `maximum_likelihood` with this law.

    Without `candidates` it begins with rolling elements, Dahl and LuGre, at a Coulomb force and a presliding distance
    that the observer finds from the records: nothing but units need be known of the machine. A dead time is estimated,
    too, if `estimate_dead_time` is set.

    Metrics: the Coulomb force with its 95 % interval, and for each law the residual of held-out records and the
    log-likelihood per sample of the others. `verdict` is 1 if a law fits. If none does the outcome is not ok, and the
    message gives what each of them leaves.

    Take some 16 frequencies or more, from presliding to gross sliding, or two amplitudes (`concatenated`). Laws that
    differ only in what the records do not show, such as the Stribeck effect without slow sliding, are not told apart.
    It takes some seconds where one of the laws fits. If none does, several starts are tried for each of them, and those
    that are not replayed in lanes (elastoplastic, GMS) take minutes; they are tried last, if no other law fits.
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
            return Result(signals.outcome, signals.message)
        check_one_contact(signals, self.name)
        used = usable_signals(signals, self.output, self.name)
        if len(used.segments) < MIN_SEGMENTS:
            raise RecordError(
                f"friction_law_comparison: there are {len(used.segments)} records; expected {MIN_SEGMENTS} or more, a "
                "quarter of which is held out: record more frequencies"
            )
        trials, untried = self._trials(used)
        least = min(trial.ratio for trial in trials)
        best = min((t for t in trials if t.ratio <= EQUAL_RATIO * least), key=lambda t: len(t.method.free))
        return _report(best.method.estimate(signals), trials, best, untried)

    def _trials(self, signals: Signals) -> tuple[list["_LawTrial"], list[str]]:
        """Return how the laws fit, and the names of those that were not tried.

        A law that leaves what noise and rounding explain cannot be beaten. If there is one, the others are not tried
        from several starts, and not at all if they are slow.
        """
        models = sorted(self.candidates or self._starts(signals), key=lambda each: not each.is_vectorisable)
        trials: dict[int, _LawTrial] = {}
        for is_thorough in (False, True):
            places = sorted(trials, key=lambda place: trials[place].ratio) if is_thorough else range(len(models))
            for place in places:
                has_fitting = any(trial.ratio <= EQUAL_RATIO for trial in trials.values())
                if not has_fitting or (not is_thorough and models[place].is_vectorisable):
                    trials[place] = self._trial(models[place], signals, is_thorough)
        untried = [model.name for place, model in enumerate(models) if place not in trials]
        return [trials[place] for place in sorted(trials)], untried

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

    def _trial(self, model: FrictionModel, signals: Signals, is_thorough: bool) -> "_LawTrial":
        """Return how a law fits the records, and predicts those that are held out."""
        method, noise = self._method(model), self._noise(signals)
        places = np.arange(len(signals.segments)) % HELD_OUT_STEP == FIRST_HELD_OUT
        kept = replace(signals, segments=_select(signals, ~places))
        fit = replace(method.staged_fit(kept, noise, method.free), is_thorough=is_thorough)
        found = fit.joint()
        held_out = replace(signals, segments=_select(signals, places))
        ratios = fit.predicted_ratios(found, held_out)
        frequency = np.array([float(segment.frequency.min()) for segment in held_out.segments])
        return _LawTrial(model, self._method(found.friction or model), found, frequency, ratios)


@dataclass(frozen=True)
class _LawTrial:
    """One law, fitted to some of the records."""

    model: FrictionModel
    method: MaximumLikelihood
    """The estimator that begins with the parameters found."""
    found: Fitted
    frequency: NDArray[np.float64]
    """Lowest frequency of each held-out record [Hz], shape (n,)."""
    ratios: NDArray[np.float64]
    """Their residuals over what noise and rounding explain, shape (n,)."""

    @property
    def ratio(self) -> float:
        """Geometric mean of the held-out residuals; infinite if the model diverges."""
        mean = float(np.exp(np.mean(np.log(self.ratios))))
        return mean if np.isfinite(mean) else np.inf

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood per sample of the records to which it was fitted, with the noise that suits them best."""
        return likely_noise(self.found.linear.records, float(self.found.fit.freedom.sum())).log_likelihood


def _select(signals: Signals, places: NDArray[np.bool_]) -> tuple[Segment, ...]:
    return tuple(segment for segment, is_chosen in zip(signals.segments, places, strict=True) if is_chosen)


def _report(result: Result, trials: Sequence[_LawTrial], best: _LawTrial, untried: Sequence[str]) -> Result:
    """Return the result of the best law with what all of them leave."""
    fits, labels = best.ratio <= MAX_HELD_OUT_RATIO, _labels(trials)
    left = ", ".join(f"{label} {trial.ratio:.3g}" for label, trial in zip(labels, trials, strict=True))
    verdict = f"{labels[trials.index(best)]} predicts the records best" if fits else f"none of {len(trials)} laws fits"
    text = f"{verdict}; residual of held-out records over what noise and rounding explain: {left}"
    if untried:
        text += f"; not tried, as a law explains the records: {', '.join(untried)}"
    outcome = Outcome.INACCURATE if result.outcome is Outcome.OK and not fits else result.outcome
    curves = [_held_out_curve(label, trial) for label, trial in zip(labels, trials, strict=True)]
    is_right = float(fits and outcome is Outcome.OK)
    metrics = (Metric("verdict", is_right, "1"), *_coulomb_force(result), *_table(labels, trials), *result.metrics)
    message = "; ".join(filter(None, (text, result.message)))
    return replace(result, outcome=outcome, message=message, metrics=metrics, curves=(*curves, *result.curves))


def _held_out_curve(label: str, trial: _LawTrial) -> Curve:
    columns = {"frequency": trial.frequency, "held-out residual over expectation": trial.ratios}
    return Curve(label, columns, dict(zip(columns, ("Hz", "1"), strict=True)))


def _table(labels: Sequence[str], trials: Sequence[_LawTrial]) -> Iterator[Metric]:
    for label, trial in zip(labels, trials, strict=True):
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
