"""What makes a response to the effective input doubtful, in words: encoder, weak terms, standstill, friction model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, Outcome, Result, circle_factor, degrees_of_freedom, frequency_text
from fraexp_plugins.estimators._shared.friction_consistency import ModelError
from fraexp_plugins.estimators._shared.model_covariance import relative_radius

MAX_STANDSTILL_ERROR = 0.01
"""Relative error of the response by standstill from which it is not ok."""
MAX_ENCODER_ERROR = 0.1
"""Radius of the 95 % circle by noise and rounding, relative to the response, from which it is not ok: beyond, the error
of û_e is no longer small, and 1/û_e is not linear in it."""
MIN_STATED_ERROR = 0.01
"""Relative error of a response by the encoder, beside its band, from which it is stated."""
MAX_MODEL_ERROR = 0.01
"""Relative error of the response by a friction model that the harmonics contradict, from which it is not ok."""


def check_encoder(found: Result) -> Result:
    """Return a result that is not ok where errors of the encoder are no longer small against û_e."""
    if found.response is None:
        return found
    response = found.response
    error = relative_radius(response)
    error = np.where(np.isfinite(error), error, 0.0)
    wrong = response.frequency[error > MAX_ENCODER_ERROR]
    if not wrong.size:
        return found
    worst = int(np.argmax(error))
    turn = np.degrees(np.arcsin(min(error[worst], 1.0)))
    return with_doubt(
        found,
        f"friction takes nearly all of the input at {wrong.size} of {error.size} frequencies "
        f"({frequency_text(wrong)}), and rounding and noise of the encoder hide the rest: at "
        f"{response.frequency[worst]:.4g} Hz the response may be off by {20 * np.log10(1 + error[worst]):.2g} dB, "
        f"{turn:.2g} deg; raise the amplitude, use a finer encoder, or record more periods with noise",
    )


def check_unbanded_encoder(found: Result, error: NDArray[np.float64]) -> Result:
    """Return a result that says how far the encoder may move a response whose band does not contain it, shape (n,).

    It is not ok where that is no longer small.
    """
    if found.response is None:
        return found
    response = found.response
    error = np.where(response.settled & np.isfinite(error), error, 0.0)
    wide = error > np.maximum(MIN_STATED_ERROR, np.nan_to_num(relative_radius(response), posinf=np.inf))
    if not wide.any():
        return found
    worst = int(np.argmax(np.where(wide, error, 0.0)))
    message = (
        f"the confidence band does not contain what rounding and noise of the encoder do to the friction forces: at "
        f"{wide.sum()} of {wide.size} frequencies ({frequency_text(response.frequency[wide])}) they may move the "
        f"response, at {response.frequency[worst]:.4g} Hz by up to {20 * np.log10(1 + error[worst]):.2g} dB; raise the "
        "amplitude, or use a finer encoder"
    )
    if error[worst] > MAX_ENCODER_ERROR:
        return with_doubt(found, message)
    return replace(found, message=join_messages(found.message, message))


def with_doubt(found: Result, message: str) -> Result:
    """Return a result that is not ok, for the reason that the message states."""
    outcome = Outcome.INACCURATE if found.outcome is Outcome.OK else found.outcome
    return replace(found, outcome=outcome, message=join_messages(found.message, message))


def join_messages(*messages: str) -> str:
    return "; ".join(filter(None, messages))


def weak_terms_text(response: FrequencyResponse, weak: NDArray[np.float64]) -> str:
    """Return where the band may cover less than it should, and what helps; empty if nowhere.

    How much of a term that noise partly hides is motion is a guess; the band contains its scatter, not its mean.
    """
    affected = weak > circle_factor(degrees_of_freedom(response)) * response.standard_deviation
    if not affected.any():
        return ""
    return (
        f"the confidence band may cover less than 95 % at {affected.sum()} of {affected.size} frequencies "
        f"({frequency_text(response.frequency[affected])}): noise hides terms of the motion that change the friction "
        "force by more than the band is wide; record more periods, or use a finer encoder"
    )


def standstill_text(frequency: NDArray[np.float64], error: NDArray[np.complex128], share: float) -> str:
    size = np.abs(error)
    wrong, worst = frequency[size > MAX_STANDSTILL_ERROR], int(np.argmax(size))
    change = 1 + error[worst]
    magnitude, phase = abs(20 * np.log10(abs(change))), abs(np.angle(change, deg=True))
    return (
        f"the motion does not show the friction force at standstill and reversal at {wrong.size} of {frequency.size} "
        f"frequencies ({frequency_text(wrong)}): the machine stands for up to {share:.0%} of the "
        f"time, and at {frequency[worst]:.4g} Hz the response may be off by about {magnitude:.2g} dB, "
        f"{phase:.2g} deg; raise the amplitude, or keep the axis moving (excitation "
        "moving_sine, estimator moving_axis)"
    )


def check_contact_standstill(
    found: Result, error: NDArray[np.float64], contacts: Sequence[str], share: float
) -> Result:
    """Return a result that is not ok where standstill at contacts may change the response, relative to it, shape (n,).

    `share` is the largest share of the time for which one of them stands.
    """
    if found.response is None:
        return found
    error = np.where(found.response.settled & np.isfinite(error), error, 0.0)
    wrong, worst = error > MAX_STANDSTILL_ERROR, int(np.argmax(error))
    if not wrong.any():
        return found
    frequency = found.response.frequency
    off = f"by up to {20 * np.log10(1 + error[worst]):.2g} dB" if error[worst] < 1 else "by any amount"
    return with_doubt(
        found,
        f"the motion does not show the friction force at standstill and reversal at {wrong.sum()} of {wrong.size} "
        f"frequencies ({frequency_text(frequency[wrong])}): contact {' or '.join(contacts)} stands for up to "
        f"{share:.0%} of the time, and at {frequency[worst]:.4g} Hz the response may be off {off}; raise the "
        "amplitude, or estimate plant and friction along the whole record (maximum_likelihood)",
    )


def check_friction_model(found: Result, error: ModelError | None) -> Result:
    """Return a result that is not ok where the harmonics contradict the friction model by more than its band says."""
    suspect = "the friction model, or the delays,"
    remedy = (
        "estimate friction too (maximum_likelihood), or state the model's uncertainty (force_std, displacement_std)"
    )
    return _check_suspects(found, error, suspect, remedy)


def check_friction_models(found: Result, error: ModelError | None) -> Result:
    """Return the same for friction models at several contacts, and the plant by which they act at a distance."""
    suspect = "the friction models, the nominal plant or the delays"
    remedy = (
        "identify the friction of each contact again, raise the amplitude, or state the uncertainty of the nominal "
        "plant (plant_deviations)"
    )
    return _check_suspects(found, error, suspect, remedy)


def _check_suspects(found: Result, error: ModelError | None, suspect: str, remedy: str) -> Result:
    if found.response is None or error is None:
        return found
    response, size = found.response, error.response_error(found.response)
    known = np.hypot(np.nan_to_num(relative_radius(response), posinf=np.inf), _stated_model_error(response))
    wrong = size > np.maximum(MAX_MODEL_ERROR, known)
    if not wrong.any():
        return found
    worst = int(np.argmax(np.where(wrong, size, 0.0)))
    off = f"by about {20 * np.log10(1 + size[worst]):.2g} dB" if size[worst] < 1 else "by any amount"
    places = f"{wrong.sum()} of {wrong.size} frequencies ({frequency_text(response.frequency[wrong])})"
    return with_doubt(
        found,
        f"the harmonics of the motion contradict {suspect} by about {error.size:.2g} of the friction force: at "
        f"{places} the response depends on it, and at {response.frequency[worst]:.4g} Hz it may be off {off}; {remedy}",
    )


def _stated_model_error(response: FrequencyResponse) -> NDArray[np.float64]:
    """Return the relative error of 1/response by what is stated of the friction model's error, shape (n,)."""
    if response.model_covariance is None:
        return np.zeros(response.frequency.size)
    variance = np.trace(response.model_covariance, axis1=1, axis2=2)
    exact = np.full(variance.size, np.inf)
    return np.asarray(circle_factor(exact) * np.sqrt(variance) * np.abs(response.response))
