"""Which friction law? Several are fitted to the same records, and compared on records that none of them saw."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    NORMAL_QUANTILE,
    Curve,
    Finding,
    FraexpError,
    FrictionModel,
    Metric,
    Outcome,
    RecordError,
    Result,
    Segment,
    Signals,
)
from fraexp_plugins.identification.whole_record._joint_fit import likely_noise
from fraexp_plugins.identification.whole_record._machine_fit import Fitted, joint_fit, predicted_ratios
from fraexp_plugins.identification.whole_record._machine_problem import MachineProblem
from fraexp_plugins.identification.whole_record._motion_start import MotionFit, fits_along_motion

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
    def log_likelihood(self) -> float:
        """Log-likelihood per sample of the records to which it was fitted, with the noise that suits them best."""
        assert self.found is not None
        return likely_noise(self.found.linear.records, float(self.found.fit.freedom.sum())).log_likelihood

    @property
    def criterion(self) -> float:
        """Bayesian information criterion, of which the least is best (G. Schwarz, Annals of Statistics 6(2), 1978)."""
        assert self.found is not None
        samples = sum(record.residual.size for record in self.found.linear.records)
        return self.free * float(np.log(samples)) - 2 * samples * self.log_likelihood

    @property
    def fits(self) -> bool:
        """Whether it leaves no more of the held-out records than noise and rounding explain."""
        return self.ratio <= EQUAL_RATIO

    def beats(self, other: "LawCandidate") -> bool:
        """Return whether it fits, and left less along the motion: much less, or with no more parameters."""
        is_far = other.motion_residual > RACE_RATIO * max(self.motion_residual, MIN_MOTION_RESIDUAL)
        is_simple = self.motion_residual <= other.motion_residual and self.free <= other.free
        return self.fits and (is_far or is_simple)

    def begun(self, kept: Signals) -> "LawCandidate":
        """Return how the law explains the measured motion of the records that are kept."""
        try:
            return replace(self, along=fits_along_motion(replace(self.problem, signals=kept)))
        except FraexpError as error:  # the other laws go on
            return replace(self, failure=str(error))

    def carried(self, kept: Signals, held_out: Signals) -> "LawCandidate":
        """Return how the law fits the records that are kept, and predicts those that are held out."""
        try:
            found, _ = joint_fit(replace(self.problem, signals=kept), self.along)
            ratios = predicted_ratios(self.problem, found, held_out)
        except FraexpError as error:
            return replace(self, failure=str(error))
        frequency = np.array([float(segment.frequency.min()) for segment in held_out.segments])
        return replace(self, found=found, frequency=frequency, ratios=ratios)


def try_laws(problems: Sequence[MachineProblem]) -> tuple[LawCandidate, list[LawCandidate]]:
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
    held_out = np.arange(len(signals.segments)) % HELD_OUT_STEP == FIRST_HELD_OUT
    kept, others = (replace(signals, segments=_select(signals, chosen)) for chosen in (~held_out, held_out))
    trials = [LawCandidate(problem) for problem in problems]
    for is_fast in (True, False):
        group = [place for place, trial in enumerate(trials) if trial.model.is_vectorisable is is_fast]
        for place in group if not any(trial.fits for trial in trials) else ():
            trials[place] = trials[place].begun(kept)
        for place in sorted(group, key=lambda each: trials[each].motion_residual):
            if trials[place].along and not any(other.beats(trials[place]) for other in trials):
                trials[place] = trials[place].carried(kept, others)
    if not any(trial.found for trial in trials):
        raise RecordError(f"maximum_likelihood: no law can be computed: {trials[0].failure}")
    least = min(trial.ratio for trial in trials)
    best = min((trial for trial in trials if trial.ratio <= EQUAL_RATIO * least), key=lambda each: each.criterion)
    return best, trials


def _select(signals: Signals, places: NDArray[np.bool_]) -> tuple[Segment, ...]:
    return tuple(segment for segment, is_chosen in zip(signals.segments, places, strict=True) if is_chosen)


def with_verdict(result: Result, best: LawCandidate, trials: Sequence[LawCandidate]) -> Result:
    """Return the result of the best law with what all of them leave."""
    fits, labels = best.ratio <= MAX_HELD_OUT_RATIO, _labels(trials)
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
    is_right = float(fits and result.outcome is Outcome.OK)
    metrics = (Metric("verdict", is_right, "1"), *_coulomb_force(result), *_table(pairs), *result.metrics)
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


def _labels(trials: Sequence[LawCandidate]) -> list[str]:
    """Return the names of the laws, numbered where there are several models of one."""
    names = [trial.model.name for trial in trials]
    numbers = [names[: place + 1].count(name) for place, name in enumerate(names)]
    return [f"{name} {k}" if names.count(name) > 1 else name for name, k in zip(names, numbers, strict=True)]
