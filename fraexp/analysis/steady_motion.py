"""Steady motion during a record, which a mean over periods takes for a part of the response."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import interval_factor
from fraexp.data.findings import Finding, Quantity, at_worst
from fraexp.data.signals import Segment


def steady_gain(segment: Segment, name: str) -> float:
    """Return how much a channel gains in each period, in the mean; 0 if that scatters about 0.

    Segments that state whether they had settled do not move on.
    """
    periods = segment.channels.get(name)
    if periods is None or segment.settling is not None or len(periods) < 2:
        return 0.0
    gains = np.diff(periods, axis=0).mean(axis=1)
    gain, count = float(gains.mean()), gains.size
    scatter = float(np.std(gains, ddof=1) / np.sqrt(count)) * float(interval_factor(count - 1)) if count > 1 else 0.0
    return gain if abs(gain) > scatter else 0.0


def steady_leakage(segment: Segment, name: str) -> NDArray[np.complex128]:
    """Return the relative error of a channel's mean phasors by what it gains in each period, complex, (lines,)."""
    gain = steady_gain(segment, name)
    if not gain:
        return np.zeros(segment.lines.size, dtype=complex)
    periods = segment.channels[name]
    ramp = np.fft.rfft(gain * np.arange(segment.samples) / segment.samples)[segment.lines]
    line = np.fft.rfft(periods.mean(axis=0))[segment.lines]
    return np.divide(ramp, line, out=np.zeros_like(line), where=line != 0)


def with_steady_motion(
    segments: Sequence[Segment],
    name: str,
    unit: str,
    error: NDArray[np.complex128],
    frequency: NDArray[np.float64],
    response: NDArray[np.complex128],
    covariance: NDArray[np.float64],
) -> tuple[NDArray[np.float64], Finding | None]:
    """Return a covariance with the error by a steady motion where that is most of it, (n, 2, 2), and where that is.

    The relative error, response and frequency [Hz] have the shape (n,).
    """
    square = np.nan_to_num(np.abs(error * response)) ** 2
    where = square > np.nan_to_num(np.trace(covariance, axis1=1, axis2=2))
    if not where.any():
        return covariance, None
    gain = max((steady_gain(segment, name) for segment in segments), key=abs)
    each = (Quantity(gain, unit, "each period"),)
    words = "response off by about"
    found = at_worst("steady motion", frequency, where, np.abs(error), words, quantities=each, place=f"'{name}'")
    return covariance + np.where(where, square, 0.0)[:, None, None] * (np.eye(2) / 2), found
