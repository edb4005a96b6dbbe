import json
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main

STUDY = """
title = "Two methods"
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
amplitude = 12
frequencies = [20, 40, 80]
settle_limit = 2
[estimator]
name = "conventional"
[grid]
"estimator.name" = ["conventional", "proposed"]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies/methods.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_run_prints_its_table_and_figure_and_is_reused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "methods", "--executor", "serial"]) == ExitCode.OK
    first = capsys.readouterr()
    assert "run 1 complete: 2 sweeps, 2 computed, 0 reused, 0 failed" in first.out
    assert "conventional  ok " in first.out
    assert "proposed      ok " in first.out
    figure = folder / "figures/methods.png"
    assert first.out.endswith("figure figures/methods.png\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    drawn = figure.stat().st_mtime_ns

    assert main(["run", "methods", "--json"]) == ExitCode.OK
    document = json.loads(capsys.readouterr().out)
    (run,) = document["runs"]
    assert (run["number"], run["reused"], run["figures"]) == (2, 2, ["figures/methods.png"])
    assert figure.stat().st_mtime_ns == drawn


def test_a_dry_run_tells_and_writes_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "methods", "--dry-run"]) == ExitCode.OK
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("methods: 2 sweeps, 0 reused, 2 to compute, about ")
    assert [path.name for path in folder.iterdir()] == ["studies"]


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (["run", "method"], "there is no study 'method'; did you mean 'methods'?"),
        (
            ["run", "methods", "--set", "excitation.amplitud=3"],
            "has no parameter 'amplitud'; did you mean 'amplitude'?",
        ),
        (["run", "methods", "--set", "excitation.amplitude=-3"], "must be above 0 N"),
        (["run", "methods", "--set", "nonsense"], "--set nonsense: expected PATH=VALUE"),
        (["run", "methods", "--executor", "thread"], "thread"),
        (["run", "methods", "--workspace", "nowhere"], "nowhere: there is no such folder"),
        (["import", "a.csv", "--channel", "force"], "--channel force: expected NAME=COLUMN"),
    ],
)
def test_what_a_study_gets_wrong_is_one_line_and_nothing_is_written(
    line: list[str], sentence: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line) == ExitCode.USAGE
    printed = capsys.readouterr().err
    assert sentence in printed
    assert printed.count("\n") == 1
    assert [path.name for path in folder.iterdir()] == ["studies"]


def test_a_figure_that_cannot_be_written_is_a_note_and_the_table_is_there(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "figures").touch()
    assert main(["run", "methods", "--executor", "serial"]) == ExitCode.OK
    printed = capsys.readouterr()
    assert "run 1 complete: 2 sweeps, 2 computed" in printed.out
    assert "conventional  ok " in printed.out
    notes = [line for line in printed.err.splitlines() if "figure" in line]
    assert notes == [notes[0]]
    assert notes[0].startswith("run 1 has no figure: figures/methods.png: the figure cannot be written: ")


def test_several_studies_head_their_tables_and_a_rerun_is_told_to_the_old_run(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "studies/other.toml").write_text(STUDY.replace("Two methods", "Another title").replace("12", "75"))
    assert main(["run", "methods", "other", "--executor", "serial"]) == ExitCode.OK
    printed = capsys.readouterr()
    assert printed.out.startswith("methods: Two methods\nmagnitudes in dB")
    assert "\n\nother: Another title\nmagnitudes in dB" in printed.out

    assert main(["run", "methods", "--executor", "serial", "--rerun", "all"]) == ExitCode.OK
    assert not capsys.readouterr().out.startswith("methods")
    assert main(["show", "1"]) == ExitCode.OK
    assert "2 of 2 sweeps have been computed again since" in capsys.readouterr().err
    assert main(["show", "3"]) == ExitCode.OK
    assert "again" not in capsys.readouterr().err
