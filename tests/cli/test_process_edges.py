"""What surrounds a process: signals that its parent ignores, full or closed streams, arguments that all can see."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.cli.output import MAX_LINE_LENGTH, shorten
from fraexp.data.results import Outcome, Result
from fraexp.errors import StoreError
from fraexp.figures import drawing
from fraexp.figures.elements.grouping import ShownResult
from fraexp.store import Store, masked_url, url_without_password
from fraexp.store.backends import locate_database
from fraexp.store.backends.postgresql import parse_url
from fraexp.store.changes import writing
from tests.cli.conftest import ROOT, fill, response_of
from tests.examples import some, thorough
from tests.refusals import refused
from tests.waiting import HANG_TIMEOUT_S

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and descriptors of POSIX")
FEW = ["quick", "--set=excitation.points=2", "--set=excitation.min_frequency=20"]
SLOW = {"min_frequency": 1e-3, "points": 3, "settling_tolerance": 1e-15, "settling_timeout": 10_000}
LONG = ["quick", *(f"--set=excitation.{name}={value}" for name, value in SLOW.items()), "--executor=serial"]
SECRET = "hush@hush"


def shell(line: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a line of the shell, in which ``fraexp`` is this checkout's."""
    command = f'fraexp() {{ "{sys.executable}" -m fraexp "$@"; }}; {line}'
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'plugins'}", **variables}
    return subprocess.run(
        ["bash", "-c", command], cwd=folder, env=environment, capture_output=True, text=True, check=False,
        timeout=HANG_TIMEOUT_S,
    )  # fmt: skip


def started(folder: Path, **more: Any) -> subprocess.Popen[str]:
    """Return a long run that computes."""
    command = [sys.executable, "-m", "fraexp", "run", *LONG]
    process = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True, **more)
    assert process.stderr is not None
    assert any(" worker" in line for line in process.stderr)
    return process


def ignore_hang_up() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)


@pytest.mark.thorough
def test_a_hang_up_that_the_parent_ignores_stays_ignored(tmp_path: Path) -> None:
    process = started(tmp_path, preexec_fn=ignore_hang_up)
    status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
    ignored = next(int(line.split()[1], 16) for line in status.splitlines() if line.startswith("SigIgn"))
    assert ignored >> (signal.SIGHUP - 1) & 1
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)  # the only one of both that ends it
    _, told = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.INTERRUPTED
    assert "stopped by you" in told


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("line", ["list", thorough("--help")])
def test_a_full_standard_output_is_one_line_and_an_exit_code(
    line: str, unbuffered: str, workspace: Path, tmp_path: Path
) -> None:
    done = shell(f"fraexp {line} --workspace {workspace} >/dev/full", tmp_path, PYTHONUNBUFFERED=unbuffered)
    assert done.returncode == ExitCode.OUTPUT
    assert done.stderr.splitlines()[-1].startswith("fraexp: standard output cannot be written (No space left on device")
    assert "internal error" not in done.stderr


@pytest.mark.parametrize("streams", [">&-", thorough("<&- >&- 2>&-")])
def test_streams_that_are_closed_or_full_are_no_error(streams: str, workspace: Path, tmp_path: Path) -> None:
    done = shell(f"fraexp list --json --workspace {workspace} {streams}", tmp_path)
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")
    assert not done.stdout or json.loads(done.stdout)["runs"]
    done = shell(f"fraexp show 99 --workspace {workspace} {streams}", tmp_path)
    assert (done.returncode, done.stdout) == (ExitCode.STORE, "")


@pytest.mark.thorough
def test_a_run_whose_messages_nobody_takes_is_stored(tmp_path: Path) -> None:
    done = shell(f"fraexp run {' '.join(FEW)} >/dev/full 2>/dev/full; echo $?", tmp_path, PYTHONUNBUFFERED="")
    assert done.stdout == f"{ExitCode.OUTPUT}\n"
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        assert store.run(1).state == "complete"


@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        (["show", "99"], ExitCode.STORE, "there is no run 99; the newest is run 1"),
        (["show", "1", "--jsn"], ExitCode.USAGE, "show: unknown option '--jsn'; did you mean '--json'?"),
        (["list", "outcome=broken"], ExitCode.USAGE, "filter: there is no outcome 'broken'"),
        (["run", "qick"], ExitCode.USAGE, "there is no study 'qick'; did you mean 'quick'?"),
    ],
)
def test_an_error_under_json_is_a_document(
    line: list[str], code: int, message: str, workspace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*line, "--json", "--workspace", str(workspace)]) == code
    printed = capsys.readouterr()
    told = json.loads(printed.out)["error"]
    assert told["exit_code"] == code
    assert told["message"].startswith(message)
    assert printed.err == f"fraexp: {told['message']}\n"


@pytest.mark.parametrize("name", ["", " "])
def test_a_study_without_a_name_is_refused(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "one.toml").write_text("title = 'one'")
    assert main(["run", name, "--workspace", str(tmp_path)]) == ExitCode.USAGE
    assert "a study's name is empty" in capsys.readouterr().err


@pytest.mark.parametrize("words", ["{}", "a {} b", "{} {}"])
def test_a_line_is_short_whatever_it_quotes(words: str, length: int = 100_000) -> None:
    for name in ("x" * length, "x y " * (length // 4)):
        line = shorten(f"studies/x.toml: {words.format(name, name)}; did you mean 'quick'?")
        assert len(line) <= MAX_LINE_LENGTH
        assert line.startswith("studies/x.toml: ")
        assert line.endswith("; did you mean 'quick'?")


@pytest.mark.parametrize(
    "url",
    [
        f"postgresql://me:{SECRET}@127.0.0.1:1/db",
        f"postgres://me:{SECRET}@127.0.0.1:1/db?connect_timeout=2",
        f"postgresql:/me:{SECRET}@127.0.0.1:1/db",
        f"postgresql:me:{SECRET}@127.0.0.1/db",
        f"postgres//me:{SECRET}@127.0.0.1/db",
        f" postgresql://me:{SECRET}@127.0.0.1:1/db",
        f"oracle://me:{SECRET}@127.0.0.1:1/db",
        f"postgresql://me:{SECRET}@127.0.0.1:port/db",
        f"postgresql://127.0.0.1:1/db?user=me&password={SECRET}",
    ],
)
def test_a_password_is_in_no_error(url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for line in (["list"], ["run", "quick"], ["merge", url], ["undelete"]):
        assert main([*line, "--db", url, "--workspace", str(tmp_path)]) in (ExitCode.STORE, ExitCode.USAGE)
        printed = capsys.readouterr()
        assert "hush" not in printed.out + printed.err
    assert "hush" not in masked_url(url) + url_without_password(url)


@pytest.mark.parametrize("written", [SECRET, "hush%40hush", "a/b?c#d:e@f", "a@b"])
def test_a_password_needs_no_escapes(written: str) -> None:
    parsed = parse_url(f"postgresql://me:{written}@host:5432/base?application_name=x")
    assert (parsed.username, parsed.password) == ("me", SECRET if "%" in written else written)
    assert (parsed.host, parsed.port, parsed.database) == ("host", 5432, "base")
    assert dict(parsed.query) == {"application_name": "x"}


def test_a_url_that_is_suggested_can_be_pasted() -> None:
    database = locate_database(f"postgresql://me:{SECRET}@host:5432/base?application_name=a%20b&password=hush", 1.0)
    assert parse_url(database.location) == parse_url("postgresql://me@host:5432/base?application_name=a%20b")


def test_a_password_is_in_no_arguments_of_a_background_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    url = f"postgresql://me:{SECRET}@127.0.0.1:1/db"
    script = tmp_path / "python"  # notes its arguments and the database in its environment
    script.write_text('#!/bin/sh\nprintf "%s " "$@" >arguments\nprintf %s "$FRAEXP_DB" >database\nexit 3\n')
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))
    assert main(["run", *FEW, "--detach", "--db", url]) == ExitCode.STORE
    assert "hush" not in (tmp_path / "arguments").read_text() + "".join(capsys.readouterr())
    assert (tmp_path / "database").read_text() == url


def test_the_database_is_taken_from_the_environment(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FRAEXP_DB", str(workspace / "results.db"))
    assert main(["list"]) == ExitCode.OK
    assert "bench" in capsys.readouterr().out
    main(["list", "--db", "other.db"])
    assert capsys.readouterr().out == ""


@pytest.mark.thorough
@pytest.mark.parametrize("json_option", some(["", "--json"], "--json"))
def test_a_background_run_that_cannot_start_is_reported(json_option: str, tmp_path: Path) -> None:
    (tmp_path / "results.db").write_text("something else")
    done = shell(f"fraexp run {' '.join(FEW)} --detach {json_option}", tmp_path)
    assert done.returncode == ExitCode.STORE
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"fraexp: the run could not be started: {tmp_path}/results.db: this is not a database")
    assert not json_option or json.loads(done.stdout)["error"]["exit_code"] == ExitCode.STORE


def test_a_clock_that_is_set_back_does_not_shorten_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([datetime(2026, 1, 2, tzinfo=UTC), datetime(2026, 1, 1, tzinfo=UTC)])
    monkeypatch.setattr(writing, "now", lambda connection: next(times))
    steady = iter([100.0, 142.0])
    monkeypatch.setattr("fraexp.store.store.steady_time", lambda: next(steady))
    with Store.open(str(tmp_path / "results.db"), create=True) as store:
        number = store.begin_run("s", "s.toml", "fraexp run s", {}, [])
        store.end_run(number, "complete")
        run = store.run(number)
    assert run.ended is not None
    assert run.ended - run.started == timedelta(seconds=42)


def overwrite(target: Path, source: Path) -> None:
    """Copy a file over another one, which stays the same file, as cp does."""
    with source.open("rb") as reading, target.open("wb") as writing_:
        writing_.write(reading.read())


def test_a_database_that_is_overwritten_while_a_run_uses_it_is_noticed(tmp_path: Path) -> None:
    path, other = tmp_path / "results.db", tmp_path / "other.db"
    fill(other)
    with closing(sqlite3.connect(other)) as connection, connection:
        connection.execute("UPDATE run SET pid = pid + 1")
    with Store.open(str(path), create=True) as store:
        number = store.begin_run("s", "s.toml", "fraexp run s", {}, [])
        store.confirm_run(number, 0)
        with refused(StoreError, "results"):
            store.confirm_run(number, 1)
    overwrite(path, other)
    with Store.open(str(path), read_only=True) as store, refused(StoreError, "overwritten", "run 1"):
        store.confirm_run(number, 0)


def interrupt(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def test_no_half_written_figure_stays_after_an_interruption(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figure = drawing.draw_figure([ShownResult("conventional", Result(Outcome.OK, (), response_of(0.1)))])
    monkeypatch.setattr(figure, "savefig", interrupt)
    with pytest.raises(KeyboardInterrupt):
        drawing.save_figure(figure, tmp_path / "figure.png", ["k"])
    assert list(tmp_path.iterdir()) == []


def test_a_figure_makes_no_folder(workspace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "nowhere" / "figure.png"
    assert main(["plot", "1", "-o", str(target), "--workspace", str(workspace)]) == ExitCode.USAGE
    assert "there is no folder" in capsys.readouterr().err
    assert not target.parent.exists()


def test_a_running_run_is_deleted_after_a_command_that_exists(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Store.open(str(tmp_path / "results.db"), create=True) as store:
        store.begin_run("s", "s.toml", "fraexp run s", {}, [])
    assert main(["delete", "1", "--yes", "--workspace", str(tmp_path)]) == ExitCode.STORE
    assert "'fraexp stop 1'" in capsys.readouterr().err


@pytest.mark.parametrize("url", ["/nonexistent/results.db", "postgresql://me@127.0.0.1:1/db"])
def test_doctor_on_a_database_that_cannot_be_opened_fails(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--db", url]) == ExitCode.INCOMPLETE
