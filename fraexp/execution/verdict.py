"""How far a result can be trusted: the numerical certificate of its computation, and the verdict on a response.

A point of a response is ok if its whole band lies within the accuracy that the study asks for.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import BandReach, degrees_of_freedom
from fraexp.components.kinds import Estimator
from fraexp.data.findings import Finding, Quantity
from fraexp.data.results import FrequencyResponse, Metric, Outcome, Result
from fraexp.data.signals import Signals, Verification
from fraexp.errors import FraexpError
from fraexp.study.accuracy import Accuracy

NUMERICAL_ERROR = "numerical error"
"""Name of the metric that tells how far the computation may have falsified a motion, relative to its range."""
SAME_FREQUENCY = 1e-9
"""Relative difference of two frequencies that are the same."""


def certify(estimator: Estimator, signals: Signals, result: Result, tolerance: float) -> Result:
    """Return a result with its numerical error; without a response, not as ok where it exceeds the tolerance.

    The error of a response is known at each frequency, and is added to that which the estimator states of its own
    computation: a part of its band. That of metrics and curves is a metric, the error of the motion.
    A result whose signals were not verified is returned as it is.
    """
    verification = signals.verification
    if verification is None:
        return result
    if result.response is None:
        return _certify_motion(result, verification, tolerance)
    steps = verification.further_step_errors.get(result.response.output, verification.step_error)
    standing = _standing_error(result.response, verification)
    found = spread_error(result.response.frequency, verification.frequency, steps) + standing
    compensated = compensation_error(estimator, signals, result.response)
    if compensated is not None:
        at = np.concatenate([segment.frequency for segment in verification.segments])
        found = found + spread_error(result.response.frequency, at, compensated)
    own = 0.0 if result.response.numerical_error is None else result.response.numerical_error
    stands = standing >= 1
    response = replace(result.response, numerical_error=found + own, settled=result.response.settled & ~stands)
    return _with_standstill(replace(result, response=response), stands)


def _standing_error(response: FrequencyResponse, verification: Verification) -> NDArray[np.float64]:
    """Return the motion that the computation leaves of a standstill, relative to that of the output, shape (n,).

    It is a displacement that the steps make, not a part of the motion; from 1 the output stands.
    """
    left = verification.standing_motion.get(response.output, 0.0)
    if not left:
        return np.zeros(response.frequency.size)
    return np.nan_to_num(left / response.output_amplitude)


def _with_standstill(result: Result, stands: NDArray[np.bool_]) -> Result:
    """Return a result that says at which frequencies its output stands, and has no response; the others keep theirs."""
    if result.response is None or not stands.any():
        return result
    frequencies = tuple(map(float, result.response.frequency[stands]))
    held = Finding("held by friction", (), frequencies, stands.size, result.response.output)
    outcome = result.outcome
    if outcome in (Outcome.OK, Outcome.INACCURATE):
        outcome = Outcome.NO_MOTION if stands.all() else Outcome.INACCURATE
    return replace(result, outcome=outcome, findings=(held, *result.findings))


def _certify_motion(result: Result, verification: Verification, tolerance: float) -> Result:
    """Return a result without a response with the greatest error of the motion from which it was computed."""
    known = verification.step_error[np.isfinite(verification.step_error)]
    if not known.size or not (result.metrics or result.curves):
        return result
    error = float(known.max())
    found = replace(result, metrics=(*result.metrics, Metric(NUMERICAL_ERROR, error, "1")))
    share = Quantity(100 * error, "%", "error of the motion or its force over its range")
    off = Finding("inexact computation", (share,), remedy=verification.remedy) if error > tolerance else None
    return found.with_findings(off, is_doubt=True)


def compensation_error(
    estimator: Estimator, signals: Signals, response: FrequencyResponse
) -> NDArray[np.float64] | None:
    """Return the relative error of the plant that the estimator finds if its friction model is the machine's own.

    It contains all that the sampled motion does not show, at each line of the verified segments; NaN where they had
    not settled. `response` is the estimator's own. None for an estimator that takes no friction from the input, and
    for a method that needs more than a few periods.
    """
    verification = signals.verification
    matched = estimator.matched(verification.machine) if verification else None
    if verification is None or matched is None:
        return None
    name = repr(matched.spec())
    if name not in verification.cache:
        is_own = verification.segments is signals.segments and matched.spec() == estimator.spec()
        found = response if is_own else _response_of(matched, signals, verification)
        verification.cache[name] = None if found is None else _relative_error(found, verification)
    return verification.cache[name]


def _response_of(matched: Estimator, signals: Signals, verification: Verification) -> FrequencyResponse | None:
    """Return what an estimator finds along the verified segments; None if it needs more of them."""
    verified = replace(signals, segments=verification.segments, outcome=Outcome.OK, findings=())
    try:
        return matched.estimate(verified).response
    except FraexpError:
        return None


def _relative_error(found: FrequencyResponse, verification: Verification) -> NDArray[np.float64] | None:
    """Return the difference to the plant, shape (n,), relative to what was found; None at other frequencies.

    Bands are drawn around what was found: a plant 1.7 dB below it is 18 % off, one 1.7 dB above it 22 %.
    """
    plant = verification.plants[found.output]
    if found.response.shape != plant.shape:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(found.settled, np.abs(plant / found.response - 1), np.nan)


def spread_error(
    frequency: NDArray[np.float64], verified: NDArray[np.float64], error: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return errors known at `verified` frequencies at others, shape (n,): the greater one of both neighbours."""
    known = np.isfinite(error)
    if not known.any():
        return np.full(frequency.size, np.nan)
    order = np.argsort(verified[known])
    at, values = verified[known][order], error[known][order]
    right = np.clip(np.searchsorted(at, frequency * (1 - SAME_FREQUENCY)), 0, at.size - 1)
    left = np.clip(np.searchsorted(at, frequency * (1 + SAME_FREQUENCY), side="right") - 1, 0, at.size - 1)
    return np.asarray(np.maximum(values[left], values[right]))


CAUSES = {
    "hidden by standstill": "band by friction",
    "no harmonics": "band by friction",
    "leakage": "band by noise",
    "still settling": "band by noise",
    "steady motion": "band by noise",
    "undetermined": "unknown band",
}
"""Findings of what an estimator has put into the band, by their kinds, and the part of the band that contains it."""


def judge(found: Result, accuracy: Accuracy, estimator: Estimator) -> Result:
    """Return a result that is not ok where what its estimator relies on may be off by more than an accuracy allows.

    Of a response that is where its band reaches beyond it. A finding of what the estimator has put into the band is to
    blame there; elsewhere each part of the band that alone reaches beyond it, or is the greatest: a finding says at
    which frequencies, and how far the whole band reaches. A part that the result blames already is not repeated. An
    error that no band contains is within the accuracy, and is left out, or the result is not ok.
    """
    kept = tuple(each for each in found.findings if not 0 < each.error <= accuracy.relative_error)
    is_wrong = any(each.error > 0 for each in kept)
    if found.response is not None:
        kept, is_off = _judge_band(found.response, kept, accuracy, estimator)
        is_wrong |= is_off
    outcome = Outcome.INACCURATE if is_wrong and found.outcome is Outcome.OK else found.outcome
    return replace(found, outcome=outcome, findings=kept)


def _judge_band(
    response: FrequencyResponse, findings: tuple[Finding, ...], accuracy: Accuracy, estimator: Estimator
) -> tuple[tuple[Finding, ...], bool]:
    """Return the findings with those that blame the band, and whether it is too wide anywhere."""
    frequency, whole = response.frequency, BandReach.of(response)
    size = whole.over(accuracy.magnitude, accuracy.phase)
    wrong = response.settled & estimator.relies_on(frequency) & (size > 1)
    parts = {kind: part.over(accuracy.magnitude, accuracy.phase) for kind, part in _parts(response).items()}
    greatest = np.maximum.reduce(list(parts.values()))
    blamed = {kind: wrong & ((part > 1) | (part == greatest)) for kind, part in parts.items()}
    kept = []
    for finding in findings:
        if finding.kind in CAUSES:
            at = wrong & np.isin(frequency, finding.frequencies)
            if not at.any():
                continue
            blamed[CAUSES[finding.kind]] &= ~at
            kept.append(_too_wide(finding, frequency, at, whole, accuracy))
        else:
            kept.append(finding)
    said = {finding.kind for finding in kept}
    found = (
        _too_wide(Finding(kind), frequency, where, whole, accuracy)
        for kind, where in blamed.items()
        if where.any() and kind not in said
    )
    return (*kept, *found), bool(wrong.any())


def _parts(response: FrequencyResponse) -> dict[str, BandReach]:
    """Return how far each part of a band reaches, by the kind of finding that blames it."""
    known = np.isfinite(response.covariance)
    scatter = np.where(known, response.covariance, 0.0)
    freedom = np.where(known.all(axis=(1, 2)), degrees_of_freedom(response), np.inf)
    noise = scatter * _noise_share(response)[:, None, None]
    nothing = replace(response, covariance=0 * scatter, freedom=None, model_covariance=None, numerical_error=None)
    return {
        "band by friction": BandReach.of(replace(nothing, model_covariance=response.model_covariance)),
        "band by noise": BandReach.of(replace(nothing, covariance=noise, freedom=freedom)),
        "band by distortion": BandReach.of(replace(nothing, covariance=scatter - noise, freedom=freedom)),
        "unknown band": BandReach.of(replace(nothing, covariance=np.where(known, 0.0, np.nan))),
        "inexact computation": BandReach.of(replace(nothing, numerical_error=response.numerical_error)),
    }


def _noise_share(response: FrequencyResponse) -> NDArray[np.float64]:
    """Return the share of noise in the scatter, shape (n,); the rest is what differs between realisations."""
    if response.noise_variance is None:
        return np.ones(response.frequency.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = response.noise_variance / response.standard_deviation**2
    return np.asarray(np.where(share < 1, share, 1.0))


def _too_wide(
    finding: Finding, frequency: NDArray[np.float64], where: NDArray[np.bool_], reach: BandReach, accuracy: Accuracy
) -> Finding:
    """Return a finding at the frequencies that it blames; one that has no quantities says how far the band reaches."""
    worst = int(np.argmax(np.where(where, reach.over(accuracy.magnitude, accuracy.phase), -1.0)))
    magnitude, phase, place = (float(each[worst]) for each in (*reach, frequency))
    is_by_phase = phase / accuracy.phase > magnitude / accuracy.magnitude
    quantities = (
        Quantity(math.degrees(phase), "°", "band", place) if is_by_phase else Quantity(magnitude, "dB", "band", place),
        Quantity(accuracy.magnitude, "dB", "accuracy"),
        Quantity(math.degrees(accuracy.phase), "°"),
    )
    at = tuple(map(float, frequency[where]))
    return replace(finding, quantities=finding.quantities or quantities, frequencies=at, examined=where.size)
