"""Many sweeps: quantiles on a terminal, every row elsewhere."""

import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.compare import execute as compare
from fraexp.cli.follow import MAX_REPORTED_FAILURES, MAX_TABLE_SWEEPS, RunEvents, follow, print_outcome
from fraexp.cli.main import parse
from fraexp.cli.show import execute as show
from fraexp.data.findings import remarks
from fraexp.data.results import Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.execution.events import Ended, Event, Finished
from fraexp.store import Store
from fraexp.views.words import short_key
from fraexp.workspace.workspace_service import WorkspaceService
from tests.cli.conftest import response_of

COUNT = 60


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Run 1: two methods with 30 gains each, the last of which has diverged."""
    gains = np.linspace(1, 30, 30).tolist()
    sweeps = [
        Sweep({"source": "record", "gain": gain}, {"name": name}, {"estimator": name, "record.gain": gain})
        for name in ("h1", "h2")
        for gain in gains
    ]
    results = []
    for sweep in sweeps:
        gain = sweep.labels["record.gain"] * (10 if sweep.labels["estimator"] == "h2" else 1)
        results.append(Result(Outcome.OK, (), response_of(1e-3 * gain), (Metric("gain", gain, "m/N"),)))
    results[-1] = Result(Outcome.DIVERGED, remarks("after 0.2 s"))
    with Store.open(str(tmp_path / "results.db"), create=True) as store:
        run = store.begin_run("many", "many.toml", "fraexp run many", {}, sweeps)
        store.save(run, [(sweep, result, {}) for sweep, result in zip(sweeps, results, strict=True)])
        store.end_run(run, "complete")
    return tmp_path


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Let the captured stdout say that it is a terminal."""
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr(type(sys.stdout), "isatty", lambda _: True)


def arguments(command: str, folder: Path, *options: str) -> Namespace:
    return parse([command, "1", "--workspace", str(folder), *options])


def row(text: str, *beginning: str) -> list[str]:
    (found,) = [line.split() for line in text.splitlines() if " ".join(line.split()).startswith(" ".join(beginning))]
    return found[len(" ".join(beginning).split()) :]


@pytest.mark.usefixtures("terminal")
def test_a_terminal_gets_the_range_of_a_grid_by_group(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    show(arguments("show", folder))
    printed = capsys.readouterr()
    assert "outcomes   59 ok, 1 diverged\nestimator  30 h1, 30 h2\n" in printed.out
    assert row(printed.out, "gain", "1") == ["30"], "the label, of all sweeps"
    assert row(printed.out, "gain [m/N] h1") == ["1", "30"], "a grid is no sample"
    assert row(printed.out, "gain [m/N] h2") == ["10", "290", "29"], "without the diverged one"
    assert "1 sweep not ok:" in printed.out
    assert len(printed.out.splitlines()) < 40
    assert "shows all\n1 diverged" in printed.err


def test_what_is_no_terminal_shows_each_sweep(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    show(arguments("show", folder))
    assert capsys.readouterr().out.count(" ok ") == COUNT - 1


@pytest.mark.usefixtures("terminal")
def test_a_run_ends_with_the_summary(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    print_outcome(RunEvents(ended=[Ended(1, "complete")]), arguments("show", folder), WorkspaceService.open(folder))
    printed = capsys.readouterr()
    assert "outcomes   59 ok, 1 diverged" in printed.out
    assert f"fraexp show 1 --workspace {folder} | less shows each sweep" in " ".join(printed.err.split())
    assert "run 1 complete: 60 sweeps" in printed.out


def test_a_run_elsewhere_ends_with_rows(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    print_outcome(RunEvents(ended=[Ended(1, "complete")]), arguments("show", folder), WorkspaceService.open(folder))
    printed = capsys.readouterr()
    assert printed.out.count(" ok ") == MAX_TABLE_SWEEPS
    assert "10 more sweeps; see fraexp show 1" in printed.err


@pytest.mark.usefixtures("terminal")
def test_a_comparison_of_many_has_the_summary_and_the_differences(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    compare(arguments("compare", folder))
    printed = capsys.readouterr()
    assert "estimator  30 h1, 30 h2" in printed.out
    assert "49.2480" in printed.out, "20 lg 290"
    assert "such as | less, shows all" in " ".join(printed.err.split())


def test_many_failures_are_told_by_the_first_ones(capsys: pytest.CaptureFixture[str]) -> None:
    sweep = Sweep({"source": "drive"}, {"name": "hysteresis"}, {})
    events: list[Event] = [Finished(replace(sweep), None, "failed", f"broken {index}") for index in range(500)]
    follow(event for event in events)
    lines = capsys.readouterr().err.splitlines()
    key = short_key(sweep.key)
    assert lines[:MAX_REPORTED_FAILURES] == [f"{key} failed: broken {index}" for index in range(MAX_REPORTED_FAILURES)]
    assert lines[MAX_REPORTED_FAILURES:] == ["further failures are only counted; fraexp show lists all"]


def test_a_reason_of_many_failures_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    sweep = Sweep({"source": "drive"}, {"name": "hysteresis"}, {})
    events: list[Event] = [Finished(replace(sweep), None, "failed", "broken")] * 500
    follow(event for event in [*events, Ended(1, "partial")])
    told = [f"{short_key(sweep.key)} failed: broken", "500 sweeps failed for this reason: broken"]
    assert capsys.readouterr().err.splitlines() == told
