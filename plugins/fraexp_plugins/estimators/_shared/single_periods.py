"""Records whose excitation repeats itself while their motion does not."""

from dataclasses import replace

from fraexp.api import Segment, Settling, Signals


def as_single_periods(signals: Signals) -> Signals:
    """Return signals in which each segment is one long period at the same frequencies, whose end is not its past."""
    return replace(signals, segments=tuple(_single_period(segment) for segment in signals.segments))


def _single_period(segment: Segment) -> Segment:
    channels = {name: values.reshape(1, -1) for name, values in segment.channels.items()}
    periods = len(next(iter(segment.channels.values())))
    from_rest = Settling(time=0.0, residual=float("nan"), settled=True)
    return replace(segment, channels=channels, lines=segment.lines * periods, settling=from_rest)
