"""What databases from strangers have found: each was an internal error, a hang, or code of somebody else."""

import contextlib
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy.exc import StatementError

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.errors import StoreError
from fraexp.store import Store
from fraexp.store.codec import encode_array
from fraexp.store.validation import FOREIGN_DATA_ERRORS
from tests.cli.conftest import fill
from tests.examples import some
from tests.refusals import refused
from tests.store.conftest import reseal


@pytest.fixture
def database(tmp_path: Path) -> Path:
    fill(tmp_path / "results.db")
    return tmp_path / "results.db"


def change(path: Path, *statements: str) -> None:
    with contextlib.closing(sqlite3.connect(path)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()
    with contextlib.suppress(*FOREIGN_DATA_ERRORS, StatementError):  # strangers can compute digests
        reseal(str(path))


FOREIGN = {
    "trigger": "CREATE TRIGGER t AFTER UPDATE ON run BEGIN DELETE FROM sweep; END",
    "view": "CREATE VIEW v AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x FROM c) SELECT x FROM c",
    "computed column": "ALTER TABLE tag ADD COLUMN more AS (zeroblob(1000000000))",
}


@pytest.mark.parametrize(("what", "statement"), FOREIGN.items(), ids=FOREIGN)
def test_a_database_with_code_of_its_own_is_refused(what: str, statement: str, database: Path) -> None:
    change(database, statement)
    for read_only in (True, False):
        with refused(StoreError, database, what):
            Store.open(str(database), read_only=read_only)


STRANGE = {
    "a number of bytes": "UPDATE frequency_response SET response = 1000000000000",
    "an outcome": "UPDATE sweep SET outcome = 'x'",
    "a time": "UPDATE run SET started = 'yesterday'",
    "a key": "UPDATE run_sweep SET labels = '[1]'",
    "deep labels": f"UPDATE run_sweep SET labels = '{'[' * 900 + ']' * 900}'",
    "a host": "UPDATE run SET pid = 'x'",
    "an origin": "UPDATE supplied_component SET source_hash = x'00'",
}


@pytest.mark.parametrize("statement", some(STRANGE.values(), STRANGE["a time"]), ids=STRANGE)
def test_a_database_of_other_contents_is_refused_in_a_line_or_shown_as_damaged(
    statement: str, database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(database, "PRAGMA foreign_keys = OFF", statement)
    place = ["--db", str(database), "--workspace", str(database.parent)]
    codes = [
        main([*command, *place]) for command in (["list"], ["show", "1"], ["compare", "1"], ["show", "1", "--json"])
    ]
    codes.append(main(["plot", "1", "-o", str(database.parent / "a.svg"), *place]))
    printed = capsys.readouterr()
    assert ExitCode.INTERNAL not in codes
    assert ExitCode.STORE in codes or "damaged" in printed.out
    assert "Traceback" not in printed.err and "\x1b" not in printed.err


def test_a_log_of_bytes_and_frequencies_below_0_are_no_error_of_ours(database: Path) -> None:
    change(database, "UPDATE run_sweep SET log = x'00'")
    with Store.open(str(database), read_only=True) as store, refused(StoreError, "log", "bytes"):
        store.log(store.sweeps(1)[0].key)
    still = encode_array(np.append(-1.0, np.arange(39.0)), "")
    with contextlib.closing(sqlite3.connect(database)) as connection:
        connection.execute("UPDATE frequency_response SET frequency = ?", (still,))
        connection.commit()
    change(database, "UPDATE run_sweep SET log = ''")
    place = ["--db", str(database), "--workspace", str(database.parent)]
    assert main(["plot", "1", "-o", str(database.parent / "a.svg"), *place]) == ExitCode.STORE


def test_escape_codes_in_a_database_do_not_command_the_terminal(
    database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    evil = "'a' || char(27) || '[2J' || char(8238)"
    change(
        database,
        f"UPDATE run SET study = {evil}, command = {evil}, host = {evil}",
        f"UPDATE metric SET name = {evil}, unit = {evil}",
        """UPDATE sweep SET findings = '[{"kind": "remark", "text": "a\\u001b[2J\\u202e"}]'""",
        f"UPDATE curve SET name = {evil}",
        f"UPDATE curve_column SET unit = {evil}",
    )
    place = ["--db", str(database), "--workspace", str(database.parent)]
    for command in (
        ["list"],
        ["list", "state=computed"],
        ["show", "1"],
        ["compare", "1"],
        ["list", "--json"],
        ["show", "1", "--json"],
    ):
        assert main([*command, *place]) == ExitCode.OK
    captured = capsys.readouterr()
    assert "\\x1b[2J" in captured.out
    assert not {"\x1b", "\u202e"} & set(captured.out + captured.err)
