"""What a run would do, and why, in a few lines or in full."""

from collections.abc import Iterator
from typing import Any

from fraexp.execution.events import Planned, Why
from fraexp.views.words import short

NAMED = 6
"""Sweeps that are named in a line; the JSON document has all."""
RERUN = ("stale", "failed")
"""States that ``--rerun`` computes again."""


def why_lines(planned: Planned) -> Iterator[str]:
    """Yield a line for each reason: how many sweeps, what is done with them, and why."""
    for why in sorted(planned.whys, key=lambda why: why.computed):
        remedy = f"; --rerun {why.state} computes them" if why.state in RERUN and not why.computed else ""
        yield f"  {len(why.sweeps):,} {_word(why)}: {why.reason}{_named(why)}{remedy}"


def _word(why: Why) -> str:
    match why.state:
        case "new":
            return "new"
        case "failed" if why.computed:
            return "to be tried again"
    done = "computed again" if why.computed else "reused"
    return done if why.state == "same" else f"{done}, {why.state}"


def _named(why: Why) -> str:
    """Return the keys of what has failed; new sweeps are told by what they differ in."""
    if why.state == "new" or not why.each:
        return ""
    names = [f"{short(sweep.key)} {why.each.get(sweep.key, '')}" for sweep in why.sweeps[:NAMED]]
    more = len(why.sweeps) - NAMED
    return f": {', '.join(names)}" + (f" and {more:,} more" if more > 0 else "")


def why_document(why: Why) -> dict[str, Any]:
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
