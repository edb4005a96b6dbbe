"""The client of the process that checks: its messages, line by line, and a finding if it crashes or hangs."""

import json
import signal
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from typing import Any

from fraexp.errors import FraexpError
from fraexp.kernels.watchdog import dumped_location


def check_messages(arguments: Namespace) -> Iterator[dict[str, Any]]:
    """Yield the messages of the process; after a crash, a finding for the check in progress."""
    with tempfile.TemporaryDirectory() as folder:
        order = {"name": arguments.name, "kind": arguments.kind, "workspace": str(arguments.workspace)}
        order |= {"quick": arguments.quick, "folder": folder}
        command = [sys.executable, "-m", "fraexp.testing.check_process", json.dumps(order)]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, encoding="utf-8", errors="replace"
        ) as process:
            try:
                yield from _Lines(process).read()
            finally:
                process.kill()


class _Lines:
    """The lines that the process writes, and the check that was in progress when they ended."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self._started: dict[str, Any] | None = None
        self._found = 0
        self._over = False
        self._dump: list[str] = []

    def read(self) -> Iterator[dict[str, Any]]:
        """Yield all lines, and a finding if the process did not finish."""
        for text in self._process.stdout or ():
            if not text.startswith("{"):
                self._dump.append(text)
                continue
            line = json.loads(text)
            self._note(line)
            yield line
        if not self._over:
            yield self._bad_end(self._process.wait())
            yield {"end": True}

    def _note(self, line: dict[str, Any]) -> None:
        if "component" in line:
            self._started, self._found = line, 0
        self._found += "finding" in line
        self._over = self._over or "end" in line or "error" in line

    def _bad_end(self, code: int) -> dict[str, Any]:
        """Return a failure of the check in progress; FraexpError if no check had begun."""
        started = self._started
        if started is None:
            raise FraexpError(
                f"the check process ended with {_exit_text(code)} before the first check; see its output above"
            )
        kind, name = started["component"]["kind"], started["component"]["name"]
        what = f"the law of {name}" if kind == "friction" else f"{kind} {name}"
        place = dumped_location(self._dump, started["place"].partition(",")[0]) or started["place"]
        did = "did not return within the time limit" if self._dump else f"ended its process with {_exit_text(code)}"
        reason = f"{what} ({place}) {did}; expected a force; check the functions that it calls"
        checks = list(started["checks"].items())
        at, meaning = checks[min(self._found, len(checks) - 1)]
        found = {"name": at, "meaning": meaning, "verdict": "failed", "reason": reason, "example": "", "ends": reason}
        return {"finding": found}


def _exit_text(code: int) -> str:
    """Return the exit code or the signal that ended a process."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {-code} ({signal.Signals(-code).name})"
    except ValueError:
        return f"signal {-code}"
