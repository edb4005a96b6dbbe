"""Stopping a run from outside: it ends soon, tells the truth, and leaves no process behind."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.store import Store
from tests.examples import thorough
from tests.waiting import HANG_TIMEOUT_S, wait_until

SLOW = {"min_frequency": 1e-3, "points": 3, "settling_tolerance": 1e-15, "settling_timeout": 10_000}
LONG = ["run", "quick", *(f"--set=excitation.{name}={value}" for name, value in SLOW.items())]

OTHER_SIGNALS = [("processes", signal.SIGTERM), ("serial", signal.SIGHUP)]


@pytest.fixture(scope="module", autouse=True)
def compiled(tmp_path_factory):
    """Have the law compiled: the compiler listens to nobody for some seconds, once on a machine."""
    place = f"--workspace={tmp_path_factory.mktemp('compiled')}"
    assert main(["run", "quick", "--set=excitation.points=2", "--executor=serial", place]) == ExitCode.OK


def started(folder: Path, *more: str) -> subprocess.Popen[str]:
    """Return a run that has begun to compute something long."""
    command = [sys.executable, "-m", "fraexp", *LONG, *more]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has what runs in the background ignore Ctrl-C
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # and nohup the end of its terminal
    process = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stderr is not None
    for line in process.stderr:
        if " worker" in line:
            break
    wait_until(lambda: has_begun(folder))
    return process


def has_begun(folder: Path) -> bool:
    """Say whether run 1 has told how far a sweep is."""
    with Store.open(str(folder / "results.db"), read_only=True) as store:
        told = store.run(1).progress
    return told is not None and any(told.running.values())


def is_gone(group: int) -> bool:
    """Say whether all processes of a group are gone."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.mark.parametrize(
    ("executor", "number"),
    [thorough("processes", signal.SIGINT), ("serial", signal.SIGTERM), *(thorough(*pair) for pair in OTHER_SIGNALS)],
)
def test_a_run_that_is_asked_to_end_does_so_at_once(executor, number, tmp_path):
    process = started(tmp_path, "--executor", executor)
    process.send_signal(number)
    _, told = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.INTERRUPTED
    assert "stopped by you" in told
    assert "Traceback" not in told
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        assert store.run(1).state == "interrupted"
    wait_until(lambda: is_gone(process.pid))


@pytest.mark.thorough
def test_workers_end_with_a_scheduler_that_is_killed(tmp_path):
    process = started(tmp_path, "--executor", "processes")
    process.kill()
    process.communicate()
    wait_until(lambda: is_gone(process.pid))
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        assert store.run(1).state == "interrupted"
