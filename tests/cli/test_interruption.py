"""Stopping a run from outside: it ends soon, tells the truth, and leaves no process behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.store import Store

SLOW = {"lowest": 1e-3, "points": 3, "tolerance": 1e-15, "settle_limit": 10_000}
LONG = ["run", "quick", *(f"--set=excitation.{name}={value}" for name, value in SLOW.items())]


@pytest.fixture(scope="module", autouse=True)
def compiled(tmp_path_factory):
    """Have the law compiled: the compiler listens to nobody for some seconds, once on a machine."""
    command = [sys.executable, "-m", "fraexp", "run", "quick", "--set=excitation.points=2"]
    subprocess.run(command, cwd=tmp_path_factory.mktemp("compiled"), capture_output=True, check=True)


def started(folder: Path, *more: str) -> subprocess.Popen[str]:
    """Return a run that has begun to compute something long."""
    command = [sys.executable, "-m", "fraexp", *LONG, *more]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has what runs in the background ignore Ctrl-C
    process = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stderr is not None
    for line in process.stderr:
        if "at once" in line:
            break
    time.sleep(2.0)  # into the computation
    return process


def group_ends(group: int) -> bool:
    """Say whether all processes of a group are gone within ten seconds."""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


@pytest.mark.parametrize("executor", ["processes", "serial"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_run_that_is_asked_to_end_does_so_at_once(executor, number, tmp_path):
    process = started(tmp_path, "--executor", executor)
    began = time.monotonic()
    process.send_signal(number)
    _, told = process.communicate(timeout=20)
    assert time.monotonic() - began < 5
    assert process.returncode == ExitCode.INTERRUPTED
    assert "interrupted" in told
    assert "Traceback" not in told
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        assert store.run(1).state == "interrupted"
    assert group_ends(process.pid)


def test_workers_end_with_a_scheduler_that_is_killed(tmp_path):
    process = started(tmp_path, "--executor", "processes")
    process.kill()
    process.communicate()
    assert group_ends(process.pid)
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        assert store.run(1).state == "interrupted"
