"""A measurement as the terminal UI sees it: a process that plays and reports, and all that it has reported so far."""

import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import IO

from fraexp.tui.services.measurement_feed import EndReport, read_report
from fraexp.tui.services.reported_measurement import ReportedMeasurement
from fraexp.workspace.workspace_service import WorkspaceService

WORKER = "fraexp.tui.services.measurement_worker"
"""Module of the measuring process, which imports all that simulates and estimates: the UI must not."""


class LiveMeasurement(ReportedMeasurement):
    """A study that is planned, then measured, in a process whose orders come over a pipe.

    The process stops the machine as soon as the pipe is closed: by `stop`, or because this process has died.
    A thread takes its reports.
    """

    def __init__(self, workspace: WorkspaceService, study: str, overrides: Sequence[str] = ()) -> None:
        super().__init__(study, overrides)
        command = [sys.executable, "-m", WORKER, str(workspace.folder.absolute()), study, *self.overrides]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | workspace.location_environment(),
            start_new_session=True,  # signals of the terminal are for the UI, whose end closes the pipe
        )
        self._thread = threading.Thread(target=self._read, name="measurement", daemon=True)
        self._thread.start()

    def begin(self, fresh: bool = False) -> None:
        """Let it measure; `fresh`, without what an earlier measurement has stored."""
        if self.change_state("planned", "measuring"):
            self.is_fresh = fresh
            self._order("fresh\n" if fresh else "begin\n")

    def stop(self) -> None:
        """Let the excitation fall within its ramp, and end; measured points are kept."""
        self.change_state("measuring", "stopping")
        self._close_pipe(self._process.stdin)

    def kill(self) -> None:
        """Kill the process at once; the machine stops by its own watchdog."""
        self._process.kill()
        self._close_pipe(self._process.stdin)

    def discard(self) -> None:
        """End a measurement that has not begun."""
        if not self.is_moving:
            self.kill()

    def join(self, timeout: float) -> bool:
        """Wait for the end, and return whether it has come."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _order(self, text: str) -> None:
        pipe = self._process.stdin
        assert pipe is not None
        with suppress(OSError):  # its reports say how it has ended
            pipe.write(text.encode())
            pipe.flush()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as stream:
            while (report := read_report(stream)) is not None:
                self.add(report)
        self._close_pipe(self._process.stdin)
        code = self._process.wait()
        if not self.has_ended:
            text = f"the measuring process ended with code {code}; the machine stops by its watchdog"
            self.add(EndReport("process lost", text))

    @staticmethod
    def _close_pipe(pipe: IO[bytes] | None) -> None:
        with suppress(OSError):
            if pipe is not None:
                pipe.close()
