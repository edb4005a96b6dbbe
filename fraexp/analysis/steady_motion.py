"""Axes that move steadily while they are measured: a mean over periods takes the ramp for a sawtooth."""

from collections.abc import Sequence

import numpy as np

from fraexp.data.findings import Finding, Quantity
from fraexp.data.signals import Segment

MIN_PERIODS = 2
"""Periods from which a motion shows; two do not tell whether it is steady."""
MAX_GAIN_SCATTER = 0.25
"""Standard deviation of what a channel gains in a period, relative to the mean, up to which the motion is steady."""
MAX_LEAKAGE = 0.1
"""Error of a line, relative to it, above which a steady motion is told."""
MIN_LINE_SHARE = 0.25
"""Share of lines with such an error from which it is told: of a small drift, only few weak lines suffer."""


def find_steady_motion(segments: Sequence[Segment], name: str, unit: str) -> Finding | None:
    """Return how much a channel gains in each period, and at which lines that matters; None if nowhere.

    Segments that state whether they had settled do not move on.
    """
    return next((found for segment in segments if (found := _motion(segment, name, unit))), None)


def _motion(segment: Segment, name: str, unit: str) -> Finding | None:
    if segment.settling is not None or name not in segment.channels or len(segment.channels[name]) < MIN_PERIODS:
        return None
    periods = segment.channels[name]
    gains = np.diff(periods, axis=0).mean(axis=1)
    gain = float(gains.mean())
    if gain == 0 or np.std(gains) > MAX_GAIN_SCATTER * abs(gain):
        return None
    ramp = np.abs(np.fft.rfft(gain * np.arange(periods.shape[1]) / periods.shape[1]))[segment.lines]
    off = ramp > MAX_LEAKAGE * np.abs(np.fft.rfft(periods.mean(axis=0)))[segment.lines]
    if off.sum() <= MIN_LINE_SHARE * off.size:
        return None
    frequencies = tuple(map(float, segment.frequency[off]))
    return Finding("steady motion", (Quantity(gain, unit, "each period"),), frequencies, off.size, f"'{name}'")
