"""What makes a response to the effective input doubtful, in words: encoder, weak terms, standstill, friction model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Accuracy,
    BandReach,
    FrequencyResponse,
    Outcome,
    Result,
    circle_factor,
    degrees_of_freedom,
    frequency_text,
)
from fraexp_plugins.estimators._shared.model_covariance import relative_radius

MAX_STANDSTILL_ERROR = 0.01
"""Relative error of the response by standstill from which it is not ok."""
MAX_ENCODER_ERROR = 0.1
"""Relative error of a response by the encoder, beside its band, from which it is not ok."""
ACCURACY = Accuracy()
FRICTION_PART = (
    "by the friction model, or the delays",
    "raise the amplitude, measure frequencies at most 1.5 times apart, whose harmonics tell how wrong the model is, or "
    "identify friction and state how well it is known (deviations, force_std, displacement_std)",
)
ENCODER_PART = (
    "by rounding and noise of the encoder",
    "raise the amplitude, use a finer encoder, or record more periods with noise",
)
"""Parts of a band: what they are by, and what narrows them."""
MIN_STATED_ERROR = 0.01
"""Relative error of a response by the encoder, beside its band, from which it is stated."""


def judge_band(found: Result, accuracy: Accuracy = ACCURACY) -> Result:
    """Return a result that is not ok where its band reaches beyond the accuracy that is asked for.

    It says at which frequencies, how far, which part of the band is to blame, and what narrows that.
    """
    if found.response is None:
        return found
    response, whole = found.response, BandReach.of(found.response)
    wrong = response.settled & ~whole.is_within(accuracy)
    if not wrong.any():
        return found
    worst = int(np.argmax(np.where(wrong, whole.magnitude, -1.0)))
    by_noise = BandReach.of(replace(response, model_covariance=None))
    by_model = BandReach.of(replace(response, covariance=np.zeros_like(response.covariance)))
    blames = [
        f"{cause}; {remedy}"
        for reach, cause, remedy in ((by_model, *FRICTION_PART), (by_noise, *ENCODER_PART))
        if (wrong & ~reach.is_within(accuracy)).any()
    ] or [f"{FRICTION_PART[0]} and {ENCODER_PART[0]} together; {FRICTION_PART[1]}"]
    size = "has no end" if np.isinf(whole.magnitude[worst]) else f"reaches to {whole.magnitude[worst]:.2g} dB"
    return with_doubt(
        found,
        f"the band is wider than {accuracy.magnitude:g} dB and {accuracy.phase:g} deg at {wrong.sum()} of {wrong.size} "
        f"frequencies ({frequency_text(response.frequency[wrong])}), and {size} at "
        f"{response.frequency[worst]:.4g} Hz: {'; '.join(blames)}",
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
