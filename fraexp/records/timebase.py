"""The clock of a record: uniform, without gaps, and at the rate that the study states."""

import numpy as np

from fraexp.errors import RecordError

JITTER = 1e-3
"""Greatest deviation of a time step from the usual one, and of the stated rate from the clock's, relative."""
GAP = 1.5
"""Times the usual step from which a step is called a gap."""


def rate_of(time: np.ndarray, place: str) -> float:
    """Return the sample rate [Hz] of a time column [s], shape (n,); RecordError says where it is not uniform."""
    steps = np.diff(time)
    usual = float(np.median(steps)) if steps.size else 0.0
    backward = np.flatnonzero(steps <= 0)
    if usual <= 0 or backward.size:
        where = int(backward[0]) + 1 if backward.size else 1
        raise RecordError(f"{place} does not increase after sample {where}; expected one sample after the other")
    uneven = np.flatnonzero(np.abs(steps / usual - 1) > JITTER)
    if uneven.size:
        raise _uneven(time, steps, usual, uneven, place)
    mean = (time[-1] - time[0]) / steps.size
    return float(f"{1 / mean:.10g}")  # what a column of decimal fractions can tell


def _uneven(time: np.ndarray, steps: np.ndarray, usual: float, uneven: np.ndarray, place: str) -> RecordError:
    first = int(uneven[0])
    where = f"after sample {first + 1} ({time[first]:.6g} s)"
    others = f", and {uneven.size - 1} more" if uneven.size > 1 else ""
    if steps[first] > GAP * usual:
        return RecordError(
            f"{place} has a gap of {steps[first]:.4g} s {where}{others}; expected a step of {usual:.4g} s: "
            "cut the record there"
        )
    return RecordError(
        f"{place} steps by {steps[first]:.6g} s {where}{others}; expected {usual:.6g} s within {JITTER:.1%}: "
        "resample it, or leave out time and give sample_rate if only the written time is uneven"
    )


def agreed_rate(stated: float | None, clock: float | None, place: str) -> float:
    """Return the sample rate [Hz] from the study or the file's clock, of which one is known; they must agree."""
    if stated is not None and clock is not None and abs(stated / clock - 1) > JITTER:
        raise RecordError(
            f"{place}: sample_rate is {stated:.6g} Hz, but the time in the file says {clock:.6g} Hz; correct one"
        )
    return float(stated if stated is not None else clock or 0.0)
