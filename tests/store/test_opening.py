import os
import shutil
import sqlite3
import stat
import tempfile
from contextlib import closing
from pathlib import Path

import pytest

from fraexp.errors import StoreError, UnavailableError
from fraexp.store import Store
from fraexp.store.tables import SCHEMA_NUMBER
from tests.refusals import refused

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


def check_refused(path: Path, *names: str, **options) -> None:
    """Check that opening fails and leaves the folder as it was."""
    before = snapshot(path.parent) if path.parent.is_dir() else None
    with refused(StoreError, path, *names):
        Store.open(str(path), timeout=0.1, **options)
    assert (snapshot(path.parent) if path.parent.is_dir() else None) == before


BOTH = pytest.mark.parametrize("options", [{"create": True}, {"read_only": True}], ids=["writing", "reading"])


@pytest.mark.parametrize("options", [{}, {"read_only": True}])
def test_a_missing_file_is_made_only_when_asked(path, options):
    check_refused(path, "fraexp run STUDY", **options)
    path.touch()
    check_refused(path, "fraexp run STUDY", **options)


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
    with refused(StoreError, url.partition("\0")[0]):
        Store.open(url, create=True)


@BOTH
@pytest.mark.parametrize("journal", ["DELETE", "WAL"])
def test_a_foreign_database_is_left_alone(path, options, journal):
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(f"PRAGMA journal_mode = {journal}")
        connection.execute("CREATE TABLE photos (name TEXT)")
    check_refused(path, "fraexp", **options)


@BOTH
@pytest.mark.parametrize("content", [b"x", b"time,force\n" * 100])
def test_a_file_that_is_no_database_is_left_alone(path, options, content):
    path.write_bytes(content)
    check_refused(path, "not a database", **options)


@BOTH
def test_a_folder_is_no_database(path, options):
    path.mkdir()
    check_refused(path, "not a file", **options)


def test_a_folder_that_does_not_exist_is_not_made(tmp_path):
    check_refused(tmp_path / "absent" / "results.db", f"folder {tmp_path / 'absent'}", create=True)


@BOTH
@pytest.mark.parametrize(
    "statement, found",
    [("UPDATE fraexp_schema SET number = 99", "schema 99"), ("DROP TABLE fraexp_schema", "no schema number")],
)
def test_a_database_of_another_schema_is_left_alone(store, path, options, statement, found):
    store.close()
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(statement)
    check_refused(path, found, f"schema {SCHEMA_NUMBER}", "--db", **options)


def test_a_damaged_database_is_reported(store, path):
    store.close()
    path.write_bytes(path.read_bytes()[:100] + b"\xff" * 5000)
    check_refused(path, "damaged", "restore COPY", create=True)


def test_a_locked_database_is_reported_and_nothing_is_written(store, path, program, sweep, result):
    with program(HOLDS, path, "BEGIN IMMEDIATE"), Store.open(str(path), timeout=0.1) as hasty:
        with refused(UnavailableError, path):
            hasty.begin_run("s", "f", "c", {}, [sweep()])
        assert store.runs() == []  # reading needs no lock
    assert store.begin_run("s", "f", "c", {}, [sweep()]) == 1


@BOTH
def test_a_database_locked_against_readers_is_reported(store, path, program, options):
    store.close()
    with program(HOLDS, path, "PRAGMA locking_mode = EXCLUSIVE"), refused(UnavailableError, path):
        Store.open(str(path), timeout=0.1, **options)


def test_a_reader_cannot_write(store, path, sweep):
    with Store.open(str(path), read_only=True) as reader, refused(StoreError, path, "reading only"):
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
    check_refused(locked_folder / "results.db", "read-only", create=True)
    check_refused(locked_folder / "old.db", "read-only", create=True)
    with Store.open(str(locked_folder / "old.db"), read_only=True) as store:
        assert store.run(1).study == "s"


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_a_file_that_may_not_be_read_is_reported(locked_folder):
    os.seteuid(os.getuid())
    (locked_folder / "old.db").chmod(0)
    if os.getuid() == 0:
        os.seteuid(65534)
    with refused(StoreError, locked_folder / "old.db"):
        Store.open(str(locked_folder / "old.db"), read_only=True)
