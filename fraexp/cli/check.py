"""``fraexp check``: another process checks a plugin's components; here are its messages and their output."""

import json
import signal
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_line, say
from fraexp.errors import FraexpError, PluginError
from fraexp.kernels.watchdog import dumped_location
from fraexp.views.words import plural

VERDICT_WORDS = {"passed": "pass", "skipped": "skip", "expected": "expected", "not_run": "not run"}
"""First column of the report, by verdict; any other verdict is FAIL."""
VERDICT_WIDTH, NAME_WIDTH = 8, 15
"""Widths of the first two columns of the report."""
INDENT = " " * (VERDICT_WIDTH + NAME_WIDTH + 5)
Finding = dict[str, Any]


@dataclass(frozen=True)
class CheckStarted:
    """A component that is being checked, with the findings so far."""

    component: dict[str, Any]
    place: str
    """File and line of the component."""
    checks: dict[str, str]
    """Names and meanings of the checks."""
    left_out: list[str]
    """Names of the checks that a quick check omits."""
    findings: list[Finding] = field(default_factory=list)

    @property
    def title(self) -> str:
        """Kind and name."""
        return f"{self.component['kind']} {self.component['name']}"

    @property
    def wrong(self) -> list[Finding]:
        """The findings that need a correction."""
        return [found for found in self.findings if is_wrong(found)]


def is_wrong(found: Finding) -> bool:
    """Return whether a finding needs a correction."""
    return found["verdict"] in ("failed", "unexpected")


class CheckOutput:
    """A line for each check, as soon as it is known."""

    def begin(self, started: CheckStarted) -> None:
        """Print how many checks follow."""
        print_line(f"{started.title}: {plural(len(started.checks), 'check')}")

    def finding(self, started: CheckStarted, found: Finding) -> None:
        """Print a finding; a reason that was printed before is replaced by the name of that check."""
        head = VERDICT_WORDS.get(found["verdict"], "FAIL")
        print_line(f"  {head:<{VERDICT_WIDTH}}  {found['name']:<{NAME_WIDTH}} {found['meaning']}", INDENT)
        what = "passes although it is declared to fail; " if found["verdict"] == "unexpected" else ""
        same = [earlier for earlier in started.wrong if earlier["reason"] == found["reason"] and earlier is not found]
        if is_wrong(found) and same:
            print_line(f"{INDENT}{what}for the same reason as {same[0]['name']}", INDENT)
            return
        if found["reason"] and found["verdict"] != "not_run":
            print_line(f"{INDENT}{what}{found['reason']}", INDENT)
        if found["example"] and is_wrong(found):
            print_line(f"{INDENT}with {found['example']}", INDENT)

    def end(self, started: CheckStarted) -> None:
        """Print a summary in one line."""
        print()
        say(self._summary(started))

    def _summary(self, started: CheckStarted) -> str:
        last = next((found for found in started.wrong if found["ends"]), None)
        if last:
            return f"{started.title}: {last['reason']}"
        if started.wrong:
            first, names = started.wrong[0], ", ".join(found["name"] for found in started.wrong)
            found = f"{plural(len(started.wrong), 'check')} failed: {names}"
            return f"{started.title} ({started.place}): {found}; {first['name']}: {first['reason']}"
        return self._sound_text(started)

    def _sound_text(self, started: CheckStarted) -> str:
        return f"{started.title} is sound"


class QuickOutput(CheckOutput):
    """Failures as soon as they are known, then the names of the other checks and of the omitted ones."""

    def begin(self, started: CheckStarted) -> None:
        """Print how many checks follow."""
        of = f" of {len(started.checks) + len(started.left_out)}" if started.left_out else ""
        print_line(f"{started.title}: {len(started.checks)}{of} checks (quick)")

    def finding(self, started: CheckStarted, found: Finding) -> None:
        """Print a failure."""
        if is_wrong(found):
            super().finding(started, found)

    def end(self, started: CheckStarted) -> None:
        """Print which checks have passed, and which were not made."""
        for verdict, head in VERDICT_WORDS.items():
            self._names(head, [found["name"] for found in started.findings if found["verdict"] == verdict])
        self._names("omitted", started.left_out)
        super().end(started)

    def _names(self, head: str, names: list[str]) -> None:
        if names:
            print_line(f"  {head:<{VERDICT_WIDTH}}  {', '.join(names)}", INDENT)

    def _sound_text(self, started: CheckStarted) -> str:
        more = f"fraexp check {started.component['name']} tests more examples"
        rest = f" and {', '.join(started.left_out)}" if started.left_out else ""
        return f"{started.title}: no fault found by the quick checks; {more}{rest}"


class SilentOutput(CheckOutput):
    """Prints nothing, where one document follows at the end."""

    def begin(self, started: CheckStarted) -> None:
        """Print nothing."""

    def finding(self, started: CheckStarted, found: Finding) -> None:
        """Print nothing."""

    def end(self, started: CheckStarted) -> None:
        """Print nothing."""


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


def execute(arguments: Namespace) -> ExitCode:
    """Let another process check, print each finding, and return whether all components are sound."""
    output = SilentOutput() if arguments.json else QuickOutput() if arguments.quick else CheckOutput()
    reports = list(_component_reports(check_messages(arguments), output))
    if arguments.json:
        print_json(reports)
    return ExitCode.OK if all(report["sound"] for report in reports) else ExitCode.INCOMPLETE


def _component_reports(lines: Iterable[dict[str, Any]], output: CheckOutput) -> Iterator[dict[str, Any]]:
    """Yield the report of each component as soon as it is complete."""
    started: CheckStarted | None = None
    for line in lines:
        if "error" in line:
            if started:
                yield _finish_report(started, output)
            raise PluginError(line["error"])
        if "finding" in line and started:
            started.findings.append(line["finding"])
            output.finding(started, line["finding"])
            continue
        if started:
            yield _finish_report(started, output)
        started = None
        if "component" in line:
            started = CheckStarted(line["component"], line["place"], line["checks"], line["left_out"])
        if started:
            output.begin(started)


def _finish_report(started: CheckStarted, output: CheckOutput) -> dict[str, object]:
    made = {found["name"] for found in started.findings}
    for name in [name for name in started.checks if name not in made]:  # the process ended before
        why = started.findings[-1]["ends"] if started.findings else ""
        missing = {"name": name, "meaning": started.checks[name], "verdict": "not_run", "reason": why}
        started.findings.append({**missing, "example": "", "ends": ""})
        output.finding(started, started.findings[-1])
    output.end(started)
    checks = [{key: value for key, value in found.items() if key != "ends"} for found in started.findings]
    return {**started.component, "sound": not started.wrong, "checks": checks, "left_out": started.left_out}
