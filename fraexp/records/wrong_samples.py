"""Samples of a record that are wrong: clipped ones, outliers, and those of an axis that moves by itself."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fraexp.analysis.fourier import phasors
from fraexp.analysis.quantisation import smallest_step
from fraexp.data.signals import Segment
from fraexp.records.record_settings import INJECTED_CHANNELS

MAX_OUTLIER_SHARE = 0.01
"""Share of samples up to which they are outliers: more are a motion that does not repeat."""
NEIGHBOURS = 7
"""Samples around a place between whose values an edge lies that comes a little earlier or later."""
MIN_OUTLIER = 0.1
"""How far an outlier is from what is usual at its place, in widths of the channel's range."""
OUTLIER_FACTOR = 10.0
"""How far it is at least, relative to the largest distances of usual samples."""
USUAL_SHARE = 0.95
"""Share of the samples of each period that are usual ones in any case."""
MIN_OUTLIER_STEPS = 2.5
"""How far it is at least, in steps of a coarse encoder."""
MIN_FROZEN_SAMPLES = 20
"""Equal samples in a row from which a signal may be lost, and their share of a period."""
MIN_FROZEN_SHARE = 0.01
MIN_FROZEN_MOTION = 0.2
"""How far a channel moves in all other periods where it is frozen in one, in widths of its range."""
MIN_OTHERS = 2
"""Other stretches of the record with which a run of equal samples is compared."""
COMMON_RUN = 1 / 3
"""Length, relative to the longest, of the runs that must be fewer than half of the periods: machines stick in each."""


class SampleQuestion(NamedTuple):
    """A question about samples of a channel."""

    text: str
    """Empty if there is none."""
    deviation: float = np.inf
    """Sum of what the samples differ from usual ones [unit]; infinite where more than single samples are wrong."""


NO_QUESTION = SampleQuestion("", 0.0)


def outlier_question(periods: NDArray[np.float64], name: str, unit: str) -> SampleQuestion:
    """Return a question about single samples of a channel, shape (periods, samples), that no other period has.

    The median over the periods is what is usual at a place, however large the outliers are and though every period
    has some.
    """
    usual = np.median(periods, axis=0)
    span = float(np.ptp(usual))
    # the offset of a period, as of a machine that settles; at most two wrong samples in a row do not count
    offset = _running_median((periods - usual).ravel()).reshape(periods.shape)
    around = sliding_window_view(np.pad(usual, NEIGHBOURS // 2, mode="wrap"), NEIGHBOURS)
    low, high = around.min(axis=-1), around.max(axis=-1)
    level = periods - offset
    beyond = np.maximum(np.maximum(level - high, low - level), 0.0)
    largest_usual = np.quantile(beyond, USUAL_SHARE, axis=1, keepdims=True)  # more in a first period that settles
    least = max(MIN_OUTLIER * span, MIN_OUTLIER_STEPS * smallest_step(periods))
    far = beyond > np.maximum(least, OUTLIER_FACTOR * largest_usual)
    if not span or not 0 < far.sum() <= max(MAX_OUTLIER_SHARE * far.size, 1):
        return NO_QUESTION
    period, sample = np.unravel_index(np.argmax(beyond), beyond.shape)
    samples = "sample" if far.sum() == 1 else "samples"
    text = (
        f"'{name}' is {periods[period, sample]:.3g} {unit} at sample {sample + 1} of period {period + 1}, and about "
        f"{usual[sample]:.3g} {unit} there in the others: {far.sum()} wrong {samples}? interpolate them "
        "before the import"
    )
    return SampleQuestion(text, float(np.sum(beyond[far])))


def _running_median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median of five values around each, shape (n,); the ends are mirrored.

    `scipy.ndimage` has this too, but its import takes longer than the import of a record.
    """
    first, second, middle, fourth, fifth = sliding_window_view(np.pad(values, 2, mode="symmetric"), len(values))
    low = np.maximum(np.minimum(first, second), np.minimum(fourth, fifth))
    high = np.minimum(np.maximum(first, second), np.maximum(fourth, fifth))
    return np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), middle))


def frozen_question(periods: NDArray[np.float64], name: str, unit: str, sample_time: float) -> str:
    """Return a question about a channel, shape (periods, samples), that stands still in one period only, or ""."""
    channel, samples = periods.ravel(), periods.shape[1]
    span = float(np.ptp(np.median(periods, axis=0)))
    ends = np.append(np.flatnonzero(np.diff(channel)) + 1, channel.size)
    lengths = np.diff(ends, prepend=0)
    length, start = int(lengths.max()), int(ends[np.argmax(lengths)] - lengths.max())
    common = np.sum(lengths > COMMON_RUN * length) >= len(periods) / 2
    common |= start == 0  # a machine that starts from rest
    if common or length < max(MIN_FROZEN_SAMPLES, MIN_FROZEN_SHARE * samples) or not span:
        return ""
    others = [at for at in range(start % samples, channel.size - length + 1, samples) if abs(at - start) >= length]
    moved = [float(np.ptp(channel[at : at + length])) for at in others]
    if len(moved) < MIN_OTHERS or min(moved) < MIN_FROZEN_MOTION * span:
        return ""
    period, sample = divmod(start, samples)
    return (
        f"'{name}' stays at {channel[start]:.3g} {unit} for {length * sample_time:.3g} s from sample "
        f"{sample + 1} of period {period + 1} on, and moves there in the other periods: a lost signal? leave it "
        "out (--start-time, --end-time) or record again"
    )


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


MIN_PERIODS = 3
"""Periods from which the usual range of a channel is known, whichever of them has the wrong sample."""
MARGIN = 0.5
"""How far beyond the usual range a sample is questioned, in widths of that range: noise does not reach so far."""
MAX_INFLUENCE = 0.01
"""Relative change of a response by wrong samples up to which it is ok."""
MAX_SHARE = 0.01
"""Share of samples above which they are no single ones: a machine that settles or drifts."""


class SampleQuestions(NamedTuple):
    """What is to be asked about the samples of a record."""

    text: str
    """In one line; empty if there is nothing."""
    do_harm: bool
    """Whether the samples change a response by more than a little."""


def wrong_sample_questions(segments: Sequence[Segment], units: Mapping[str, str]) -> SampleQuestions:
    """Return questions about the samples of channels.

    Of each channel the first question counts, as one fault has several signs. Of a record that does not repeat, only
    wraps can be seen. A few samples that differ a little from usual ones, such as those of a controller that follows a
    coarse encoder, do no harm.
    """
    asked = [(segment, name, _question(segment, name, units[name])) for segment in segments for name in units]
    found = [each for each in asked if each[2].text]
    more = f"; and {len(found) - 1} more channels or segments" if len(found) > 1 else ""
    text = f"{found[0][2].text}{more}" if found else ""
    return SampleQuestions(text, any(_influence(*each) > MAX_INFLUENCE for each in found))


def _influence(segment: Segment, name: str, question: SampleQuestion) -> float:
    """Return by how much the samples change the phasors of a channel, relative to the usual one of its lines."""
    usual = float(np.median(np.abs(phasors(segment, name).mean(axis=0))))
    return 2 * question.deviation / segment.channels[name].size / usual if usual else np.inf


def _question(segment: Segment, name: str, unit: str) -> SampleQuestion:
    periods = segment.channels[name]
    wraps = wrap_question(periods, name, unit)
    if wraps or not segment.periodic:
        return SampleQuestion(wraps)
    clipped = SampleQuestion(clipping_question(periods, name, unit))
    if periods.shape[0] < MIN_PERIODS:
        return clipped
    single = _range_question(periods, name, unit)
    single = single if single.text else outlier_question(periods, name, unit)
    if single.text:
        return single
    frozen = SampleQuestion(frozen_question(periods, name, unit, segment.sample_time))
    return frozen if frozen.text else clipped


def _range_question(periods: NDArray[np.float64], name: str, unit: str) -> SampleQuestion:
    """Return a question about samples far outside of the range of the median period."""
    low, high = np.median(periods.min(axis=1)), np.median(periods.max(axis=1))
    beyond = np.maximum(periods - high, low - periods)
    far = beyond > MARGIN * (high - low)
    if not (high > low and 0 < far.sum() <= max(MAX_SHARE * far.size, 1)):
        return NO_QUESTION
    period, sample = np.unravel_index(np.argmax(beyond), beyond.shape)
    samples = "sample" if far.sum() == 1 else "samples"
    settling = ", or was the machine still settling" if 1 < far.sum() == far[0].sum() else ""
    options = "--skip-periods 1" if settling else "--start-time, --end-time"
    text = (
        f"'{name}' is {periods[period, sample]:.3g} {unit} at sample {sample + 1} of period {period + 1}, and "
        f"between {low:.3g} and {high:.3g} {unit} in the others: {far.sum()} wrong {samples}{settling}? leave them "
        f"out ({options}) or mend them"
    )
    return SampleQuestion(text, float(np.sum(beyond[far])))
