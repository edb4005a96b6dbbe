"""From identifiers on the command line to sweeps in the database."""

import shlex
from argparse import Namespace
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from fraexp.errors import StoreError
from fraexp.store import Store, StoredSweep, shown

KEY_DIGITS = 8
"""So many digits, and a number that no run has is meant as the beginning of a key."""
LONGEST = 18
"""Digits of a run's number, at most."""


def database(arguments: Namespace) -> str:
    """Return the database that the command line names: by default results.db in the workspace."""
    return str(arguments.db or Path(arguments.workspace) / "results.db")


def place(arguments: Namespace) -> str:
    """Return the options that name workspace and database as the command line did, for commands that are proposed."""
    given = {"--workspace": arguments.workspace, "--db": arguments.db}
    return "".join(
        f" {option} {shlex.quote(shown(str(value)))}" for option, value in given.items() if str(value or ".") != "."
    )


def open_store(arguments: Namespace) -> Store:
    """Open the database for reading only."""

    def units(path: str) -> set[str]:  # plugins are looked at only where a filter has a unit
        from fraexp.components.registry import discover
        from fraexp.study.paths import units_of

        return units_of(path, discover(Path(arguments.workspace) / "plugins"))

    return Store.open(database(arguments), read_only=True, units=units)


def run_of(store: Store, identifier: str) -> int | None:
    """Return the number of the run that is named by it, or by its study: the newest; None for a sweep's key."""
    if identifier.isascii() and identifier.isdigit():
        return _run_of_digits(store, identifier)
    return next((run.number for run in store.runs() if run.study == identifier), None)


def _run_of_digits(store: Store, identifier: str) -> int | None:
    """Return the run of a number; None if there is none, but digits are how a sweep's key begins."""
    number = int(identifier) if len(identifier) <= LONGEST else 0
    short = number if len(identifier) < KEY_DIGITS else None  # whoever asks for it is told that there is none
    return number if _there(store.run, number) else None if _there(store.find, identifier) else short


def _there(ask: Callable[[Any], object], what: Any) -> bool:
    try:
        ask(what)
    except StoreError:
        return False
    return True


def sweeps_of(store: Store, identifier: str) -> list[StoredSweep]:
    """Return the sweeps of a run, in grid order, or the one of a key."""
    number = run_of(store, identifier)
    return [store.find(identifier)] if number is None else store.sweeps(number)


def chosen(store: Store, identifiers: Iterable[str]) -> list[StoredSweep]:
    """Return the sweeps of all identifiers, each once, in the order in which they are named."""
    found = (sweep for identifier in identifiers for sweep in sweeps_of(store, identifier))
    return list({sweep.key: sweep for sweep in found}.values())
