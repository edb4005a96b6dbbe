"""Questions about the samples of channels: those far outside of what their channel does in its periods, and others."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.data.signals import Segment
from fraexp.records.clipping import clipping_question
from fraexp.records.moving_axes import wrap_question
from fraexp.records.sample_outliers import frozen_question, outlier_question

MIN_PERIODS = 3
"""Periods from which the usual range of a channel is known, whichever of them has the wrong sample."""
MARGIN = 0.5
"""How far beyond the usual range a sample is questioned, in widths of that range: noise does not reach so far."""
MAX_SHARE = 0.01
"""Share of samples above which they are no single ones: a machine that settles or drifts."""


def wrong_sample_questions(segments: Sequence[Segment], units: Mapping[str, str]) -> str:
    """Return questions about the samples of channels, in one line; empty if there are none.

    Of each channel the first question counts, as one fault has several signs. Of a record that does not repeat, only
    wraps can be seen.
    """
    found = [text for segment in segments for name in units if (text := _question(segment, name, units[name]))]
    more = f"; and {len(found) - 1} more channels or segments" if len(found) > 1 else ""
    return f"{found[0]}{more}" if found else ""


def _question(segment: Segment, name: str, unit: str) -> str:
    periods = segment.channels[name]
    wraps = wrap_question(periods, name, unit)
    if wraps or not segment.periodic:
        return wraps
    clipped = clipping_question(periods, name, unit)
    if periods.shape[0] < MIN_PERIODS:
        return clipped
    return (
        _range_question(periods, name, unit)
        or outlier_question(periods, name, unit)
        or frozen_question(periods, name, unit, segment.sample_time)
        or clipped
    )


def _range_question(periods: NDArray[np.float64], name: str, unit: str) -> str:
    """Return a question about samples far outside of the range of the median period."""
    low, high = np.median(periods.min(axis=1)), np.median(periods.max(axis=1))
    beyond = np.maximum(periods - high, low - periods)
    far = beyond > MARGIN * (high - low)
    if not (high > low and 0 < far.sum() <= max(MAX_SHARE * far.size, 1)):
        return ""
    period, sample = np.unravel_index(np.argmax(beyond), beyond.shape)
    samples = "sample" if far.sum() == 1 else "samples"
    settling = ", or was the machine still settling" if 1 < far.sum() == far[0].sum() else ""
    options = "--skip-periods 1" if settling else "--start-time, --end-time"
    return (
        f"'{name}' is {periods[period, sample]:.3g} {unit} at sample {sample + 1} of period {period + 1}, and "
        f"between {low:.3g} and {high:.3g} {unit} in the others: {far.sum()} wrong {samples}{settling}? leave them "
        f"out ({options}) or mend them"
    )
