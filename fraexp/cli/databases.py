"""``fraexp merge`` and ``fraexp restore``: another database merged into this one, or a copy put in its place."""

import sys
import time
from argparse import Namespace
from collections.abc import Generator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_line, say
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.errors import StoreError
from fraexp.figures.result_files import json_value
from fraexp.store import Conflict, MergeSummary, masked_url
from fraexp.views.words import plural
from fraexp.workspace.workspace_folder import WorkspaceFolder

PROGRESS_INTERVAL_S = 2.0
"""Seconds between two progress messages."""
MAX_SHOWN_CONFLICTS = 20


def merge(arguments: Namespace) -> ExitCode:
    """Merge the other database, and print what was added and what conflicts."""
    workspace = workspace_folder(arguments)
    source = replace(workspace, database=arguments.other)
    _check_database(source)
    with source.open_store() as other, workspace.open_store("create") as store:
        if other.advice:
            say(other.advice)
        merged = _report_progress(store.merge(other))
        names = {"from": other.name, "into": store.name}
    if arguments.json:
        print_json({**names, **json_value(asdict(merged))})
    else:
        _print(merged, names["into"])
    return ExitCode.INCOMPLETE if _findings(merged) else ExitCode.OK


def _check_database(source: WorkspaceFolder) -> None:
    """Raise StoreError if the other database does not exist: unlike a run, merging does not create it."""
    if source.database_exists():
        return
    file = source.database.removeprefix("sqlite:///")
    missing = "://" not in file and not Path(file).exists()
    found = "there is no such file" if missing else "it contains no fraexp database"
    raise StoreError(f"{masked_url(source.database)}: {found}; expected the database to merge")


def _report_progress(steps: Generator[tuple[int, int], None, MergeSummary]) -> MergeSummary:
    said = time.monotonic()
    while True:
        try:
            done, total = next(steps)
        except StopIteration as stop:
            merged: MergeSummary = stop.value
            return merged
        if time.monotonic() - said > PROGRESS_INTERVAL_S:
            said = time.monotonic()
            print(f"{done} of {plural(total, 'sweep')} read", file=sys.stderr, flush=True)


def _findings(merged: MergeSummary) -> list[Conflict]:
    return [*merged.damaged, *merged.damaged_runs, *merged.conflicts, *merged.run_conflicts]


def _print(merged: MergeSummary, name: str) -> None:
    findings = _findings(merged)
    for found in findings[:MAX_SHOWN_CONFLICTS]:
        subject = found.key if found.key.startswith("run ") else f"sweep {found.key[4:12]}"
        say(f"{subject}: {found.how}")
    if len(findings) > MAX_SHOWN_CONFLICTS:
        say(f"{len(findings) - MAX_SHOWN_CONFLICTS} more; --json lists all")
    added = ", ".join(_added_counts(merged)) or "nothing new"
    there = f"{plural(merged.same, 'result')} and {plural(merged.known_runs, 'run')} already there"
    print_line(f"{name}: {added}; {there}")
    sweeps = _accounts(merged.read, "sweep", merged.added, merged.there, len(merged.conflicts), len(merged.damaged))
    conflicts, damaged = len(merged.run_conflicts), len(merged.damaged_runs)
    print_line(sweeps + "; " + _accounts(merged.read_runs, "run", merged.runs, merged.known_runs, conflicts, damaged))
    if merged.conflicts or merged.run_conflicts:
        count = len(merged.conflicts) + len(merged.run_conflicts)
        say(f"{plural(count, 'conflict')}: the sweeps and runs of {name} were kept")
    if merged.damaged or merged.damaged_runs:
        say(f"{len(merged.damaged) + len(merged.damaged_runs)} damaged: what is damaged was left out")


def _accounts(read: int, word: str, added: int, there: int, conflicts: int, damaged: int) -> str:
    parts = f"{added} added, {there} already there, {plural(conflicts, 'conflict')}, {damaged} damaged"
    return f"{plural(read, word)} read: {parts}"


def _added_counts(merged: MergeSummary) -> list[str]:
    counts: list[tuple[int, Any]] = [
        (merged.sweeps, "sweep"),
        (merged.results, "result"),
        (merged.runs, "run"),
        (merged.tags, "tag"),
    ]
    return [f"{plural(count, word)} added" for count, word in counts if count]


def restore(arguments: Namespace) -> ExitCode:
    """Restore the database, and print what it contains and where the earlier one is."""
    workspace = workspace_folder(arguments)
    aside = workspace.restore_database(arguments.copy)
    with workspace.open_store() as store:
        contents = f"{plural(len(store.runs()), 'run')} and {plural(store.page(limit=0).total, 'sweep')}"
    say(f"{masked_url(workspace.database)}: a copy of {masked_url(arguments.copy)}, with {contents}")
    if aside:
        say(f"the earlier database is {aside}")
    return ExitCode.OK
