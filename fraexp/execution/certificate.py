"""The numerical certificate of a result: how far the computation itself may have falsified its response."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import Estimator
from fraexp.data.frequency_text import frequency_text
from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.data.signals import Signals, Verification
from fraexp.errors import FraexpError

COMPENSATED_ERROR_RATIO = 100.0
"""Tolerated error of a response without friction, over that of y/u: the effective input is a small difference."""
SAME_FREQUENCY = 1e-9
"""Relative difference of two frequencies that are the same."""
STEPS_REMEDY = (
    "set numerics.steps_per_sample to 0 or higher, raise numerics.tolerance, or, where the machine hardly moves, the "
    "amplitude"
)
MOTION_REMEDY = (
    "the sampled motion does not show all of the friction force; raise the amplitude, or shorten the samples"
)


def certify(estimator: Estimator, signals: Signals, result: Result, tolerance: float) -> Result:
    """Return a result with the numerical error of its response, and not as ok where that exceeds the tolerance.

    A result without a response, or whose signals were not verified, is returned as it is.
    """
    verification = signals.verification
    if verification is None or result.response is None:
        return result
    found = spread_error(result.response.frequency, verification.frequency, verification.step_error)
    compensated = compensation_error(estimator, signals, result.response)
    if compensated is not None:
        at = np.concatenate([segment.frequency for segment in verification.segments])
        found = found + spread_error(result.response.frequency, at, compensated)
    response = replace(result.response, numerical_error=found)
    limit = tolerance if compensated is None else tolerance * COMPENSATED_ERROR_RATIO
    complaint = _complaint(response, found, limit, STEPS_REMEDY if compensated is None else MOTION_REMEDY)
    if not complaint:
        return replace(result, response=response)
    outcome = Outcome.INACCURATE if result.outcome is Outcome.OK else result.outcome
    return replace(
        result, outcome=outcome, message="; ".join(filter(None, (result.message, complaint))), response=response
    )


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
    verified = replace(signals, segments=verification.segments, outcome=Outcome.OK, message="", verification=None)
    try:
        return matched.estimate(verified).response
    except FraexpError:
        return None


def _relative_error(found: FrequencyResponse, verification: Verification) -> NDArray[np.float64] | None:
    """Return the relative difference to the plant, shape (n,); None for a response at other frequencies."""
    plant = verification.plants[found.output]
    if found.response.shape != plant.shape:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(found.settled, np.abs(found.response / plant - 1), np.nan)


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


def _complaint(response: FrequencyResponse, error: NDArray[np.float64], limit: float, remedy: str) -> str:
    """Return how far a response is off, where, and what helps; empty if its error is within the limit."""
    beyond = response.settled & (np.nan_to_num(error, posinf=np.inf) > limit)
    if not beyond.any():
        return ""
    worst = int(np.argmax(np.where(beyond, error, 0.0)))
    turn = np.degrees(np.arcsin(error[worst])) if error[worst] < 1 else 180.0
    off = f"{20 * np.log10(1 + error[worst]):.2g} dB and {turn:.2g} deg"
    places = f"at {beyond.sum()} of {beyond.size} frequencies ({frequency_text(response.frequency[beyond])})"
    return f"the computation falsifies the response {places}, by {off} at {response.frequency[worst]:.4g} Hz: {remedy}"
