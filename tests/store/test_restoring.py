"""Copies of a database: made, put back, and laid over a file whose writer was killed."""

import shutil
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.results import Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.errors import StoreError
from fraexp.store import Store
from tests.refusals import refused

WRITES = """
import sys
from tests.store.test_restoring import write
store = write(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
print("ready", flush=True)
sys.stdin.read()
"""


def write(path: str, first: int, last: int) -> Store:
    """Add a run of sweeps."""
    store = Store.open(path, create=True)
    grid = [Sweep({"source": "loop", "number": number}, {"name": "e", "version": 1}) for number in range(first, last)]
    run = store.begin_run("s", "f", "c", {}, grid)
    metrics = tuple(Metric(f"value {number}", 1.0, "1") for number in range(20))
    for start in range(0, len(grid), 50):
        store.save(run, [(point, Result(Outcome.OK, metrics=metrics), {}) for point in grid[start : start + 50]])
    store.end_run(run, "complete")
    return store


@pytest.fixture
def copy(path) -> Path:
    """A copy of the database as it was after its first run."""
    write(str(path), 0, 20).close()
    shutil.copyfile(path, path.with_name("copy.db"))
    return path.with_name("copy.db")


@pytest.fixture
def killed(path, copy, program) -> Path:
    """A database whose writer was killed, beside its log."""
    write(str(path), 20, 120).close()
    with program(WRITES, path, 120, 140) as process:
        process.kill()
        process.wait()
    assert Path(f"{path}-wal").stat().st_size > 0
    return path


def contents(path: Path) -> list[tuple[int, int]]:
    with Store.open(str(path), read_only=True) as store:
        assert store.health() == "sound"
        return [(run.number, run.total) for run in store.runs()]


def names(folder: Path) -> list[str]:
    """Return the databases in a folder; a reader may leave an empty log beside one."""
    return sorted(item.name for item in folder.iterdir() if not item.name.endswith(("-wal", "-shm")))


def test_the_log_of_a_killed_writer_is_read(killed):
    assert contents(killed) == [(3, 20), (2, 100), (1, 20)]
    Store.open(str(killed)).close()
    assert contents(killed) == [(3, 20), (2, 100), (1, 20)]


def test_a_copy_laid_over_a_file_beside_a_dead_writers_log_is_read_and_the_log_is_named(killed, copy, capsys):
    shutil.copyfile(copy, killed)
    before = killed.read_bytes(), Path(f"{killed}-wal").read_bytes()
    assert contents(killed) == [(1, 20)]
    with refused(StoreError, killed, "results.db-wal", "'fraexp restore"):
        Store.open(str(killed))
    assert main(["merge", str(killed), "--db", str(killed.with_name("saved.db"))]) == ExitCode.OK
    assert "belongs to another file" in capsys.readouterr().err
    assert contents(killed.with_name("saved.db")) == [(1, 20)]
    assert (killed.read_bytes(), Path(f"{killed}-wal").read_bytes()) == before
    assert main(["restore", str(killed), "--db", str(killed)]) == ExitCode.OK  # what the message says
    assert contents(killed) == [(1, 20)]
    Store.open(str(killed)).close()
    assert (Path(f"{killed}.before-1").read_bytes(), Path(f"{killed}.before-1-wal").read_bytes()) == before


def test_a_copy_is_restored_and_the_earlier_database_is_kept_with_its_log(killed, copy, capsys):
    assert main(["restore", str(copy), "--db", str(killed)]) == ExitCode.OK
    told = capsys.readouterr().err
    assert "with 1 run and 20 sweeps" in told
    assert f"the earlier database is {killed}.before-1" in told
    assert contents(killed) == contents(copy) == [(1, 20)]
    assert contents(Path(f"{killed}.before-1")) == [(3, 20), (2, 100), (1, 20)]
    write(str(killed), 20, 40).close()
    assert main(["restore", str(copy), "--db", str(killed)]) == ExitCode.OK
    assert contents(Path(f"{killed}.before-2")) == [(2, 20), (1, 20)]


def test_a_copy_is_made_while_a_run_writes(path, program):
    with program(WRITES, path, 0, 20):
        assert main(["restore", str(path), "--db", str(path.with_name("copy.db"))]) == ExitCode.OK
    assert contents(path.with_name("copy.db")) == [(1, 20)]


def test_nothing_is_restored_under_a_process_that_has_the_database_open(path, copy, program):
    with program(WRITES, path, 20, 40):
        before = names(path.parent)
        with refused(StoreError, path, "another process", "'fraexp stop'"):
            Store.restore(str(path), str(copy))
        assert names(path.parent) == before
    with Store.open(str(path)) as store:
        store.begin_run("s", "f", "c", {}, [])
        with refused(StoreError, path, "run 3", "fraexp stop 3"):
            Store.restore(str(path), str(copy))


def test_a_damaged_or_missing_copy_is_not_restored(path, copy):
    before = path.read_bytes()
    copy.write_bytes(copy.read_bytes()[:-20000] + b"\xff" * 20000)
    with refused(StoreError, copy, "damaged"):
        Store.restore(str(path), str(copy))
    with refused(StoreError, "absent.db"):
        Store.restore(str(path), str(path.with_name("absent.db")))
    assert path.read_bytes() == before
    assert names(path.parent) == ["copy.db", "results.db"]


def test_a_destroyed_database_is_replaced_by_a_copy(path, copy):
    path.write_bytes(b"\xff" * 5000)
    assert Store.restore(str(path), str(copy)) == f"{path}.before-1"
    assert contents(path) == [(1, 20)]
    path.unlink()
    assert Store.restore(str(path), str(copy)) == ""
