"""The verdict on a response: a point is ok if its whole band lies within the accuracy that the study asks for."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.band_reach import BandReach
from fraexp.analysis.confidence import degrees_of_freedom
from fraexp.components.kinds import Estimator
from fraexp.data.findings import Finding, Quantity
from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.study.accuracy import Accuracy


def judge_band(found: Result, accuracy: Accuracy, estimator: Estimator) -> Result:
    """Return a result that is not ok where the band of what its estimator relies on reaches beyond an accuracy.

    Each part of the band that alone reaches beyond it, or is the greatest, is to blame: a finding says at which
    frequencies, and how far the whole band reaches. A part that the result blames already is not repeated.
    """
    if found.response is None:
        return found
    response, whole = found.response, BandReach.of(found.response)
    size = whole.over(accuracy.magnitude, accuracy.phase)
    wrong = response.settled & estimator.relies_on(response.frequency) & (size > 1)
    parts = {kind: part.over(accuracy.magnitude, accuracy.phase) for kind, part in _parts(response).items()}
    greatest = np.maximum.reduce(list(parts.values()))
    blamed = {kind: wrong & ((part > 1) | (part == greatest)) for kind, part in parts.items()}
    said = {finding.kind for finding in found.findings}
    findings = [
        _too_wide(kind, response.frequency, where, whole, accuracy)
        for kind, where in blamed.items()
        if where.any() and kind not in said
    ]
    outcome = Outcome.INACCURATE if wrong.any() and found.outcome is Outcome.OK else found.outcome
    return replace(found.with_findings(*findings), outcome=outcome)


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
