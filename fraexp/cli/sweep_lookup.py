"""From identifiers on the command line to sweeps in the database."""

from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fraexp.cli.output import say
from fraexp.errors import FraexpError, StoreError
from fraexp.store import Store, StoredSweep
from fraexp.workspace.workspace_folder import WorkspaceFolder

MIN_KEY_DIGITS = 8
"""A number with at least so many digits that no run has is taken as the beginning of a key."""
MAX_RUN_DIGITS = 18
"""Maximum number of digits of a run number."""


def workspace_folder(arguments: Namespace) -> WorkspaceFolder:
    """Return the workspace that the command line names; only its database has to be there, not its folder."""
    folder = Path(arguments.workspace)
    return WorkspaceFolder(folder, str(arguments.db or folder / "results.db"))


def find_run_number(store: Store, identifier: str) -> int | None:
    """Return the run of a number, or the newest run with results of a study name; None for a sweep key."""
    if identifier.isascii() and identifier.isdigit():
        return _find_run_of_digits(store, identifier)
    numbers = _numbers_of_study(store, identifier)
    return numbers[-1] if numbers else None


def _numbers_of_study(store: Store, name: str) -> list[int]:
    """Return the runs of a study from the newest to the newest with results; to no other if none has results."""
    runs = [run for run in store.runs() if run.study == name]
    taken = next((place for place, run in enumerate(runs) if run.computed + run.reused), 0)
    return [run.number for run in runs[: taken + 1]]


def _find_run_of_digits(store: Store, identifier: str) -> int | None:
    """Return the run of a number; None if no run has it, but a sweep key begins with these digits."""
    number = int(identifier) if len(identifier) <= MAX_RUN_DIGITS else 0
    short = number if len(identifier) < MIN_KEY_DIGITS else None  # looking it up raises the error
    return number if _is_found(store.run, number) else None if _is_found(store.find, identifier) else short


def _is_found(ask: Callable[[Any], object], what: object) -> bool:
    try:
        ask(what)
    except StoreError:
        return False
    return True


def find_sweeps(store: Store, identifier: str) -> list[StoredSweep]:
    """Return the sweeps of a run in grid order, or the sweep of a key; report a newer run that has no results."""
    number = find_run_number(store, identifier)
    numbers = _numbers_of_study(store, identifier)
    if number in numbers[1:]:
        say(f"run {numbers[0]} of {identifier} has no results yet; run {number}, the newest with results, is taken")
    return [store.find(identifier)] if number is None else store.sweeps(number)


def choose_sweeps(store: Store, identifiers: Sequence[str], wanted: str | None = None) -> list[StoredSweep]:
    """Return the sweeps of all identifiers that match a filter, each once, in the given order.

    Without identifiers these are all sweeps that match it. FraexpError if there is neither, StoreError if nothing
    matches.
    """
    if wanted is None and not identifiers:
        raise FraexpError("no sweeps are named; give a run number, a study name, a sweep key, or --filter FILTER")
    if not identifiers:
        found = list(store.find_all(store.keys(wanted or "")).values())
    else:
        found = [sweep for identifier in identifiers for sweep in _matching(store, identifier, wanted)]
    if wanted is not None and not found:
        raise StoreError(f"no sweep{' of these' if identifiers else ''} matches {wanted or 'the empty filter'}")
    return list({sweep.key: sweep for sweep in found}.values())


def _matching(store: Store, identifier: str, wanted: str | None) -> list[StoredSweep]:
    sweeps = find_sweeps(store, identifier)
    if wanted is None:
        return sweeps
    keys = set(store.keys(wanted, find_run_number(store, identifier)))
    return [sweep for sweep in sweeps if sweep.key in keys]
