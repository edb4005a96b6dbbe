"""Whether the process of a run is alive: here, after a restart, on another host, and on systems without /proc."""

import subprocess
import sys
from dataclasses import replace
from datetime import timedelta

import pytest

from fraexp.store import liveness
from fraexp.store.liveness import HEARTBEAT_TIMEOUT, is_alive, this_process

NOW = timedelta(0)


def ended_process() -> int:
    """Return the number of a process that has just ended."""
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    return process.pid


def test_this_process_is_alive_however_long_it_has_been_silent() -> None:
    assert is_alive(this_process(), timedelta(days=1))


def test_an_ended_process_and_one_of_an_earlier_boot_are_not_alive() -> None:
    assert not is_alive(replace(this_process(), pid=ended_process()), NOW)
    assert not is_alive(replace(this_process(), boot="another"), NOW)


@pytest.mark.skipif(sys.platform != "linux", reason="needs the start of processes in /proc")
def test_a_later_process_of_the_same_number_is_another_one() -> None:
    assert not is_alive(replace(this_process(), process_start=1), NOW)


def test_a_process_on_another_host_is_alive_as_long_as_it_sends_heartbeats() -> None:
    elsewhere = replace(this_process(), host="elsewhere")
    assert is_alive(elsewhere, HEARTBEAT_TIMEOUT / 2)
    assert not is_alive(elsewhere, HEARTBEAT_TIMEOUT)


def test_without_proc_the_system_says_whether_a_process_exists(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(liveness, "_read_stat", lambda pid: None)
    here = this_process()
    assert here.process_start is None
    assert is_alive(here, NOW)
    assert not is_alive(replace(here, pid=ended_process()), NOW)
