import json
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.errors import UnreachedError
from fraexp.execution.executors.serial import Serial
from fraexp.store import Store
from tests.store.conftest import reseal

STUDY = """
title = "Two methods"
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
amplitude = 12
frequencies = [20, 40, 80]
settling_timeout = 2
[estimator]
name = "conventional"
[grid]
"estimator.name" = ["conventional", "effective_input"]
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
    assert "conventional     ok " in first.out
    assert "effective_input  ok " in first.out
    figure = folder / "figures/methods.png"
    assert first.out.endswith("figure figures/methods.png\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    drawn = figure.stat().st_mtime_ns

    assert main(["run", "methods", "--json"]) == ExitCode.OK
    document = json.loads(capsys.readouterr().out)
    (run,) = document["runs"]
    assert (run["number"], run["reused"], run["figures"]) == (2, 2, ["figures/methods.png"])
    assert figure.stat().st_mtime_ns == drawn


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--executor=dask:tcp://127.0.0.1:1"], "no Dask scheduler answers at tcp://127.0.0.1:1"),
        (["--executor=dask:tcp://127.0.0.1:1", "--memory-limit=2GB"], "capped where they are started"),
        (["--executor=serial", "--memory-limit=2GB"], "cannot cap memory"),
    ],
)
def test_an_executor_that_cannot_be_had_leaves_no_run(
    options: list[str], said: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    dask = pytest.importorskip(
        "fraexp.execution.executors.dask", reason="Dask is not installed: pip install distributed"
    )
    pytest.importorskip("distributed", reason="Dask is not installed: pip install distributed")
    monkeypatch.setattr(dask, "CONNECT_TIMEOUT_S", 0.1)
    assert main(["run", "methods", *options]) == ExitCode.USAGE
    assert said in capsys.readouterr().err.splitlines()[-1]
    main(["list", "--json"])
    assert json.loads(capsys.readouterr().out).get("runs", []) == []


def test_workers_that_are_gone_for_good_are_sweeps_that_were_not_reached(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(_: Serial) -> Iterator[tuple[int, float]]:
        raise UnreachedError("the scheduler was gone for 120 s; what is computed is stored")

    monkeypatch.setattr(Serial, "reports", gone)
    assert main(["run", "methods", "--executor", "serial"]) == ExitCode.INCOMPLETE
    assert capsys.readouterr().err.endswith("fraexp: the scheduler was gone for 120 s; what is computed is stored\n")
    with Store.open("results.db", read_only=True) as store:
        assert store.run(1).state == "partial"


def test_a_dry_run_tells_and_writes_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "methods", "--dry-run"]) == ExitCode.OK
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("methods: 2 sweeps, 0 reused, 2 to compute, time unknown\n")
    assert [path.name for path in folder.iterdir()] == ["studies"]


def test_a_dry_run_says_why_and_names_what_differs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def told(*options: str) -> list[str]:
        capsys.readouterr()
        assert main(["run", "methods", "--dry-run", *options]) == ExitCode.OK
        return capsys.readouterr().err.splitlines()[1:]

    assert told() == ["  2 new: no run of this study is stored"]
    assert main(["run", "methods", "--executor", "serial"]) == ExitCode.OK
    assert told() == ["  2 reused: stored, computed by the same sources"]
    assert told("--rerun", "all") == ["  2 computed again: stored, computed by the same sources"]
    assert told("--set", "grid.excitation.amplitude=[12, 30, 50]") == [
        "  2 reused: stored, computed by the same sources",
        "  4 new: excitation.amplitude = 30, 50 N, stored 12 N (in run 1)",
    ]
    (line,) = told(
        "--set",
        "plant.rigid_body_gain=0.2",
        "--set",
        "estimator.name=effective_input",
        "--set",
        "estimator.force_scale=2",
    )
    assert "plant.rigid_body_gain = 0.2 m/(N s²), stored 0.132 m/(N s²)" in line
    assert "estimator.force_scale = 2, stored 1" in line

    with sqlite3.connect("results.db") as connection:
        connection.execute("UPDATE supplied_component SET source_hash = 'c0ffee00' WHERE name = 'effective_input'")
        connection.execute("UPDATE sweep SET outcome = 'DIVERGED' WHERE estimator_name = 'conventional'")
    reseal("results.db")
    stale, failed = sorted(told(), key=len, reverse=True)
    assert stale.startswith("  1 reused, stale: the source has changed since of estimator effective_input (version ")
    assert stale.endswith(", stored c0ffee00); --rerun stale computes them again")
    assert failed.startswith("  1 reused, unusable: stored, but without a result of use: ")
    assert failed.endswith(" diverged; --rerun unusable computes them again")
    assert any(line.startswith("  1 computed again, stale: ") for line in told("--rerun", "stale"))
    assert any(line.startswith("  1 to be tried again: ") for line in told("--rerun", "unusable"))

    assert main(["run", "methods", "--dry-run", "--json", "--set", "excitation.amplitude=30"]) == ExitCode.OK
    (planned,) = json.loads(capsys.readouterr().out)["planned"]
    (why,) = planned["why"]
    assert (why["computed"], why["state"], why["count"], len(why["sweeps"])) == (True, "new", 2, 2)
    assert why["sweeps"][0]["labels"] == {"estimator.name": "conventional"}
    assert why["sweeps"][0]["why"] == "excitation.amplitude = 30 N, stored 12 N"


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
    assert "conventional     ok " in printed.out
    notes = [line for line in printed.err.splitlines() if "figure" in line]
    assert notes == [notes[0]]
    assert notes[0].startswith("run 1: no figure was drawn: figures/methods.png: cannot be written: ")


@pytest.mark.thorough
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
    assert "2 of 2 sweeps have been recomputed since" in capsys.readouterr().err
    assert main(["show", "3"]) == ExitCode.OK
    assert "again" not in capsys.readouterr().err
