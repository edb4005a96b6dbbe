"""``fraexp check``: the conformance checks of a component, of the workspace or installed, or of a plugin's file."""

from argparse import Namespace
from collections.abc import Iterable, Iterator
from typing import Any

from fraexp.cli.check_output import CheckOutput, CheckStarted, QuickOutput, SilentOutput
from fraexp.cli.checking import check_messages
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json
from fraexp.errors import PluginError


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
