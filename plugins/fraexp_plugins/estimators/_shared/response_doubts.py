"""What makes a response to the effective input doubtful: its band, and standstill."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Accuracy,
    BandReach,
    Finding,
    Quantity,
    Result,
    at_worst,
)

MAX_STANDSTILL_ERROR = 0.01
"""Relative error of the response by standstill from which it is not ok."""
ACCURACY = Accuracy()


def judge_band(found: Result, accuracy: Accuracy = ACCURACY) -> Result:
    """Return a result that is not ok where its band reaches beyond the accuracy that is asked for.

    A finding for each part of the band that is to blame says at which frequencies, and how far the whole band reaches.
    """
    if found.response is None:
        return found
    response, whole = found.response, BandReach.of(found.response)
    wrong = response.settled & ~whole.is_within(accuracy)
    if not wrong.any():
        return found
    parts = {
        "band by friction": BandReach.of(replace(response, covariance=np.zeros_like(response.covariance))),
        "band by encoder": BandReach.of(replace(response, model_covariance=None)),
    }
    beyond = {kind: wrong & ~reach.is_within(accuracy) for kind, reach in parts.items()}
    blamed = {kind: where for kind, where in beyond.items() if where.any()} or dict.fromkeys(parts, wrong)
    return found.with_findings(
        *(_band(kind, response.frequency, where, whole, accuracy) for kind, where in blamed.items()), is_doubt=True
    )


def _band(
    kind: str, frequency: NDArray[np.float64], where: NDArray[np.bool_], reach: BandReach, accuracy: Accuracy
) -> Finding:
    worst = int(np.argmax(np.where(where, reach.magnitude, -1.0)))
    quantities = (
        Quantity(float(reach.magnitude[worst]), "dB", "band", float(frequency[worst])),
        Quantity(accuracy.magnitude, "dB", "expected"),
        Quantity(accuracy.phase, "°", "and"),
    )
    return Finding(kind, quantities, tuple(map(float, frequency[where])), where.size)


def check_standstill(
    found: Result,
    error: NDArray[np.float64] | NDArray[np.complex128],
    share: float,
    contacts: Sequence[str] = (),
    remedy: str = "",
) -> Result:
    """Return a result that is not ok where standstill may change the response, relative to it, shape (n,).

    `share` is the largest share of the time for which the machine, or one of the contacts, stands.
    """
    if found.response is None:
        return found
    error = np.where(np.isfinite(error), error, 0.0)
    wrong = np.abs(error) > MAX_STANDSTILL_ERROR
    if not wrong.any():
        return found
    finding = at_worst(
        "hidden by standstill",
        found.response.frequency,
        wrong,
        error,
        "response off by up to",
        quantities=(Quantity(100 * share, "%", "standstill"),),
        place=f"contact {' or '.join(contacts)}" if contacts else "",
        remedy=remedy,
    )
    return found.with_findings(finding, is_doubt=True)
