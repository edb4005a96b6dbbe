"""Questions about channels that are cut off at a limit of their range, as by a converter."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.quantisation import smallest_step
from fraexp.records.record_settings import INJECTED_CHANNELS

COMMANDS = ("u", *INJECTED_CHANNELS)
"""Channels that are not looked at: commands are limited, and then are what the machine gets."""
MOTION_UNITS = ("m", "m/s", "m/s**2", "rad", "rad/s", "rad/s**2")
"""Units of what moves smoothly."""
MIN_RUN_SAMPLES = 3
"""Samples in a row at a limit from which it is more than the top of a wave."""
MIN_RUNS = 3
"""Such runs from which a channel is clipped."""
MIN_CLIPPED_SHARE = 0.002
"""Share of samples in such runs from which a channel is clipped: fewer change little."""
MAX_CLIPPED_SHARE = 0.7
"""Share of samples at the two limits above which these are the two levels of a square wave."""
MIN_VALUES = 50
"""Different values from which a channel is no coarse one."""
MIN_ENTRY_STEP, MIN_ENTRY_BENDS, USUAL_BEND = 0.35, 3.0, 0.99
"""Step before and after a run, relative to the rms of all steps, or to the change from one step to the next that is not
exceeded by this share of the others: machines that reverse or stick slow down or start slowly."""
MIN_ENTRY_COUNTS = 3.0
"""The same step, in steps of the encoder or of rounded numbers; short runs take more, as `_rounded_top_steps` says."""
MAX_STICKING = 0.2
"""Samples in such runs elsewhere, relative to those at the limits, above which the machine sticks."""


class _Runs(NamedTuple):
    """Runs of samples at a limit."""

    number: int
    samples: int
    """Samples in all runs."""
    entries: NDArray[np.float64]
    """Smaller of the steps just before and after each run, over the one from which it is fast, shape (n,)."""


def clipping_question(periods: NDArray[np.float64], name: str, unit: str) -> str:
    """Return a question about a motion, shape (periods, samples), that is cut off at a limit of its range, or "".

    A smooth signal slows down before it turns; a clipped one stops within a sample, and always at the same value.
    """
    channel = periods.ravel()
    if name in COMMANDS or unit not in MOTION_UNITS or np.unique(channel).size < MIN_VALUES:
        return ""
    limits = float(channel.min()), float(channel.max())
    if np.mean(np.isin(channel, limits)) > MAX_CLIPPED_SHARE:
        return ""
    found = {limit: runs for limit in limits if _is_clipped(runs := _runs_at(channel, limit), channel.size)}
    at_limits = sum(runs.samples for runs in found.values())
    if not found or _resting_samples(channel, limits) > MAX_STICKING * at_limits:
        return ""
    values = " and ".join(f"{limit:.3g}" for limit in found)
    ends = "the ends" if len(found) > 1 else "an end"
    return (
        f"'{name}' stands at {values} {unit}, {ends} of its range, for {at_limits} of {channel.size} samples, and "
        "moves fast just before: is it clipped? record with a larger range or a smaller excitation"
    )


def _is_clipped(runs: _Runs, size: int) -> bool:
    many = runs.number >= MIN_RUNS and runs.samples >= MIN_CLIPPED_SHARE * size
    return many and float(np.median(runs.entries)) > 1


def _resting_samples(channel: NDArray[np.float64], limits: tuple[float, float]) -> int:
    """Return the number of samples in runs of equal ones within the range."""
    ends = np.append(np.flatnonzero(np.diff(channel)) + 1, channel.size)
    lengths = np.diff(ends, prepend=0)
    return int(np.sum(lengths[(lengths >= MIN_RUN_SAMPLES) & ~np.isin(channel[ends - 1], limits)]))


def _runs_at(channel: NDArray[np.float64], limit: float) -> _Runs:
    """Return the runs of samples at a limit that have two other samples on both sides."""
    changes = np.diff((channel == limit).astype(np.int8), prepend=0, append=0)
    starts, ends = np.flatnonzero(changes == 1), np.flatnonzero(changes == -1)
    inner = (ends - starts >= MIN_RUN_SAMPLES) & (starts >= 2) & (ends + 2 <= channel.size)
    starts, ends = starts[inner], ends[inner]
    before, after = channel[starts - 1] - channel[starts - 2], channel[ends + 1] - channel[ends]
    steps, usual = np.minimum(np.abs(before), np.abs(after)), float(np.sqrt(np.mean(np.diff(channel) ** 2)))
    counts = np.maximum(MIN_ENTRY_COUNTS, _rounded_top_steps(ends - starts))
    least = min(MIN_ENTRY_STEP * usual, MIN_ENTRY_BENDS * _usual_bend(channel))
    fast = np.maximum(least, counts * smallest_step(channel))
    return _Runs(starts.size, int(np.sum(ends - starts)), steps / fast)


def _usual_bend(channel: NDArray[np.float64]) -> float:
    """Return what most changes from one step to the next have at most, apart from those at either limit."""
    near = np.convolve(np.isin(channel, (channel.min(), channel.max())), np.ones(5), "same")[1:-1] > 0
    bends = np.abs(np.diff(channel, 2))[~near]
    return float(np.quantile(bends, USUAL_BEND)) if bends.size else np.inf


def _rounded_top_steps(samples: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the greatest step [steps of rounding] just before or after runs that rounding makes of a smooth top.

    n samples that are rounded alike fall by one step at most from the middle to the ends, (n - 1)/2 samples away. The
    flattest top of a wave with its third harmonic falls as the fourth power does: by at most ((n + 3)⁴ - (n + 1)⁴) /
    (n - 1)⁴ steps between the two samples that follow, which are rounded as well. Rounder tops fall by less.
    """
    return ((samples + 3.0) ** 4 - (samples + 1.0) ** 4) / (samples - 1.0) ** 4 + 1
