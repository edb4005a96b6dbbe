"""Names and values of a run, a sweep and a fit."""

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from fraexp.data.sweep import DRAW
from fraexp.figures.elements.labels import label_text, nominal_labels
from fraexp.store import RunSummary, StoredSweep
from fraexp.views.run_progress import counts_text
from fraexp.views.words import duration_text, scale_values, short_key, timestamp_text, with_unit

if TYPE_CHECKING:
    from fraexp.components.registry import Registry

NOTHING_USABLE = "no usable result"
"""State of a run that has ended, of which each sweep has failed or has an unusable result."""
MIN_SILENCE_S = 60.0
"""Time without a heartbeat from which a run is called silent: its leases end then, and others compute its sweeps."""


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
        ("state", run_state_text(run)),
        ("sweeps", f"{run.total}: {counts_text(run)}"),
        ("started", timestamp_text(run.started)),
        ("took", run_duration_text(run)),
        ("code", f"fraexp {run.provenance.get('fraexp') or '(version unknown)'}{commit}"),
    ]


def run_state_text(run: RunSummary) -> str:
    """Return the state of a run, with its silence if it has sent no heartbeat for a while, and its deleted sweeps.

    One that has ended without a usable result, such as after all of its sweeps have diverged, is not called complete.
    """
    state = run.end
    if run.is_unusable:
        state = NOTHING_USABLE
    elif run.silence >= MIN_SILENCE_S:
        state = f"{run.state}, silent for {duration_text(run.silence)}"
    return f"{state}, {run.deleted} deleted" if run.deleted else state


def run_duration_text(run: RunSummary) -> str:
    """Return how long a run took; empty while it is unknown."""
    return duration_text((run.ended - run.started).total_seconds()) if run.ended else ""


def elapsed_text(run: RunSummary) -> str:
    """Return the time since a run started, in whole seconds."""
    return duration_text(max(math.floor(time.time() - run.started.timestamp()), 0))


def remedies(sweeps: Sequence[StoredSweep]) -> list[str]:
    """Return a line for each remedy: how many sweeps need it, their outcome, and the remedy."""
    found = Counter((outcome_text(sweep), remedy_text(sweep)) for sweep in sweeps)
    return [f"{count} {outcome}: {remedy}" for (outcome, remedy), count in found.items() if remedy]


def remedy_text(sweep: StoredSweep) -> str:
    """Return what to do about a sweep's outcome; empty if there is nothing to be done."""
    return sweep.outcome.value if sweep.outcome else ""


def outcome_text(sweep: StoredSweep) -> str:
    """Return a sweep's outcome in words; empty while there is none."""
    return sweep.outcome.words if sweep.outcome else ""


def sweep_fields(sweep: StoredSweep, registry: "Registry | None" = None) -> list[tuple[str, str]]:
    """Return names and values of a sweep; the labels have units if the registry of components is given."""
    grid = nominal_labels(sweep.labels)
    drawn = {path: value for path, value in sweep.labels.items() if path not in grid}
    units = sweep_units([sweep], registry) if registry else {}
    grid_texts, drawn_texts = (", ".join(label_list(of, units)) for of in (grid, drawn))
    return [
        ("sweep", short_key(sweep.key)),
        ("key", sweep.key),
        ("labels", grid_texts),
        ("drawn", drawn_texts),
        ("state", sweep.state),
        ("outcome", outcome_text(sweep)),
        ("message", sweep.message),
        ("remedy", remedy_text(sweep)),
        ("computed", timestamp_text(sweep.created)),
        ("took", duration_text(sweep.elapsed) if sweep.created else ""),
        ("tags", ", ".join(sweep.tags)),
    ]


def sweep_units(sweeps: Sequence[StoredSweep], registry: "Registry") -> dict[str, str]:
    """Return the units of labels by path, which the components declare."""
    from fraexp.study.paths import label_units  # it imports what reads studies: not for a list of runs

    return label_units(((sweep.labels, sweep.sections) for sweep in sweeps), registry)


def sweep_labels(sweep: StoredSweep, registry: "Registry") -> list[str]:
    """Return each label of a sweep with its value and unit."""
    return label_list(sweep.labels, sweep_units([sweep], registry))


def label_list(labels: Mapping[str, object], units: Mapping[str, str]) -> list[str]:
    """Return each label with its value; `units` are those of labels, by path."""
    parts = []
    for path, value in labels.items():
        (scaled,), unit = scale_values([value], units.get(path, ""))
        parts.append(f"{path} = {with_unit(label_text(scaled), unit)}")
    return parts


def drawn_labels(labels: Mapping[str, object]) -> dict[str, str]:
    """Return a remark for each parameter that was drawn at random, by path: it is not what the study says."""
    drawn = list(labels)[len(nominal_labels(labels)) + 1 :]
    return dict.fromkeys(drawn, f"  (drawn: draw {labels.get(DRAW)})")
