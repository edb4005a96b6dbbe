"""``fraexp check``: the conformance checks of a component, of the workspace or installed, or of a plugin's file."""

import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fraexp.cli.exits import ExitCode
from fraexp.cli.terminal import print_json, say
from fraexp.components import Component
from fraexp.errors import PluginError
from fraexp.figures.labels import printable
from fraexp.plugins import Registry, components_in, discover, load_file, reason_of
from fraexp.testing import Finding, Report, Verdict, checks_for, findings
from fraexp.views.words import plural

HEADS = {Verdict.PASSED: "pass", Verdict.SKIPPED: "skip", Verdict.EXPECTED: "expected"}
"""Words of a report's first column; all else is FAIL."""
WORD, NAME = 8, 15
"""Widths of a report's first two columns."""


def execute(arguments: Namespace) -> ExitCode:
    """Check, print what each check has found, and return whether something must be mended."""
    from hypothesis.configuration import set_hypothesis_home_dir

    components = list(_components(arguments.name, arguments.kind, Path(arguments.workspace)))
    with tempfile.TemporaryDirectory() as folder:  # hypothesis would write into the folder that the user is in
        set_hypothesis_home_dir(folder)
        reports = [_report(component, quiet=arguments.json) for component in components]
    if arguments.json:
        print_json([_document(report) for report in reports])
    return ExitCode.OK if all(report.sound for report in reports) else ExitCode.INCOMPLETE


def _report(component: type[Component], quiet: bool) -> Report:
    if not quiet:
        print(printable(f"{component.kind} {component.name}: {plural(len(checks_for(component)), 'check')}"))
    found: list[Finding] = []
    for finding in findings(component):
        if not quiet:
            _print(finding, [earlier for earlier in found if earlier.wrong and earlier.reason == finding.reason])
        found.append(finding)
    report = Report(component, tuple(found))
    if not quiet:
        print()
        say(_summary(report))
    return report


def _print(finding: Finding, same: list[Finding]) -> None:
    """Print a finding; a reason that an earlier one has told already is told by its name."""
    head = HEADS.get(finding.verdict, "FAIL")
    print(printable(f"  {head:<{WORD}}  {finding.check.name:<{NAME}} {finding.check.meaning}"), flush=True)
    indent = " " * (WORD + NAME + 5)
    what = "passes, though declared to fail; " if finding.verdict is Verdict.UNEXPECTED else ""
    if finding.wrong and same:
        print(printable(f"{indent}{what}for the same reason as {same[0].check.name}"))
        return
    if finding.reason:
        print(printable(f"{indent}{what}{finding.reason}"))
    if finding.example and finding.wrong:
        print(printable(f"{indent}with {finding.example}"))


def _summary(report: Report) -> str:
    wrong = [finding.check.name for finding in report.findings if finding.wrong]
    title = f"{report.component.kind} {report.component.name}"
    return f"{title}: {plural(len(wrong), 'check')} failed: {', '.join(wrong)}" if wrong else f"{title} is sound"


def _document(report: Report) -> dict[str, Any]:
    return {
        "kind": report.component.kind,
        "name": report.component.name,
        "version": report.component.version,
        "sound": report.sound,
        "checks": [
            {
                "name": finding.check.name, "meaning": finding.check.meaning, "verdict": finding.verdict.name.lower(),
                "reason": finding.reason, "example": finding.example,
            }
            for finding in report.findings
        ],
    }  # fmt: skip


def _components(name: str, kind: str | None, workspace: Path) -> Iterator[type[Component]]:
    if name.endswith(".py"):
        return _of_file(Path(name), kind)
    return _named(name, kind, discover(workspace / "plugins"))


def _of_file(file: Path, kind: str | None) -> Iterator[type[Component]]:
    if not file.is_file():
        raise PluginError(f"{file}: there is no such file")
    try:
        found = components_in(load_file(file))
    except (Exception, SystemExit) as error:  # a stranger's file may raise anything
        raise PluginError(f"{file} cannot be loaded: {reason_of(error, file)}") from error
    chosen = [component for component in found if kind in (None, component.kind)]
    if not chosen:
        what = f"{kind} component" if kind else "component"
        raise PluginError(f"{file}: defines no {what}; expected a class such as class Mine(FrictionModel, name=...)")
    yield from chosen


def _named(name: str, kind: str | None, registry: Registry) -> Iterator[type[Component]]:
    kinds = sorted({of for of, known in registry.supplies if known == name and kind in (None, of)})
    if len(kinds) > 1:
        raise PluginError(f"'{name}' is the name of a {' and of a '.join(kinds)}; choose one with --kind")
    if not kinds:
        names = {known for of, known in registry.supplies if kind in (None, of)}
        raise PluginError(f"no {kind or 'component'} is called '{name}'{registry.instead(name, names)}")
    yield registry.supply(kinds[0], name).component
