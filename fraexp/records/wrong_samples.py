"""Questions about the samples of channels: those far outside of what their channel does in its periods, and others."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import phasors
from fraexp.data.signals import Segment
from fraexp.records.clipping import clipping_question
from fraexp.records.moving_axes import wrap_question
from fraexp.records.sample_outliers import NO_QUESTION, SampleQuestion, frozen_question, outlier_question

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
