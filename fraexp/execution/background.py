"""Runs in the background: separate processes that write to a log file instead of a terminal."""

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from fraexp.errors import BeginError, StudyError

LOG_VARIABLE = "FRAEXP_LOG"
"""Environment variable with the path of a run's log file, which is stored in the run's provenance."""
BEGIN_VARIABLE = "FRAEXP_BEGIN"
"""Environment variable with the descriptor of a pipe into which the process writes the number of its first run."""
MAX_BEGIN_S = 60.0
"""Time that a process has to begin its run before it is left alone [s]: large studies take long to resolve."""

_processes: "list[subprocess.Popen[bytes]]" = []
"""Processes that may still run: nobody waits for them, and Python warns if one is garbage-collected."""


@dataclass(frozen=True)
class BackgroundRun:
    """A background process that has been started."""

    process: "subprocess.Popen[bytes]"
    log: Path
    arguments: tuple[str, ...] = ()
    """Command line without ``fraexp``."""
    begin: IO[str] | None = None
    """Pipe with the number of its first run, once that has begun."""

    @property
    def pid(self) -> int:
        """Process number."""
        return self.process.pid

    def has_ended(self) -> bool:
        """Return whether the process has ended; this also removes an ended process from the system's table."""
        return self.process.poll() is not None

    def await_begin(self, timeout: float = MAX_BEGIN_S) -> int | None:
        """Wait for the first run to begin, and return its number; None if it takes longer.

        BeginError if the process has ended without a run.
        """
        if self.begin is None:
            return None
        with self.begin:
            if not select.select([self.begin], [], [], timeout)[0]:
                return None
            number = self.begin.readline().strip()
        if number:
            return int(number)
        code = self.process.wait()
        lines = self.log.read_text(encoding="utf-8", errors="replace").split("\n")
        said = next((line.strip() for line in reversed(lines) if line.strip()), f"it ended with code {code}")
        raise BeginError(f"the run could not be started: {said.removeprefix('fraexp: ')}; its log is {self.log}", code)


def announce_begin(number: int) -> None:
    """Write the number of the first run to the process that has started this one, if that waits for it."""
    pipe = os.environ.pop(BEGIN_VARIABLE, "")
    if pipe:
        with suppress(OSError, ValueError), os.fdopen(int(pipe), "w", encoding="ascii") as stream:
            stream.write(f"{number}\n")


def start(
    arguments: Sequence[str], folder: Path, environment: Mapping[str, str], *, is_awaited: bool = False
) -> BackgroundRun:
    """Start ``fraexp ARGUMENTS`` in a session of its own, with its log file in ``folder/.fraexp/logs``.

    `environment` has more variables for it, such as the database, whose URL may contain a password. If `is_awaited`,
    the caller waits for its run to begin.
    """
    log = folder.absolute() / ".fraexp" / "logs" / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.urandom(2).hex()}.log"
    pipe = os.pipe() if is_awaited and os.name == "posix" else ()
    variables = {LOG_VARIABLE: str(log)} | ({BEGIN_VARIABLE: str(pipe[1])} if pipe else {})
    begin = os.fdopen(pipe[0], encoding="ascii") if pipe else None
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("xb") as stream:
            process = subprocess.Popen(
                [sys.executable, "-m", "fraexp", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={**os.environ, **environment, **variables},
                start_new_session=True,
                pass_fds=pipe[1:],
            )
    except OSError as error:
        if begin:
            begin.close()
        raise StudyError(f"{log}: the run cannot be started ({error.strerror}); choose a folder of yours") from None
    finally:
        for sender in pipe[1:]:
            os.close(sender)
    _processes[:] = [process, *(one for one in _processes if one.poll() is None)]
    return BackgroundRun(process, log, tuple(arguments), begin)


def stop(pid: int, hard: bool = False) -> None:
    """Ask a run's process to end, which stores what is finished; if `hard`, kill it with its workers."""
    try:
        if not hard or os.getpgid(pid) != pid:  # the group belongs to a shell, and so do its other processes
            os.kill(pid, signal.SIGKILL if hard else signal.SIGTERM)
        else:
            os.killpg(pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    except PermissionError:
        raise StudyError(f"process {pid} belongs to somebody else; ask them to stop it") from None
