"""``fraexp merge``: add what another database has."""

import sys
import time
from argparse import Namespace
from collections.abc import Generator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fraexp.cli.documents import plain
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, say
from fraexp.cli.sweep_lookup import database
from fraexp.errors import StoreError
from fraexp.store import Merged, Store, shown
from fraexp.views.words import plural

PATIENCE = 2.0
"""Seconds between two words on how far it is."""
MOST_SHOWN = 20


def execute(arguments: Namespace) -> ExitCode:
    """Add it, and tell what was added and what differs."""
    _check_there(arguments.other)
    with Store.open(arguments.other, read_only=True) as other, Store.open(database(arguments), create=True) as store:
        merged = _followed(store.merge(other))
        names = {"from": other.name, "into": store.name}
    if arguments.json:
        print_json({**names, **plain(asdict(merged))})
    else:
        _print(merged, names["into"])
    return ExitCode.INCOMPLETE if merged.conflicts else ExitCode.OK


def _check_there(url: str) -> None:
    """Raise StoreError where there is nothing to add: no run would make that database."""
    if Store.exists(url):
        return
    file = url.removeprefix("sqlite:///")
    missing = "://" not in file and not Path(file).exists()
    found = "there is no such file" if missing else "it holds no database"
    raise StoreError(f"{shown(url)}: {found}; name the database that is to be added")


def _followed(steps: Generator[tuple[int, int], None, Merged]) -> Merged:
    said = time.monotonic()
    while True:
        try:
            done, total = next(steps)
        except StopIteration as stop:
            merged: Merged = stop.value
            return merged
        if time.monotonic() - said > PATIENCE:
            said = time.monotonic()
            print(f"{done} of {plural(total, 'sweep')} looked at", file=sys.stderr, flush=True)


def _print(merged: Merged, name: str) -> None:
    for conflict in merged.conflicts[:MOST_SHOWN]:
        say(f"sweep {conflict.key[4:12]}: {conflict.how}")
    if len(merged.conflicts) > MOST_SHOWN:
        say(f"and {len(merged.conflicts) - MOST_SHOWN} more; --json lists them")
    added = ", ".join(_counted(merged)) or "nothing new"
    there = f"{plural(merged.same, 'result')} and {plural(merged.known_runs, 'run')} there already"
    print(f"{name}: {added}; {there}")
    if merged.conflicts:
        say(f"{plural(len(merged.conflicts), 'conflict')}: what both have and differs stays as it was in {name}")


def _counted(merged: Merged) -> list[str]:
    counts: list[tuple[int, Any]] = [(merged.sweeps, "sweep"), (merged.results, "result"), (merged.runs, "run")]
    return [f"{plural(count, word)} added" for count, word in counts if count]
