import os
import shutil
import sqlite3
import stat
import tempfile
from contextlib import closing
from pathlib import Path

import pytest

from fraexp.errors import StoreError
from fraexp.store import Store
from fraexp.store.tables import SCHEMA_NUMBER

HOLDS = """
import sqlite3, sys
connection = sqlite3.connect(sys.argv[1], isolation_level=None)
connection.execute(sys.argv[2])
connection.execute("UPDATE sweep SET findings = findings")
print("ready", flush=True)
sys.stdin.read()
"""


def snapshot(folder: Path) -> dict[str, bytes]:
    return {item.name: item.read_bytes() for item in sorted(folder.iterdir()) if item.is_file()}


def refused(path: Path, match: str, **options) -> None:
    """Check that opening fails in one line and leaves the folder as it was."""
    before = snapshot(path.parent) if path.parent.is_dir() else None
    with pytest.raises(StoreError, match=match) as caught:
        Store.open(str(path), timeout=0.1, **options)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    assert (snapshot(path.parent) if path.parent.is_dir() else None) == before


BOTH = pytest.mark.parametrize("options", [{"create": True}, {"read_only": True}], ids=["writing", "reading"])


@pytest.mark.parametrize("options", [{}, {"read_only": True}])
def test_a_missing_file_is_made_only_when_asked(path, options):
    refused(path, "there is no database yet; 'fraexp run STUDY' makes one", **options)
    path.touch()
    refused(path, "there is no database yet", **options)


def test_an_empty_file_becomes_a_database(path):
    path.touch()
    with Store.open(str(path), create=True) as store:
        assert store.runs() == []
    assert [item.name for item in path.parent.iterdir()] == ["results.db"]
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_a_url_and_a_path_name_the_same_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Store.open("sqlite:///50% of #1?.db", create=True) as store:
        store.begin_run("s", "f", "c", {}, [])
    with Store.open(str(tmp_path / "50% of #1?.db"), read_only=True) as store:
        assert len(store.runs()) == 1


@pytest.mark.parametrize("url", ["sqlite://", "sqlite:///", ":memory:", "", "mysql://host/base", "a\0b"])
def test_what_names_no_file_is_refused(url):
    with pytest.raises(StoreError, match=r"names no file|mysql databases are not supported; give a file"):
        Store.open(url, create=True)


@BOTH
@pytest.mark.parametrize("journal", ["DELETE", "WAL"])
def test_a_foreign_database_is_left_alone(path, options, journal):
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(f"PRAGMA journal_mode = {journal}")
        connection.execute("CREATE TABLE photos (name TEXT)")
    refused(path, "was not made by fraexp; name another file", **options)


@BOTH
@pytest.mark.parametrize("content", [b"x", b"time,force\n" * 100])
def test_a_file_that_is_no_database_is_left_alone(path, options, content):
    path.write_bytes(content)
    refused(path, "this is not a database; name another file", **options)


@BOTH
def test_a_folder_is_no_database(path, options):
    path.mkdir()
    refused(path, "this is not a file; name a database file", **options)


def test_a_folder_that_does_not_exist_is_not_made(tmp_path):
    refused(tmp_path / "absent" / "results.db", "there is no folder .*absent; make it", create=True)


@BOTH
@pytest.mark.parametrize(
    "statement, found",
    [("UPDATE fraexp_schema SET number = 99", "schema 99"), ("DROP TABLE fraexp_schema", "no schema number")],
)
def test_a_database_of_another_schema_is_left_alone(store, path, options, statement, found):
    store.close()
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(statement)
    refused(
        path, f"the database has {found}, this fraexp needs schema {SCHEMA_NUMBER}; open it with the version", **options
    )


def test_a_damaged_database_is_reported(store, path):
    store.close()
    path.write_bytes(path.read_bytes()[:100] + b"\xff" * 5000)
    refused(path, "the database is damaged .*; restore a copy", create=True)


def test_a_locked_database_is_reported_and_nothing_is_written(store, path, program, sweep, result):
    with program(HOLDS, path, "BEGIN IMMEDIATE"), Store.open(str(path), timeout=0.1) as hasty:
        with pytest.raises(StoreError, match=r"results.db: the database is locked by another process .*; wait until"):
            hasty.begin_run("s", "f", "c", {}, [sweep()])
        assert store.runs() == []  # reading needs no lock
    assert store.begin_run("s", "f", "c", {}, [sweep()]) == 1


@BOTH
def test_a_database_locked_against_readers_is_reported(store, path, program, options):
    store.close()
    locked = pytest.raises(StoreError, match="the database is locked by another process")
    with program(HOLDS, path, "PRAGMA locking_mode = EXCLUSIVE"), locked:
        Store.open(str(path), timeout=0.1, **options)


def test_a_reader_cannot_write(store, path, sweep):
    refused_writing = pytest.raises(StoreError, match="the database is open for reading only")
    with Store.open(str(path), read_only=True) as reader, refused_writing:
        reader.begin_run("s", "f", "c", {}, [sweep()])


@pytest.fixture
def locked_folder():
    """Return a folder in which this process may not write, whoever runs it."""
    folder = Path(tempfile.mkdtemp())
    user = os.geteuid()
    with Store.open(str(folder / "old.db"), create=True) as store:
        store.begin_run("s", "f", "c", {}, [])
    (folder / "old.db").chmod(0o444)
    folder.chmod(0o555)
    if user == 0:
        os.seteuid(65534)
    yield folder
    if user == 0:
        os.seteuid(0)
    folder.chmod(stat.S_IRWXU)
    shutil.rmtree(folder)


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_a_read_only_folder_is_reported_and_its_database_can_be_read(locked_folder):
    refused(locked_folder / "results.db", "the folder is read-only; choose", create=True)
    refused(locked_folder / "old.db", "the folder is read-only; choose", create=True)
    with Store.open(str(locked_folder / "old.db"), read_only=True) as store:
        assert store.run(1).study == "s"


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_a_file_that_may_not_be_read_is_reported(locked_folder):
    os.seteuid(os.getuid())
    (locked_folder / "old.db").chmod(0)
    if os.getuid() == 0:
        os.seteuid(65534)
    with pytest.raises(StoreError, match=r"old.db: cannot be read .*; choose another database"):
        Store.open(str(locked_folder / "old.db"), read_only=True)
