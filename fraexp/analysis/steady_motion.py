"""Axes that move steadily while they are measured: a mean over periods takes the ramp for a sawtooth."""

from collections.abc import Sequence

import numpy as np

from fraexp.data.signals import Segment

MIN_PERIODS = 2
"""Periods from which a motion shows; two do not tell whether it is steady."""
MAX_GAIN_SCATTER = 0.25
"""Standard deviation of what a channel gains in a period, relative to the mean, up to which the motion is steady."""
MAX_LEAKAGE = 0.1
"""Error of a line, relative to it, above which a steady motion is told."""
MIN_LINE_SHARE = 0.25
"""Share of lines with such an error from which it is told: of a small drift, only few weak lines suffer."""


def steady_motion_text(segments: Sequence[Segment], name: str, unit: str) -> str:
    """Return how much a channel gains in each period, and at how many lines that matters; empty if nowhere.

    Segments that state whether they had settled do not move on.
    """
    found = [text for segment in segments if (text := _motion_text(segment, name, unit))]
    more = f"; and in {len(found) - 1} more segments" if len(found) > 1 else ""
    return f"{found[0]}{more}" if found else ""


def _motion_text(segment: Segment, name: str, unit: str) -> str:
    if segment.settling is not None or name not in segment.channels or len(segment.channels[name]) < MIN_PERIODS:
        return ""
    periods = segment.channels[name]
    gains = np.diff(periods, axis=0).mean(axis=1)
    gain = float(gains.mean())
    if gain == 0 or np.std(gains) > MAX_GAIN_SCATTER * abs(gain):
        return ""
    ramp = np.abs(np.fft.rfft(gain * np.arange(periods.shape[1]) / periods.shape[1]))[segment.lines]
    off = ramp > MAX_LEAKAGE * np.abs(np.fft.rfft(periods.mean(axis=0)))[segment.lines]
    if off.sum() <= MIN_LINE_SHARE * off.size:
        return ""
    return (
        f"'{name}' gains {gain:.3g} {unit} each period and does not repeat: a mean over periods is off by more than "
        f"{MAX_LEAKAGE:.0%} at {off.sum()} of {off.size} frequencies; --estimator local_polynomial removes a steady "
        "motion, or subtract it before the import"
    )
