"""The plan of a run with its reasons, in a few lines or in full."""

from collections.abc import Iterator

from fraexp.execution.events import Planned, Why
from fraexp.views.words import short_key

MAX_NAMED_SWEEPS = 6
"""Maximum number of sweeps named in a line; the JSON document has all."""
RERUN_CLASSES = {"stale": "stale", "failed": "unusable"}
"""Argument of ``--rerun`` that computes stored sweeps again, by their state."""


def why_lines(planned: Planned) -> Iterator[str]:
    """Yield a line for each reason: the number of sweeps, what is done with them, and why."""
    for why in sorted(planned.whys, key=lambda why: why.computed):
        rerun = "" if why.computed else RERUN_CLASSES.get(why.state, "")
        remedy = f"; --rerun {rerun} computes them again" if rerun else ""
        yield f"  {len(why.sweeps):,} {_action_text(why)}: {why.reason}{_sweep_names(why)}{remedy}"


def _action_text(why: Why) -> str:
    match why.state:
        case "new":
            return "new"
        case "failed" if why.computed:
            return "to be tried again"
    done = "computed again" if why.computed else "reused"
    return done if why.state == "same" else f"{done}, {RERUN_CLASSES.get(why.state, why.state)}"


def _sweep_names(why: Why) -> str:
    """Return the keys of failed sweeps; new sweeps are described by the reason instead."""
    if why.state == "new" or not why.each:
        return ""
    names = [f"{short_key(sweep.key)} {why.each.get(sweep.key, '')}" for sweep in why.sweeps[:MAX_NAMED_SWEEPS]]
    more = len(why.sweeps) - MAX_NAMED_SWEEPS
    return f": {', '.join(names)}" + (f" and {more:,} more" if more > 0 else "")


def why_document(why: Why) -> dict[str, object]:
    """Return a reason with all of its sweeps as plain data."""
    return {
        "computed": why.computed,
        "state": why.state,
        "reason": why.reason,
        "count": len(why.sweeps),
        "sweeps": [
            {"key": sweep.key, "labels": dict(sweep.labels), "why": why.each.get(sweep.key, why.reason)}
            for sweep in why.sweeps
        ],
    }
