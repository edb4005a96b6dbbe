"""The clock of a record: it must be uniform, without gaps, and at the stated rate."""

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import RecordError

MAX_JITTER = 1e-3
"""Largest relative deviation of a time step from the usual one, and of the stated rate from the clock."""
GAP_RATIO = 1.5
"""Time step relative to the usual one above which it is a gap."""


def sample_rate_of(time: NDArray[np.float64], place: str) -> float:
    """Return the sample rate [Hz] of a time column [s], shape (n,); RecordError if it is not uniform."""
    steps = np.diff(time)
    usual = float(np.median(steps)) if steps.size else 0.0
    backward = np.flatnonzero(steps <= 0)
    if usual <= 0 or backward.size:
        where = int(backward[0]) + 1 if backward.size else 1
        raise RecordError(f"{place} does not increase after sample {where}; expected one sample after the other")
    uneven = np.flatnonzero(np.abs(steps / usual - 1) > MAX_JITTER)
    if uneven.size:
        raise _uneven_error(time, steps, usual, uneven, place)
    mean = (time[-1] - time[0]) / steps.size
    return float(f"{1 / mean:.10g}")  # the resolution of a column of decimal fractions


def _uneven_error(
    time: NDArray[np.float64], steps: NDArray[np.float64], usual: float, uneven: NDArray[np.intp], place: str
) -> RecordError:
    first = int(uneven[0])
    where = f"after sample {first + 1} ({time[first]:.6g} s)"
    others = f", and {uneven.size - 1} more" if uneven.size > 1 else ""
    if steps[first] > GAP_RATIO * usual:
        return RecordError(
            f"{place} has a gap of {steps[first]:.4g} s {where}{others}; expected a step of {usual:.4g} s: "
            "cut the record there"
        )
    return RecordError(
        f"{place} steps by {steps[first]:.6g} s {where}{others}; expected {usual:.6g} s within {MAX_JITTER:.1%}: "
        "resample it, or leave out time and give sample_rate if only the written time is uneven"
    )


def agreed_rate(stated: float | None, clock: float | None, place: str) -> float:
    """Return the sample rate [Hz] of the study or of the file's clock, one of which is known; both must agree."""
    if stated is not None and clock is not None and abs(stated / clock - 1) > MAX_JITTER:
        raise RecordError(
            f"{place}: sample_rate is {stated:.6g} Hz, but the time in the file says {clock:.6g} Hz; correct one"
        )
    return float(stated if stated is not None else clock or 0.0)
