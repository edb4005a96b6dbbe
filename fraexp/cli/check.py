"""``fraexp check``: another process checks a plugin's components; here are its messages and their output."""

import json
import signal
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

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
CheckLine = dict[str, Any]


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
    findings: list[CheckLine] = field(default_factory=list)

    @property
    def title(self) -> str:
        """Kind and name."""
        return f"{self.component['kind']} {self.component['name']}"

    @property
    def wrong(self) -> list[CheckLine]:
        """The findings that need a correction."""
        return [found for found in self.findings if is_wrong(found)]


def is_wrong(found: CheckLine) -> bool:
    """Return whether a finding needs a correction."""
    return found["verdict"] in ("failed", "unexpected")


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
                yield from _read_lines(process)
            finally:
                process.kill()


def _read_lines(process: "subprocess.Popen[str]") -> Iterator[dict[str, Any]]:
    """Yield all lines that the process writes, and a finding if it does not finish."""
    started: dict[str, Any] | None = None
    found, dump = 0, list[str]()
    for text in process.stdout or ():
        if not text.startswith("{"):
            dump.append(text)
            continue
        line = json.loads(text)
        if "component" in line:
            started, found = line, 0
        found += "finding" in line
        yield line
        if "end" in line or "error" in line:
            return
    yield _bad_end(started, found, dump, process.wait())
    yield {"end": True}


def _bad_end(started: dict[str, Any] | None, done: int, dump: list[str], code: int) -> dict[str, Any]:
    """Return a failure of the check in progress, after `done` others; FraexpError if no check had begun."""
    if started is None:
        raise FraexpError(
            f"the check process ended with {_exit_text(code)} before the first check; see its output above"
        )
    kind, name = started["component"]["kind"], started["component"]["name"]
    what = f"the law of {name}" if kind == "friction" else f"{kind} {name}"
    place = dumped_location(dump, started["place"].partition(",")[0]) or started["place"]
    did = "did not return within the time limit" if dump else f"ended its process with {_exit_text(code)}"
    reason = f"{what} ({place}) {did}; expected a force; check the functions that it calls"
    checks = list(started["checks"].items())
    at, meaning = checks[min(done, len(checks) - 1)]
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
    reports = []
    for step, started, found in _follow(check_messages(arguments)):
        if step == "end":
            reports.append(_document(started))
        if not arguments.json:
            _print(step, started, found, arguments.quick)
    if arguments.json:
        print_json(reports)
    return ExitCode.OK if all(report["sound"] for report in reports) else ExitCode.INCOMPLETE


Step = tuple[Literal["begin", "finding", "end"], CheckStarted, CheckLine]


def _follow(lines: Iterable[dict[str, Any]]) -> Iterator[Step]:
    """Yield the begin, each finding and the end of each component's checks as soon as it is known."""
    started: CheckStarted | None = None
    for line in lines:
        if "finding" in line and started:
            started.findings.append(line["finding"])
            yield "finding", started, line["finding"]
            continue
        if started:
            yield from _finish(started)
        if "error" in line:
            raise PluginError(line["error"])
        started = None
        if "component" in line:
            started = CheckStarted(line["component"], line["place"], line["checks"], line["left_out"])
            yield "begin", started, {}


def _finish(started: CheckStarted) -> Iterator[Step]:
    made = {found["name"] for found in started.findings}
    why = started.findings[-1]["ends"] if started.findings else ""
    for name in [name for name in started.checks if name not in made]:  # the process ended before
        missing = {"name": name, "meaning": started.checks[name], "verdict": "not_run", "reason": why}
        started.findings.append({**missing, "example": "", "ends": ""})
        yield "finding", started, started.findings[-1]
    yield "end", started, {}


def _document(started: CheckStarted) -> dict[str, object]:
    checks = [{key: value for key, value in found.items() if key != "ends"} for found in started.findings]
    return {**started.component, "sound": not started.wrong, "checks": checks, "left_out": started.left_out}


def _print(step: str, started: CheckStarted, found: CheckLine, is_quick: bool) -> None:
    """Print a line for each check, and a summary; of a quick check the failures, and the names of all others."""
    if step == "begin" and is_quick:
        of = f" of {len(started.checks) + len(started.left_out)}" if started.left_out else ""
        print_line(f"{started.title}: {len(started.checks)}{of} checks (quick)")
    elif step == "begin":
        print_line(f"{started.title}: {plural(len(started.checks), 'check')}")
    elif step == "finding" and (is_wrong(found) or not is_quick):
        _print_finding(started, found)
    elif step == "end":
        for verdict, head in VERDICT_WORDS.items() if is_quick else ():
            _print_names(head, [one["name"] for one in started.findings if one["verdict"] == verdict])
        if is_quick:
            _print_names("omitted", started.left_out)
        print()
        say(_summary(started, is_quick))


def _print_finding(started: CheckStarted, found: CheckLine) -> None:
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


def _print_names(head: str, names: list[str]) -> None:
    if names:
        print_line(f"  {head:<{VERDICT_WIDTH}}  {', '.join(names)}", INDENT)


def _summary(started: CheckStarted, is_quick: bool) -> str:
    last = next((found for found in started.wrong if found["ends"]), None)
    if last:
        return f"{started.title}: {last['reason']}"
    if started.wrong:
        first, names = started.wrong[0], ", ".join(found["name"] for found in started.wrong)
        found = f"{plural(len(started.wrong), 'check')} failed: {names}"
        return f"{started.title} ({started.place}): {found}; {first['name']}: {first['reason']}"
    if not is_quick:
        return f"{started.title} is sound"
    more = f"fraexp check {started.component['name']} tests more examples"
    rest = f" and {', '.join(started.left_out)}" if started.left_out else ""
    return f"{started.title}: no fault found by the quick checks; {more}{rest}"
