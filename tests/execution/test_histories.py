"""Histories of schedulers, their store and their workers in simulated time, with faults at every statement."""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fraexp.store import Store
from fraexp.store.changes import leases, writing
from tests.examples import some
from tests.execution.simulation.world import World

CHUNK = 50
SEEDS, CHECKED = 1000, 400
"""Histories in which a bug is sought, and those without one that the whole suite makes."""


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        yield World(Path(folder))


@pytest.mark.parametrize("first", some(range(0, CHECKED, CHUNK), 0))
def test_no_history_breaks_an_invariant(world: World, first: int) -> None:
    assert list(world.broken(range(first, first + CHUNK))) == []


def test_a_history_follows_from_its_seed(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a bug, so that there are findings to compare."""
    save_unfenced(monkeypatch)
    first = next(world.broken(range(SEEDS)))
    assert world.history(first.seed) == first


def save_unfenced(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run stores also what another one has taken over."""
    monkeypatch.setattr(leases, "held_sweeps", lambda connection, number, keys: set(keys))


def split_the_transaction(monkeypatch: pytest.MonkeyPatch) -> None:
    """A result is stored in one transaction, and marked as computed in the next one."""
    save, mark = Store.save, writing.mark_sweeps

    def save_in_two(self: Store, run: int, results, is_fenced: bool = False) -> set[str]:
        with monkeypatch.context() as during:
            during.setattr(writing, "mark_sweeps", lambda *_: None)
            stored = save(self, run, results, is_fenced)
        with self._writing() as connection:
            mark(connection, run, stored, "computed")
        return stored

    monkeypatch.setattr(Store, "save", save_in_two)


def check_the_lease_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lease is checked in a transaction of its own, before that which stores."""
    save = Store.save

    def check_and_save(self: Store, run: int, results, is_fenced: bool = False) -> set[str]:
        keys = [sweep.key for sweep, _, _ in results]
        with self._writing() as connection:
            held = leases.held_sweeps(connection, run, keys)
            held |= leases.finished_sweeps(connection, run, keys, "computed")
        return save(self, run, [entry for entry in results if entry[0].key in held])

    monkeypatch.setattr(Store, "save", check_and_save)


def forget_what_was_stored(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call that is repeated because its answer was lost takes its own result for another run's."""
    monkeypatch.setattr(leases, "finished_sweeps", lambda *_: set())


def begin_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is begun again because the answer was lost is stored twice."""
    monkeypatch.setattr(writing, "_find_run", lambda *_: None)


def keep_leases(monkeypatch: pytest.MonkeyPatch) -> None:
    """A result does not end its lease."""
    monkeypatch.setattr(leases, "release_leases", lambda *_: None)


BUGS = [save_unfenced, split_the_transaction, check_the_lease_before, forget_what_was_stored, begin_again, keep_leases]


@pytest.mark.parametrize("bug", some(BUGS, save_unfenced))
def test_a_bug_that_is_put_back_is_found(world: World, monkeypatch: pytest.MonkeyPatch, bug: Callable) -> None:
    bug(monkeypatch)
    assert next(world.broken(range(SEEDS)), None) is not None
