"""Published numbers of a stored run's study beside those of its sweeps, and the title of its figure."""

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from fraexp.data.identity import key_of
from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.study.published_values import ORIGINS, Candidate, PublishedComparison, PublishedNumber, half_widths
from fraexp.study.study_file import ResolvedStudy, describe_study, find_studies

UNUSUAL_CHARACTERS = re.compile(r"[^\w.=+-]+")
"""What the name of a file does not contain."""
MAX_CHANGES_LENGTH = 100
"""Maximum characters of what a command has set in the name of a file."""


def compare_published(
    numbers: Sequence[PublishedNumber], sweeps: Sequence[StoredSweep], results: Mapping[str, Result]
) -> list[PublishedComparison]:
    """Return each published number beside that of the stored sweeps of its study."""
    if not numbers:
        return []
    candidates = [_candidate(sweep, results[sweep.key]) for sweep in sweeps if sweep.key in results]
    return [number.compare_with(candidates) for number in numbers]


def compare_run(
    run: RunSummary, sweeps: Sequence[StoredSweep], results: Mapping[str, Result], folder: Path
) -> list[PublishedComparison]:
    """Return the published numbers of a run's study, as its file is today, beside the run's; none without the file."""
    return compare_published(read_study(run, folder)[0].published, sweeps, results)


def compare_sweep(store: Store, sweep: StoredSweep, result: Result, folder: Path) -> list[PublishedComparison]:
    """Return the published numbers that a sweep's latest run compares with this sweep."""
    latest = store.find(sweep.key)
    if latest.run is None:
        return []
    published = read_study(store.run(latest.run), folder)[0].published
    return compare_published(
        [of for of in published if of.selects(_candidate(sweep, result))], [sweep], {sweep.key: result}
    )


def _candidate(sweep: StoredSweep, result: Result) -> Candidate:
    sections = sweep.sections
    return Candidate(sweep.labels, sections, result.metrics, half_widths(result), result.outcome)


def read_study(run: RunSummary, folder: Path) -> tuple[ResolvedStudy, list[str]]:
    """Return the description of a run's study as its file is today, and a note if it cannot be read."""
    bare = ResolvedStudy(run.study, Path(run.study_file), run.study, "", ())
    if not run.study_file.endswith(".toml"):  # a fit to stored responses
        return bare, []
    try:
        return describe_study(run.study, _study_file(run, folder)), []
    except FraexpError as error:
        return bare, [f"title, question and published numbers are left out: {error}"]


def _study_file(run: RunSummary, folder: Path) -> Path:
    """Return the study's file: the one that the run read, or the one that has the study's name now."""
    file = Path(run.study_file)
    return file if file.is_file() else find_studies(run.study, folder)[0][1]


def verdict(compared: Sequence[PublishedComparison]) -> str:
    """Return how many published numbers are met, by origin, as a sentence without its full stop; empty without any."""
    if not compared:
        return ""
    groups = ((origin, [one.is_met for one in compared if one.published.origin == origin]) for origin in ORIGINS)
    counts = [f"{origin} {sum(met)} of {len(met)}" for origin, met in groups if met]
    total, plural = sum(one.is_met for one in compared), "" if len(compared) == 1 else "s"
    return f"{total} of {len(compared)} published number{plural} met: {', '.join(counts)}"


def comparison_document(one: PublishedComparison) -> dict[str, Any]:
    """Return a published number and ours as plain data; what is unknown is None."""
    of = one.published
    given = of.model_dump(mode="json", include={"what", "source", "origin", "value", "unit", "compare", "tolerance"})
    ours = {"ours": one.ours, "half_width_95": one.half}
    found = {name: value if math.isfinite(value) else None for name, value in ours.items()}
    outcome = one.outcome.name.lower()
    return {**given, **found, "outcome": outcome, "met": one.is_met, "remark": one.remark, "note": of.note}


def run_title(study: str, title: str, command: str) -> str:
    """Return the title of a run's figure: that of its study, unless the command has set values of the study.

    `title` describes the study's file; after ``--set`` it may speak of another grid.
    """
    changes = [change.replace("=", " = ", 1) for change in _changes(command)]
    return f"{study} with {', '.join(changes)}" if changes else title or study


def figure_name(study: str, command: str) -> str:
    """Return the name of a run's figure: that of its study, and what the command has set, which is another figure."""
    text = UNUSUAL_CHARACTERS.sub("_", " ".join(_changes(command))).strip("_")
    if len(text) > MAX_CHANGES_LENGTH:
        text = f"{text[:MAX_CHANGES_LENGTH]}-{key_of(text)[-8:]}"
    return f"{study}_{text}.png" if text else f"{study}.png"


def _changes(command: str) -> list[str]:
    """Return the values of a study that a command has set."""
    try:
        words = shlex.split(command)
    except ValueError:  # a run of another program
        return []
    joined = [word.removeprefix("--set=") for word in words if word.startswith("--set=")]
    return [*joined, *(after for word, after in pairwise(words) if word == "--set")]
