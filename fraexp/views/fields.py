"""Names and values of a run, a sweep and a fit."""

import json
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

from fraexp.figures.elements.labels import label_text
from fraexp.store import RunSummary, StoredSweep
from fraexp.views.words import duration, moment, short


def run_fields(run: RunSummary) -> list[tuple[str, str]]:
    """Return names and values of a run."""
    git = run.provenance.get("git") or {}
    changed = " with local changes" if git.get("dirty") else ""
    commit = f" ({git['commit'][:12]}{changed})" if git.get("commit") else ""
    return [
        ("run", str(run.number)),
        ("study", run.study),
        ("file", run.study_file),
        ("command", run.command),
        ("state", run.state),
        ("sweeps", f"{run.total}: {run.computed} computed, {run.reused} reused, {run.failed} failed"),
        ("started", moment(run.started)),
        ("took", took(run)),
        ("code", f"fraexp {run.provenance.get('fraexp') or '(version unknown)'}{commit}"),
    ]


def took(run: RunSummary) -> str:
    """Return how long a run took; empty while it is not known."""
    return duration((run.ended - run.started).total_seconds()) if run.ended else ""


def running_for(run: RunSummary) -> str:
    """Return for how long a run has been going on, in whole seconds."""
    return duration(max(math.floor(time.time() - run.started.timestamp()), 0))


def remedies(sweeps: Sequence[StoredSweep]) -> list[str]:
    """Return a line for each outcome that is not as wished, with the number of sweeps and the remedy."""
    outcomes = [sweep.outcome for sweep in sweeps if sweep.outcome and sweep.outcome.value]
    lines = []
    for outcome in dict.fromkeys(outcomes):
        lines.append(f"{outcomes.count(outcome)} {outcome.name.lower().replace('_', ' ')}: {outcome.value}")
    return lines


def outcome_text(sweep: StoredSweep) -> str:
    """Return a sweep's outcome in words; empty while there is none."""
    return sweep.outcome.name.lower().replace("_", " ") if sweep.outcome else ""


def sweep_fields(sweep: StoredSweep) -> list[tuple[str, str]]:
    """Return names and values of a sweep."""
    return [
        ("sweep", short(sweep.key)),
        ("key", sweep.key),
        ("labels", ", ".join(f"{path} = {label_text(value)}" for path, value in sweep.labels.items())),
        ("state", sweep.state),
        ("outcome", outcome_text(sweep)),
        ("message", sweep.message),
        ("remedy", sweep.outcome.value if sweep.outcome else ""),
        ("computed", moment(sweep.created)),
        ("took", duration(sweep.elapsed) if sweep.created else ""),
        ("tags", ", ".join(sweep.tags)),
        ("note", sweep.note),
    ]


def toml_value(value: Any) -> str:
    """Return a value as a study writes it."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml_value(item)}" for key, item in value.items() if item is not None) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False)
