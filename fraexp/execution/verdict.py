"""The verdict on a response: a point is ok if its whole band lies within the accuracy that the study asks for."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import BandReach, degrees_of_freedom
from fraexp.components.kinds import Estimator
from fraexp.data.findings import Finding, Quantity
from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.study.accuracy import Accuracy

CAUSES = {
    "hidden by standstill": "band by friction",
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
            kept.append(replace(finding, frequencies=tuple(map(float, frequency[at]))))
        else:
            kept.append(finding)
    said = {finding.kind for finding in kept}
    found = (
        _too_wide(kind, frequency, where, whole, accuracy)
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
    kind: str, frequency: NDArray[np.float64], where: NDArray[np.bool_], reach: BandReach, accuracy: Accuracy
) -> Finding:
    worst = int(np.argmax(np.where(where, reach.magnitude, -1.0)))
    quantities = (
        Quantity(float(reach.magnitude[worst]), "dB", "band", float(frequency[worst])),
        Quantity(accuracy.magnitude, "dB", "accuracy"),
        Quantity(math.degrees(accuracy.phase), "°"),
    )
    return Finding(kind, quantities, tuple(map(float, frequency[where])), where.size)
