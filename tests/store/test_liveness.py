"""Whether a process is alive: this one, and on systems without /proc; runs of dead ones are in test_runs.py."""

import subprocess
import sys
from dataclasses import replace
from datetime import timedelta

import pytest

from fraexp.store import liveness
from fraexp.store.liveness import is_alive, this_process

NOW = timedelta(0)


def ended_process() -> int:
    """Return the number of a process that has just ended."""
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    return process.pid


def test_this_process_is_alive_however_long_it_has_been_silent() -> None:
    assert is_alive(this_process(), timedelta(days=1))


def test_without_proc_the_system_says_whether_a_process_exists(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(liveness, "_read_stat", lambda pid: None)
    here = this_process()
    assert here.process_start is None
    assert is_alive(here, NOW)
    assert not is_alive(replace(here, pid=ended_process()), NOW)
