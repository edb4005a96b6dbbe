"""The clocks of a database and its clients, and whether the process that executes a run is still alive."""

import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path

from sqlalchemy import Connection, func, select

HEARTBEAT_TIMEOUT = timedelta(minutes=2)
"""Time without a heartbeat after which a process on another host counts as dead."""


@dataclass(frozen=True)
class Process:
    """A process, identified such that no later process is mistaken for it."""

    host: str
    boot: str
    """Identifier of the system's boot; empty where the system has none."""
    pid: int
    process_start: int | None
    """Start of the process in clock ticks since the boot; None where the system does not report it."""


def this_process() -> Process:
    """Return the calling process."""
    pid = os.getpid()
    stat = _read_stat(pid)
    return Process(platform.node(), _boot_id(), pid, stat.start if stat else None)


def is_alive(process: Process, silence: timedelta) -> bool:
    """Return whether a process is running; `silence` is the time since its last heartbeat."""
    if process.host != platform.node():
        return abs(silence) < HEARTBEAT_TIMEOUT  # negative if a clock was set back
    if process.boot != _boot_id():
        return False
    if _read_stat(os.getpid()) is None:  # the system has no /proc
        import psutil

        return psutil.pid_exists(process.pid)
    stat = _read_stat(process.pid)
    return stat is not None and stat.state not in "ZX" and process.process_start in (None, stat.start)


def _utc_now() -> datetime:
    """Return the time by the clock of this computer."""
    return datetime.now(UTC)


@dataclass(frozen=True)
class Host:
    """The computer on which the caller of the store runs: its clock and its processes."""

    clock: Callable[[], datetime] = _utc_now
    this_process: Callable[[], Process] = this_process
    is_alive: Callable[[Process, timedelta], bool] = is_alive


HOST = "fraexp_host"
"""Execution option of an engine whose host is simulated."""
_REAL_HOST = Host()


def host_of(connection: Connection) -> Host:
    """Return the host of a connection: this computer, unless it is simulated."""
    host: Host = connection.get_execution_options().get(HOST, _REAL_HOST)
    return host


def now(connection: Connection) -> datetime:
    """Return the current time in UTC: of a server by its own clock, because those of its clients may differ."""
    if connection.dialect.name == "sqlite":
        return host_of(connection).clock().astimezone(UTC)
    moment: datetime = connection.execute(select(func.clock_timestamp())).scalar_one()
    return moment.astimezone(UTC)


def steady_time() -> float:
    """Return the time of a clock that nobody can set [s]; it also runs while the computer sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()


@cache
def _boot_id() -> str:
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


@dataclass(frozen=True)
class _Stat:
    """What Linux reports about a process."""

    state: str
    """One letter: Z is a zombie, X is dead."""
    start: int
    """Start in clock ticks since the boot."""


def _read_stat(pid: int) -> _Stat | None:
    """Return the state of a process from /proc; None if there is no such process, or no /proc.

    psutil reports the start of a process as a time of day only: it shifts when the clock is set, ticks do not.
    """
    try:
        text = Path(f"/proc/{pid}/stat").read_text(errors="replace")
    except OSError:
        return None
    fields = text.rpartition(")")[2].split()  # the name of the program before it may contain blanks and brackets
    return _Stat(fields[0], int(fields[19]))
