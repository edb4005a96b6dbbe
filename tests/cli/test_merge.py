"""What ``fraexp merge`` says of a database that cannot be added."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from tests.cli.conftest import fill


def refused(folder: Path, capsys: pytest.CaptureFixture[str], other: str) -> str:
    """Return the one line with which a database is refused."""
    assert main(["merge", str(folder / other), "--db", str(folder / "mine.db")]) == ExitCode.STORE
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_a_file_without_a_database_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty.db").touch()
    remedy = "expected the database to merge"
    missing = refused(tmp_path, capsys, "missing.db")
    assert missing == f"fraexp: {tmp_path / 'missing.db'}: there is no such file; {remedy}"
    assert (
        refused(tmp_path, capsys, "empty.db")
        == f"fraexp: {tmp_path / 'empty.db'}: it contains no fraexp database; {remedy}"
    )
    assert not (tmp_path / "mine.db").exists()


def test_a_database_of_another_schema_is_named_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(tmp_path / "old.db")
    with closing(sqlite3.connect(tmp_path / "old.db")) as connection, connection:
        connection.execute("DROP TABLE fraexp_schema")
    assert "old.db: the database has no schema number, this fraexp needs" in refused(tmp_path, capsys, "old.db")


def test_a_stored_outcome_that_is_none_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fill(tmp_path / "odd.db")
    with closing(sqlite3.connect(tmp_path / "odd.db")) as connection, connection:
        connection.execute("UPDATE sweep SET outcome = 'ok' WHERE outcome IS NOT NULL")
    place = ["--db", str(tmp_path / "mine.db")]
    assert main(["merge", str(tmp_path / "odd.db"), *place, "--json"]) == ExitCode.INCOMPLETE
    merged = json.loads(capsys.readouterr().out)
    assert (merged["read"], merged["added"], len(merged["damaged"])) == (5, 1, 4)
    assert main(["merge", str(tmp_path / "odd.db"), *place]) == ExitCode.INCOMPLETE
    printed = capsys.readouterr()
    assert "5 sweeps read: 0 added, 1 already there, 0 conflicts, 4 damaged; 1 run read: " in printed.out
    assert "it cannot be read, or its parameters are damaged; left out" in printed.err
