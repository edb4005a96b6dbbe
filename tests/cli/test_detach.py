"""Runs in the background: they go on without whoever started them, note their log, and can be stopped."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.errors import StoreError
from fraexp.store import Store
from tests.examples import some
from tests.waiting import HANG_TIMEOUT_S, wait_until

SLOW = [
    "quick",
    "--set=excitation.min_frequency=1e-3",
    "--set=excitation.points=3",
    "--set=excitation.settling_tolerance=1e-15",
]
SLOW += ["--set=excitation.settling_timeout=10000", "--executor=processes:1"]


def fraexp(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "fraexp", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=HANG_TIMEOUT_S)


def state(folder: Path) -> str:
    """Return the state of run 1; empty while there is none."""
    try:
        with Store.open(str(folder / "results.db"), read_only=True) as store:
            return next((run.state for run in store.runs()), "")
    except StoreError:  # there is no database yet, or it is being made
        return ""


def test_a_run_in_the_background_comes_to_its_end_and_notes_its_log(tmp_path):
    told = fraexp(tmp_path, "run", "quick", "--detach", "--set", "excitation.points=2", "--json", "--executor=serial")
    assert told.returncode == ExitCode.OK
    started = json.loads(told.stdout)["started"]
    wait_until(lambda: state(tmp_path) == "complete")
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        run = store.run(1)
    assert run.process.pid == started["pid"]
    assert run.provenance["log"] == started["log"]
    assert run.command == "fraexp run quick --set=excitation.points=2"
    assert Path(started["log"]).is_relative_to(tmp_path / ".fraexp" / "logs")
    assert "quick: 4 sweeps, 0 reused, 4 to compute" in Path(started["log"]).read_text(encoding="utf-8")


@pytest.mark.parametrize("hard", some([(), ("--kill",)], ()))
def test_a_run_in_the_background_can_be_stopped(tmp_path, monkeypatch, capsys, hard):
    monkeypatch.chdir(tmp_path)
    started = json.loads(fraexp(tmp_path, "run", *SLOW, "--detach", "--json").stdout)["started"]
    wait_until(lambda: " worker" in Path(started["log"]).read_text(encoding="utf-8"))
    assert state(tmp_path) == "running"
    assert main(["stop", "1", *hard]) == ExitCode.OK
    assert "run 1 is " in capsys.readouterr().err
    wait_until(lambda: state(tmp_path) == "interrupted")
    wait_until(lambda: not _lives(started["pid"]))
    assert main(["stop", "1"]) == ExitCode.USAGE
    how = "process lost" if hard else "stopped"
    assert capsys.readouterr().err == f"fraexp: run 1 is {how}; it cannot be stopped\n"


def _lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_what_does_not_fit_is_told_before_anything_is_started(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "quick", "--set", "excitation.point=2", "--detach"]) == ExitCode.USAGE
    assert "did you mean 'points'?" in capsys.readouterr().err
    assert not (tmp_path / ".fraexp").exists()
