"""Running checks, and what came out of each."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from fraexp.components.kinds import Component
from fraexp.errors import PluginError, did_you_mean
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, time_limit
from fraexp.testing.check_catalogue import checks_for, quick_checks_for
from fraexp.testing.conformance_check import Check, NotApplicableError, ViolationError
from fraexp.testing.interpreted import interpreted
from fraexp.testing.overdue import overdue, uncompiled
from fraexp.testing.walk import described

Begins = Callable[[Check, Any], None]
"""Is told of each check's examples, before it is looked at."""


class Verdict(Enum):
    """How a check came out; the value is the word for reports."""

    PASSED = "pass"
    SKIPPED = "skipped"
    EXPECTED = "expected failure"
    FAILED = "FAIL"
    UNEXPECTED = "FAIL: passes, though declared to fail"
    NOT_RUN = "not run"


@dataclass(frozen=True)
class Finding:
    """What one check has found."""

    check: Check
    verdict: Verdict
    reason: str = ""
    """Why it failed, was skipped, or is expected to fail; in one line."""
    example: str = ""
    """The smallest example that was found; empty for a check of the class itself."""
    ends: str = ""
    """Why checks that follow are in vain: all of them, or those that are compiled; empty if they are not."""

    @property
    def wrong(self) -> bool:
        """Whether this must be mended."""
        return self.verdict in (Verdict.FAILED, Verdict.UNEXPECTED)

    def __str__(self) -> str:
        """One or two lines for people."""
        example = f"\n  {self.example}" if self.example else ""
        return f"{self.check.name}: {self.check.meaning} {self.reason}{example}"


@dataclass(frozen=True)
class Report:
    """The findings of all checks of one component."""

    component: type[Component]
    findings: tuple[Finding, ...]

    @property
    def sound(self) -> bool:
        """Whether nothing must be mended."""
        return not any(finding.wrong for finding in self.findings)


def run_checks(
    component: type[Component],
    checks: Iterable[Check] | None = None,
    expected_failures: Mapping[str, str] | None = None,
) -> Report:
    """Run the checks of a component class, by default all that apply, and report.

    `expected_failures` are names of checks with reasons, besides those that the class declares: such a check must
    fail, and is reported if it passes.
    """
    return Report(component, tuple(findings(component, checks, expected_failures)))


def findings(
    component: type[Component],
    checks: Iterable[Check] | None = None,
    expected_failures: Mapping[str, str] | None = None,
    begins: Begins = lambda check, example: None,
) -> Iterator[Finding]:
    """Yield the findings one after another, as `run_checks` reports them; `begins` is told each example first."""
    expected = expectations(component, expected_failures)
    last: Finding | None = None
    for check in checks if checks is not None else checks_for(component):
        if last and (check.is_compiled or not last.check.is_compiled):
            yield Finding(check, Verdict.NOT_RUN, last.ends)
            continue
        finding = run_check(check, component, expected.get(check.name), begins)
        last = finding if finding.ends else last
        yield finding


def quick_findings(component: type[Component], begins: Begins = lambda check, example: None) -> Iterator[Finding]:
    """Yield what the quick checks of a component find: fewer examples, and nothing compiled."""
    expected, last = expectations(component), ""
    for check in quick_checks_for(component):
        if last:
            yield Finding(check, Verdict.NOT_RUN, last)
            continue
        looked_at = interpreted(component) if check.draws else component
        finding = run_check(check, looked_at, expected.get(check.name), begins)
        if finding.verdict is Verdict.UNEXPECTED:  # a few examples are no proof that it passes
            finding = Finding(check, Verdict.SKIPPED, f"declared to fail: {expected[check.name]}")
        last = finding.ends
        yield finding


def expectations(component: type[Component], more: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the declared expected failures; PluginError for one of a check that does not exist."""
    expected = {**component.expected_failures, **(more or {})}
    known = [check.name for check in checks_for(component)]
    for name in expected:
        if name not in known:
            raise PluginError(f"{component.name}.expected_failures: no check '{name}'{did_you_mean(name, known)}")
    return expected


def run_check(
    check: Check,
    component: type[Component],
    expected: str | None = None,
    begins: Begins = lambda check, example: None,
) -> Finding:
    """Run one check; `expected` is the reason why it must fail, if it must."""
    with np.errstate(all="ignore"):  # what overflows shows as an infinite force
        found = _Search(check, component, begins).finding()
    if expected is None or found.ends or found.verdict is Verdict.SKIPPED:
        return found
    if found.verdict is Verdict.FAILED:
        return Finding(check, Verdict.EXPECTED, expected, found.example)
    return Finding(check, Verdict.UNEXPECTED, f"take it out of expected_failures ({expected})")


@dataclass
class _Search:
    """The search for an example that breaks a check."""

    check: Check
    component: type[Component]
    begins: Begins
    example: Any = None
    looked_at: int = 0
    skipped: str = field(default="")

    def finding(self) -> Finding:
        """Return the finding."""
        try:
            self._search() if self.check.draws else self._look(self.component)
        except ViolationError as violation:
            return Finding(self.check, Verdict.FAILED, _line(str(violation)), self._example)
        except OverdueError as error:
            reason = overdue(error, self.example)
            return Finding(self.check, Verdict.FAILED, reason, self._owner, f"{self.component.name} does not return")
        except Exception as error:  # a stranger's component may raise anything
            reason = _line(f"{type(error).__name__}: {error}")
            if "cannot be compiled" in reason or type(error).__module__.startswith("numba"):
                return Finding(self.check, Verdict.FAILED, uncompiled(error, self.example), self._owner, NOT_COMPILED)
            return Finding(self.check, Verdict.FAILED, reason, self._example)
        if not self.looked_at:
            return Finding(self.check, Verdict.SKIPPED, self.skipped)
        return Finding(self.check, Verdict.PASSED)

    def _search(self) -> None:
        from hypothesis import HealthCheck, Phase, Verbosity, given, settings

        draws = self.check.draws
        if draws is None:
            return
        found = given(draws(self.component))(self._look)
        settings(
            max_examples=self.check.examples,
            deadline=None,
            derandomize=True,
            database=None,
            report_multiple_bugs=False,
            verbosity=Verbosity.quiet,
            suppress_health_check=list(HealthCheck),
            phases=(Phase.generate, Phase.target, *([Phase.shrink] if self.check.shrinks else [])),
        )(found)()

    def _look(self, example: Any) -> None:
        self.example = example
        self.begins(self.check, example)
        try:
            with nullcontext() if self.check.is_compiled else time_limit(LAW_TIME_LIMIT_S):
                self.check.body(example)
            self.looked_at += 1
        except NotApplicableError as reason:
            self.skipped = str(reason)

    @property
    def _example(self) -> str:
        if self.example is None or self.example is self.component:
            return ""
        try:
            return described(self.example) if isinstance(self.example, Component) else str(self.example)
        except Exception:  # the component may be too broken to be described further
            return self._owner

    @property
    def _owner(self) -> str:
        """The component of the example, described without trying it."""
        owner = getattr(self.example, "model", self.example)
        return described(owner) if isinstance(owner, Component) else ""


NOT_COMPILED = "the law cannot be compiled"
"""Why the checks that need the compiled law are not run."""


def _line(text: str) -> str:
    return " ".join(text.split())
