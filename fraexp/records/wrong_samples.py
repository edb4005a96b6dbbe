"""Questions about single samples that stand far outside of what their channel does in its periods."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fraexp.data.signals import Segment

MIN_PERIODS = 3
"""Periods from which the usual range of a channel is known, whichever of them has the wrong sample."""
MARGIN = 0.5
"""How far beyond the usual range a sample is questioned, in widths of that range: noise does not reach so far."""
MAX_SHARE = 0.01
"""Share of samples above which they are no single ones: a machine that settles or drifts."""


def wrong_sample_questions(segments: Sequence[Segment], units: Mapping[str, str]) -> str:
    """Return questions about samples far outside of their channel's usual range, in one line; empty if there are none.

    The range is that of the median period. Records that do not repeat are not looked at.
    """
    found = [text for segment in segments if segment.periodic for text in _questions(segment, units)]
    more = f"; and {len(found) - 1} more channels or segments" if len(found) > 1 else ""
    return f"{found[0]}{more}" if found else ""


def _questions(segment: Segment, units: Mapping[str, str]) -> Iterator[str]:
    for name, unit in units.items():
        periods = segment.channels[name]
        if periods.shape[0] < MIN_PERIODS:
            continue
        low, high = np.median(periods.min(axis=1)), np.median(periods.max(axis=1))
        beyond = np.maximum(periods - high, low - periods)
        far = beyond > MARGIN * (high - low)
        if high > low and 0 < far.sum() <= max(MAX_SHARE * far.size, 1):
            period, sample = np.unravel_index(np.argmax(beyond), beyond.shape)
            samples = "sample" if far.sum() == 1 else "samples"
            yield (
                f"'{name}' is {periods[period, sample]:.3g} {unit} at sample {sample + 1} of period {period + 1}, and "
                f"between {low:.3g} and {high:.3g} {unit} in the others: {far.sum()} wrong {samples}? leave them out "
                f"(--start-time, --end-time) or mend them"
            )
