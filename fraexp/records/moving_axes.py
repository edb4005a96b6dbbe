"""Questions about axes that turn while they are measured: angles and counters that wrap."""

import numpy as np
from numpy.typing import NDArray

WRAPPING_UNITS = ("m", "rad", "1")
"""Units of what wraps: positions of encoders, and numbers."""
WRAP_SHARE = 0.8
"""Part of a channel's whole range by which it jumps from one sample to the next where it wraps."""
MAX_STEP_SHARE = 0.2
"""Part of the range up to which it moves between the samples beside: faster signals have such jumps themselves."""
MIN_WRAPS = 3
"""Jumps from which their direction tells wraps from the edges of a square wave, which noise surrounds."""
TURN_TOLERANCE = 0.01
"""Relative difference of a jump from a whole turn up to which a single one is a wrap."""
MIN_ONWARD_SHARE = 0.8
"""Share of jumps that a motion in the opposite direction surrounds, from which they are wraps."""


def wrap_question(periods: NDArray[np.float64], name: str, unit: str) -> str:
    """Return a question about a position, shape (periods, samples), that wraps at the ends of its range, or "".

    Where an angle wraps it jumps by nearly its range, against the direction in which it moves before and afterwards.
    """
    channel = periods.ravel()
    steps, span = np.diff(channel), float(np.ptp(channel))
    if unit not in WRAPPING_UNITS or channel.size < MIN_WRAPS or not span:
        return ""
    jumps = np.flatnonzero(np.abs(steps[1:-1]) > WRAP_SHARE * span) + 1
    before, jump, after = steps[jumps - 1], steps[jumps], steps[jumps + 1]
    alone = np.maximum(np.abs(before), np.abs(after)) < MAX_STEP_SHARE * span
    onward = alone & (before * jump < 0) & (after * jump < 0)
    turns = np.abs(jump - (before + after) / 2)[onward] / (2 * np.pi)
    least = 1 if unit == "rad" and np.all(np.abs(turns - 1) < TURN_TOLERANCE) else MIN_WRAPS
    if onward.sum() < max(least, MIN_ONWARD_SHARE * alone.sum()):
        return ""
    many = f"{jumps.size} times, first" if jumps.size > 1 else "once,"
    period, sample = divmod(int(jumps[np.argmax(onward)]), periods.shape[1])
    return (
        f"'{name}' jumps by nearly its whole range of {span:.4g} {unit} {many} after sample "
        f"{sample + 1} of period {period + 1}: an angle or counter that wraps? unwrap the column before the import"
    )
