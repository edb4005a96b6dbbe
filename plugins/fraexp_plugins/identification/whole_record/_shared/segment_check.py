"""The refusal of segments that a replay cannot follow."""

from fraexp.api import RecordError, Signals

MAX_LINES = 64
"""Maximum number of excited lines of a segment, each of which takes two parameters of its own."""


def check_segments(signals: Signals, estimator: str) -> None:
    """Raise RecordError, which names the estimator, for segments that a replay cannot follow."""
    if not all(segment.periodic for segment in signals.segments):
        raise RecordError(
            f"{estimator}: the record does not repeat itself (periodic = false); expected whole periods: state "
            "the record's period, or take h1_h2_hv or local_polynomial"
        )
    lines = max(segment.lines.size for segment in signals.segments)
    if lines > MAX_LINES:
        raise RecordError(
            f"{estimator}: a segment has {lines} excited lines; expected at most {MAX_LINES}: excite fewer at a "
            "time, or use effective_input"
        )
    times = sorted({segment.sample_time for segment in signals.segments})
    if len(times) > 1:
        raise RecordError(
            f"{estimator}: the segments have sample times of {times[0]:g} to {times[-1]:g} s; expected one: "
            "estimate those of each sample time for themselves"
        )
