import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.cli.options import COMMANDS, RECORD_OPTIONS
from fraexp.records.record_settings import RecordSettings
from tests.cli.conftest import Command
from tests.waiting import HANG_TIMEOUT_S

HEAVY = {"numpy", "pydantic", "sqlalchemy", "matplotlib", "numba", "scipy", "pint", "pluggy", "rich"}


def test_an_option_of_import_is_a_key_of_a_record() -> None:
    assert {option.key for option in RECORD_OPTIONS} <= set(RecordSettings.model_fields)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("lst", "unknown command 'lst'; did you mean 'list'?"),
        ("show 1 --jsn", "show: unknown option '--jsn'; did you mean '--json'?"),
        ("plot 1 --ouput x.png", "plot: unknown option '--ouput'; did you mean '--output'?"),
        ("--debgu list", "unknown option '--debgu'; did you mean '--debug'?"),
        ("run a.toml --rerun stal", "unknown --rerun 'stal'; did you mean 'stale'?"),
        ("show", "show: the following arguments are required: ID; see fraexp show --help"),
        ("", "no command; choose one of run, stop, list, show"),
        ("list --db", "list: argument --db: expected one argument; see fraexp list --help"),
        ("doctor extra", "unrecognized arguments: extra; see fraexp --help"),
    ],
)
def test_a_wrong_command_line_is_one_line_with_the_nearest_name(
    line: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == ExitCode.USAGE
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"fraexp: {sentence}")
    assert printed.err.count("\n") == 1


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys, json; from fraexp.cli.main import main; code = main(sys.argv[1:]);"
        "print(json.dumps([code, sorted(sys.modules)]), file=sys.stderr)"
    )
    for line in (["run", "--help"], ["lst"]):
        done = subprocess.run([sys.executable, "-c", code, *line], capture_output=True, text=True, check=True)
        loaded = json.loads(done.stderr.splitlines()[-1])[1]
        assert HEAVY & set(loaded) == set(), line


def test_help_documents_every_command_and_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == ExitCode.OK
    text = capsys.readouterr().out
    assert [name for name in COMMANDS if not re.search(rf"^    {name} ", text, re.MULTILINE)] == []
    assert [code for code in ExitCode if not re.search(rf"^  {code.value} +{code.sentence}$", text, re.MULTILINE)] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == ExitCode.OK
    assert COMMANDS[command].summary[1:] in " ".join(capsys.readouterr().out.split())


def test_common_options_may_stand_before_or_after_the_command(
    workspace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for line in (["--workspace", str(workspace), "list"], ["list", "--db", str(workspace / "results.db")]):
        assert main(line) == ExitCode.OK
        assert "bench" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "code", "sentence"),
    [
        (["show", "9"], 3, "there is no run 9; the newest is run 1"),
        (["show", "benhc"], 3, "'fraexp run STUDY' computes a study; did you mean 'bench'?"),
        (["show", "paper/fig12"], 3, "no study of this name has been run; 'fraexp list' shows"),
        (["export", "bench", "-o", "r.csv"], 2, "export: run 1 has 5 sweeps; expected one of them: "),
        (["list", "--db", "elsewhere.db"], 3, "elsewhere.db"),
        (["plot", "1", "-o", "figure.bmp"], 2, "choose one of .png, .svg, .pdf"),
    ],
)
def test_what_is_wrong_is_one_line_and_an_exit_code(
    line: list[str], code: int, sentence: str, workspace: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["--workspace", str(workspace), *line]) == code
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("fraexp: ")
    assert sentence in printed.err
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [], "nothing is written"


def test_debug_shows_the_traceback(workspace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "9", "--workspace", str(workspace), "--debug"]) == ExitCode.STORE
    printed = capsys.readouterr().err
    assert "Traceback (most recent call last)" in printed
    assert printed.splitlines()[-1].startswith("fraexp: there is no run 9")


def test_an_error_of_fraexp_itself_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(COMMANDS, "list", COMMANDS["list"]._replace(target="no_such_module"))
    assert main(["list"]) == ExitCode.INTERNAL
    error = capsys.readouterr().err
    assert error.startswith("fraexp: internal error: ModuleNotFoundError: ")
    assert error.endswith("; run with --debug for the traceback\n")
    assert error.count("\n") == 1


def test_a_reader_that_goes_away_is_no_error(workspace: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "fraexp", "show", "1", "--points", "--json", "--workspace", str(workspace)]
    done = subprocess.run(
        command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False, timeout=HANG_TIMEOUT_S
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (ExitCode.PIPE_CLOSED, "")


@pytest.mark.thorough
def test_a_terminal_without_the_letters_gets_escapes(fraexp: Command, workspace: Path) -> None:
    done = fraexp("plugins", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert "internal error" not in done.stderr


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == ExitCode.OK
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*\n", capsys.readouterr().out)
