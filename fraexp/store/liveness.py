"""Whether the process that wrote a run still lives."""

import os
import platform
import sys
from dataclasses import dataclass
from datetime import timedelta
from functools import cache
from pathlib import Path

SILENCE = timedelta(minutes=2)
"""A run that cannot be asked (another host) counts as dead after this time without a heartbeat."""


@dataclass(frozen=True)
class Process:
    """A process, such that no later one is mistaken for it."""

    host: str
    boot: str
    """Identity of the boot; empty where the system tells none."""
    pid: int
    process_start: int | None
    """Start in clock ticks since boot; None where the system does not tell."""


def this_process() -> Process:
    """Return the calling process."""
    pid = os.getpid()
    stat = _stat(pid)
    return Process(platform.node(), _boot(), pid, stat[1] if stat else None)


def alive(process: Process, silence: timedelta) -> bool:
    """Return whether a process still runs; `silence` is the time since its last heartbeat."""
    if process.host != platform.node() or sys.platform == "win32":
        return silence < SILENCE  # Windows has no signal that only asks
    if process.boot != _boot():
        return False
    if _stat(os.getpid()) is None:  # no /proc on this system
        return _answers(process.pid)
    stat = _stat(process.pid)
    return stat is not None and stat[0] not in "ZX" and process.process_start in (None, stat[1])


@cache
def _boot() -> str:
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def _stat(pid: int) -> tuple[str, int] | None:
    """Return state letter and start time of a process from /proc."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(errors="replace")
    except OSError:
        return None
    fields = text.rpartition(")")[2].split()  # the name before it may hold anything
    return fields[0], int(fields[19])


def _answers(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True  # it lives, and is somebody else's
    except OSError:
        return False
    return True
