"""From identifiers on the command line to sweeps in the database."""

from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path

from fraexp.store import Store, StoredSweep

KEY_DIGITS = 8
"""So many digits, and a number is the beginning of a key."""


def database(arguments: Namespace) -> str:
    """Return the database that the command line names: by default results.db in the workspace."""
    return str(arguments.db or Path(arguments.workspace) / "results.db")


def open_store(arguments: Namespace) -> Store:
    """Open the database for reading only."""
    return Store.open(database(arguments), read_only=True)


def run_of(store: Store, identifier: str) -> int | None:
    """Return the number of the run that is named by it, or by its study: the newest; None for a sweep's key."""
    if identifier.isascii() and identifier.isdigit() and len(identifier) < KEY_DIGITS:
        return int(identifier)
    return next((run.number for run in store.runs() if run.study == identifier), None)


def sweeps_of(store: Store, identifier: str) -> list[StoredSweep]:
    """Return the sweeps of a run, in grid order, or the one of a key."""
    number = run_of(store, identifier)
    return [store.find(identifier)] if number is None else store.sweeps(number)


def chosen(store: Store, identifiers: Iterable[str]) -> list[StoredSweep]:
    """Return the sweeps of all identifiers, each once, in the order in which they are named."""
    found = (sweep for identifier in identifiers for sweep in sweeps_of(store, identifier))
    return list({sweep.key: sweep for sweep in found}.values())
