"""Questions about samples that differ from those at the same place in the other periods: outliers, and lost signals."""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fraexp.analysis.quantisation import smallest_step

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
