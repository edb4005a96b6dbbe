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

ACCURACY = Accuracy()
CONTACTS_REMEDY = "raise the amplitude, or estimate plant and friction along the whole record (maximum_likelihood)"
"""What helps where one of several contacts stands."""


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


def with_standstill(
    found: Result,
    error: NDArray[np.float64] | NDArray[np.complex128],
    share: float,
    contacts: Sequence[str] = (),
    accuracy: Accuracy = ACCURACY,
) -> Result:
    """Return a result whose band contains the relative error by standstill as a standard deviation, shape (n,).

    Where that makes the band too wide it is not ok. `share` is the largest share of the time for which the machine, or
    one of the contacts, stands.
    """
    response = found.response
    if response is None:
        return found
    error = np.where(np.isfinite(error), error, 0.0)
    unseen = (np.abs(error / response.response) ** 2 / 2)[:, None, None] * np.eye(2)
    model = unseen if response.model_covariance is None else response.model_covariance + unseen
    alone = replace(response, covariance=np.zeros_like(response.covariance), model_covariance=unseen)
    whole = replace(response, model_covariance=model)
    was_within, *are_within = (BandReach.of(each).is_within(accuracy) for each in (response, alone, whole))
    wrong = (error != 0) & (~are_within[0] | (was_within & ~are_within[1]))
    found = replace(found, response=whole)
    if not wrong.any():
        return found
    finding = at_worst(
        "hidden by standstill",
        response.frequency,
        wrong,
        error,
        "response off by up to",
        quantities=(Quantity(100 * share, "%", "standstill"),),
        place=f"contact {' or '.join(contacts)}" if contacts else "",
        remedy=CONTACTS_REMEDY if contacts else "",
    )
    return found.with_findings(finding, is_doubt=True)
