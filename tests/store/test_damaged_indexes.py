"""Damaged indexes: a row that is found twice or not at all is shown as damaged, and never as something else."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from fraexp.data.results import Outcome
from fraexp.errors import StoreError
from fraexp.store import Store
from fraexp.store.tables import IN_RUNS, WITHOUT_RUN
from tests.refusals import refused

RUN_INDEX = "sqlite_autoindex_run_sweep_1"
KEY_INDEX = "ix_run_sweep_key_standing_state_run"


@pytest.fixture
def filled(tmp_path, sweep, result) -> Path:
    """A database of two runs: both have sweep 1, and the first one's sweep 2 has failed."""
    path = tmp_path / "filled.db"
    with Store.open(str(path), create=True) as store:
        for grid in ([sweep(0), sweep(1), sweep(2)], [sweep(1, amplitude=2)]):
            run = store.begin_run("friction", "studies/friction.toml", "fraexp run", {}, grid)
            store.save(run, [(item, result(), {}) for item in grid[:2]])
            for item in grid[2:]:
                store.fail(run, item.key, "no signal", "")
            store.end_run(run, "complete")
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
    return path


def index_page(path: Path, index: str) -> tuple[bytearray, int]:
    """Return the file, and where the only page of an index starts."""
    with closing(sqlite3.connect(path)) as connection:
        (page,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (index,)).fetchone()
        (size,) = connection.execute("PRAGMA page_size").fetchone()
    return bytearray(path.read_bytes()), (page - 1) * size


def replace_entry(path: Path, index: str, before: bytes, after: bytes) -> None:
    """Change the entry of an index that ends so; it is on its only page."""
    data, start = index_page(path, index)
    for at in range(start + 8, start + 8 + 2 * int.from_bytes(data[start + 3 : start + 5]), 2):
        cell = start + int.from_bytes(data[at : at + 2])
        end = cell + 1 + data[cell]
        if data[cell:end].endswith(before):
            data[end - len(before) : end] = after
            path.write_bytes(bytes(data))
            return
    raise AssertionError(f"{index} has no entry {before!r}")


def lose_entries(path: Path, condition: str) -> None:
    """Let the index of keys have only the entries that meet a condition, as if the others were not found."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        (sql,) = connection.execute("SELECT sql FROM sqlite_master WHERE name = ?", (KEY_INDEX,)).fetchone()
        connection.execute(f"DROP INDEX {KEY_INDEX}")
        connection.execute(f"{sql} WHERE {condition}")
        connection.execute("PRAGMA writable_schema = ON")
        connection.execute("UPDATE sqlite_master SET sql = ? WHERE name = ?", (sql, KEY_INDEX))


def lose_last_entry(path: Path, index: str) -> None:
    """Let the only page of an index count one entry less than it has."""
    data, start = index_page(path, index)
    data[start + 4] -= 1
    path.write_bytes(bytes(data))


@pytest.mark.parametrize("index", ["ix_sweep_created", "ix_sweep_estimator_name", "sqlite_autoindex_sweep_1"])
def test_a_listing_from_which_an_index_hides_a_sweep_is_refused(filled, index):
    """The page and its count come from the same index, so that both lack the sweep."""
    lose_last_entry(filled, index)
    with Store.open(str(filled), read_only=True) as store:
        for asked in (store.page, store.keys, lambda: store.page("estimator:effective")):
            with refused(StoreError, "index", "restore COPY"):
                asked()


def test_a_run_of_which_a_row_is_read_twice_is_damaged(filled):
    replace_entry(filled, RUN_INDEX, b"\x02\x03", b"\x02\x02")  # position and row number
    with Store.open(str(filled), read_only=True) as store:
        assert store.run(1).state == "damaged"
        assert store.run(1).total == 3
        assert [sweep.outcome for sweep in store.sweeps(1)].count(Outcome.DAMAGED) == 1
        assert store.run(2).state == "complete"
        assert "run 1" in store.health()


def test_a_sweep_whose_run_is_not_found_is_damaged(filled, sweep):
    lose_entries(filled, "run > 1")
    with Store.open(str(filled), read_only=True) as store:
        for number, outcome in ((0, Outcome.DAMAGED), (1, Outcome.OK)):
            assert store.find(sweep(number).key).outcome is outcome
        listed = {row.key: row.outcome for row in store.page().rows}
        assert listed == {
            sweep(0).key: Outcome.DAMAGED, sweep(1).key: Outcome.OK, sweep(2).key: Outcome.DAMAGED
        }  # fmt: skip
        assert store.health() != "sound"


def test_an_earlier_run_does_not_stand_for_the_latest_that_is_not_found(filled, sweep):
    lose_entries(filled, "run < 2")
    with Store.open(str(filled), read_only=True) as store:
        assert store.find(sweep(1).key).outcome is Outcome.DAMAGED
        assert {row.key for row in store.page().rows if row.outcome is Outcome.DAMAGED} == {sweep(1).key}


@pytest.mark.parametrize("word", [WITHOUT_RUN, f"{IN_RUNS}!"])
def test_whether_a_run_has_a_sweep_is_compared(filled, sweep, word):
    with closing(sqlite3.connect(filled)) as connection, connection:
        connection.execute("UPDATE sweep SET in_runs = ? WHERE key = ?", (word, sweep(0).key))
    with Store.open(str(filled), read_only=True) as store:
        assert store.find(sweep(0).key).outcome is Outcome.DAMAGED
        assert store.health() != "sound"


def test_a_sweep_that_no_run_has_is_sound(filled, sweep, tmp_path):
    """Merging leaves such sweeps, if their run is damaged."""
    with closing(sqlite3.connect(filled)) as connection, connection:
        connection.execute("UPDATE run SET study = 'another' WHERE number = 1")
    with Store.open(str(tmp_path / "new.db"), create=True) as store:
        with Store.open(str(filled), read_only=True) as theirs:
            list(store.merge(theirs))
        rows = {row.key: row for row in store.page().rows}
        assert (rows[sweep(0).key].run, rows[sweep(0).key].outcome) == (None, Outcome.OK)
        assert store.find(sweep(0).key).outcome is Outcome.OK
        assert store.health() == "sound"
        run = store.begin_run("friction", "studies/friction.toml", "fraexp run", {}, [sweep(0)])
        assert (store.find(sweep(0).key).outcome, store.page(run=run).rows[0].run) == (Outcome.OK, run)
        assert store.health() == "sound"
