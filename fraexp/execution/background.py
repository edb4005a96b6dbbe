"""Runs that outlive whoever started them: processes of their own, which write to a log instead of a terminal."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fraexp.errors import StudyError

LOG = "FRAEXP_LOG"
"""Environment variable that tells a run where its log is, which it notes beside its provenance."""


_started: "list[subprocess.Popen[bytes]]" = []
"""Processes that may still run: nothing here waits for them, and Python complains of one that is forgotten."""


@dataclass(frozen=True)
class BackgroundRun:
    """A process that has been started and goes its own way."""

    process: "subprocess.Popen[bytes]"
    log: Path
    arguments: tuple[str, ...] = ()
    """Its command line, without ``fraexp``."""

    @property
    def pid(self) -> int:
        """Its process number."""
        return self.process.pid

    def ended(self) -> bool:
        """Return whether it has ended; asking also keeps the system from remembering it."""
        return self.process.poll() is not None


def start(arguments: Sequence[str], folder: Path) -> BackgroundRun:
    """Start ``fraexp ARGUMENTS`` as a process of its own session, with its log in ``folder/.fraexp/logs``."""
    log = folder.absolute() / ".fraexp" / "logs" / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.urandom(2).hex()}.log"
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("xb") as stream:
            process = subprocess.Popen(
                [sys.executable, "-m", "fraexp", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=os.environ | {LOG: str(log)},
                start_new_session=True,
            )
    except OSError as error:
        raise StudyError(f"{log}: the run cannot be started ({error.strerror}); choose a folder of yours") from None
    _started[:] = [process, *(one for one in _started if one.poll() is None)]
    return BackgroundRun(process, log, tuple(arguments))


def stop(pid: int, hard: bool = False) -> None:
    """Ask a run's process to end and keep what is finished; `hard`, end it with its workers at once."""
    try:
        if not hard or os.getpgid(pid) != pid:  # of somebody's shell: its other processes are not ours
            os.kill(pid, signal.SIGKILL if hard else signal.SIGTERM)
        else:
            os.killpg(pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    except PermissionError:
        raise StudyError(f"process {pid} belongs to somebody else; ask them to stop it") from None
