"""Migrations that are killed half-way: the file is what it was before, and the next one to open it gets it done."""

import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from fraexp.data.results import Outcome
from fraexp.store import Store
from fraexp.store.backends.sqlite import SqliteFile
from fraexp.store.migrations import HISTORY

pytestmark = pytest.mark.thorough
ROOT = Path(__file__).parents[2]
ASSETS = Path(__file__).parent / "assets"

STOPS_AT = """
import sys
from pathlib import Path
from sqlalchemy import event
from sqlalchemy.engine import Engine
from fraexp.store import Store

place, seen = sys.argv[2], 0

def stop(*_):
    print("ready", flush=True)
    sys.stdin.read()

def statement(*_):
    global seen
    seen += 1
    if place == str(seen):
        stop()

event.listen(Engine, "after_cursor_execute", statement)
if place == "commit":
    event.listen(Engine, "commit", stop)
if place == "copied":  # the copy is complete, and does not bear its name yet
    Path.replace = stop
if place == "copying":
    import fraexp.store.backends.sqlite as module
    whole = module.SqliteFile.connect
    class Halting:
        def __init__(self, connection):
            self.connection = connection
        def backup(self, target):
            self.connection.backup(target, pages=3, progress=stop)
        def close(self):
            self.connection.close()
    module.SqliteFile.connect = lambda self, query: (
        Halting(whole(self, query)) if query == "mode=ro" else whole(self, query)
    )
Store.open(sys.argv[1])
print(seen, flush=True)
"""


def statements(folder: Path, schema: str) -> int:
    """Return how many statements a migration takes."""
    shutil.copy(ASSETS / f"schema-{schema}.db", folder / "counted.db")
    command = [sys.executable, "-c", STOPS_AT, str(folder / "counted.db"), "never"]
    return int(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)


def places(last: int) -> list[str]:
    return ["copying", "copied", "1", "2", str(last // 4), str(last // 2), str(3 * last // 4), str(last - 1), "commit"]


@pytest.mark.parametrize("schema", ["0001", "0003"])
def test_a_migration_that_is_killed_leaves_the_file_as_it_was(path, program, schema, tmp_path_factory):
    for place in places(statements(tmp_path_factory.mktemp("counting"), schema)):
        for old in path.parent.iterdir():
            old.unlink()
        shutil.copy(ASSETS / f"schema-{schema}.db", path)
        with program(STOPS_AT, path, place) as process:
            process.kill()
            process.wait()
        assert SqliteFile(path, 1.0).revision() == schema, place
        with closing(sqlite3.connect(path)) as connection:
            assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)], place
            assert connection.execute("SELECT count(*) FROM sweep").fetchone() == (2,), place
        with Store.open(str(path)) as store:
            assert (store.run(1).computed, store.run(1).failed, store.health()) == (1, 1, "sound"), place
            done = store.sweeps(1)[0]
            assert store.stored_states([done.key])[done.key].outcome is Outcome.OK
        names = sorted(item.name for item in path.parent.iterdir())
        assert names == ["results.db", f"results.db.bak-{schema}"], place
        with Store.open(f"{path}.bak-{schema}") as copy:
            assert copy.run(1).computed == 1, place


def test_a_database_that_is_killed_while_it_is_made_is_made_by_the_next(path, program):
    for place in ("1", "20", "commit"):
        with program(STOPS_AT.replace("open(sys.argv[1])", "open(sys.argv[1], create=True)"), path, place) as process:
            process.kill()
            process.wait()
        assert not path.exists()
        with Store.open(str(path), create=True) as store:
            assert store.runs() == []
        assert SqliteFile(path, 1.0).revision() == HISTORY[-1]
        path.unlink()
