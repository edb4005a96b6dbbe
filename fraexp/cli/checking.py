"""The process that checks, as the command sees it: what it tells, line by line, also where it comes to a bad end."""

import json
import signal
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from typing import Any

from fraexp.errors import FraexpError
from fraexp.kernels.watchdog import place_in_dump


def told(arguments: Namespace) -> Iterator[dict[str, Any]]:
    """Yield what the process tells: of each component, of each finding; at a bad end, the finding that it was at."""
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
    """The lines that the process writes, and what it was at when they ended."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self._started: dict[str, Any] | None = None
        self._found = 0
        self._over = False
        self._dump: list[str] = []

    def read(self) -> Iterator[dict[str, Any]]:
        """Yield all of them, and the finding that a bad end is."""
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
        """Return the finding of the check that the process was at; FraexpError if it was at none."""
        started = self._started
        if started is None:
            raise FraexpError(f"the process that checks ended with {_how(code)} before it began; see above")
        kind, name = started["component"]["kind"], started["component"]["name"]
        what = f"the law of {name}" if kind == "friction" else f"{kind} {name}"
        place = place_in_dump(self._dump, started["place"].partition(",")[0]) or started["place"]
        did = "has not returned, nor let anything else run" if self._dump else f"ended its process with {_how(code)}"
        reason = f"{what} ({place}) {did}; expected a force at once: mend what it calls"
        checks = list(started["checks"].items())
        at, meaning = checks[min(self._found, len(checks) - 1)]
        found = {"name": at, "meaning": meaning, "verdict": "failed", "reason": reason, "example": "", "ends": reason}
        return {"finding": found}


def _how(code: int) -> str:
    """Return how a process ended."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {-code} ({signal.Signals(-code).name})"
    except ValueError:
        return f"signal {-code}"
