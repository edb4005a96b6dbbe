"""Running checks, and what came out of each."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from fraexp.components import Component
from fraexp.errors import PluginError, did_you_mean
from fraexp.testing.catalogue import checks_for
from fraexp.testing.check import Check, NotApplicableError, ViolationError
from fraexp.testing.walk import described


class Verdict(Enum):
    """How a check came out; the value is the word for reports."""

    PASSED = "pass"
    SKIPPED = "skipped"
    EXPECTED = "expected failure"
    FAILED = "FAIL"
    UNEXPECTED = "FAIL: passes, though declared to fail"


@dataclass(frozen=True)
class Finding:
    """What one check has found."""

    check: Check
    verdict: Verdict
    reason: str = ""
    """Why it failed, was skipped, or is expected to fail; in one line."""
    example: str = ""
    """The smallest example that was found; empty for a check of the class itself."""

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
) -> Iterator[Finding]:
    """Yield the findings one after another, as `run_checks` reports them."""
    expected = expectations(component, expected_failures)
    for check in checks if checks is not None else checks_for(component):
        yield run_check(check, component, expected.get(check.name))


def expectations(component: type[Component], more: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the declared expected failures; PluginError for one of a check that does not exist."""
    expected = {**component.expected_failures, **(more or {})}
    known = [check.name for check in checks_for(component)]
    for name in expected:
        if name not in known:
            raise PluginError(f"{component.name}.expected_failures: no check '{name}'{did_you_mean(name, known)}")
    return expected


def run_check(check: Check, component: type[Component], expected: str | None = None) -> Finding:
    """Run one check; `expected` is the reason why it must fail, if it must."""
    with np.errstate(all="ignore"):  # what overflows shows as an infinite force
        found = _Search(check, component).finding()
    if expected is None or found.verdict is Verdict.SKIPPED:
        return found
    if found.verdict is Verdict.FAILED:
        return Finding(check, Verdict.EXPECTED, expected, found.example)
    return Finding(check, Verdict.UNEXPECTED, f"take it out of expected_failures ({expected})")


@dataclass
class _Search:
    """The search for an example that breaks a check."""

    check: Check
    component: type[Component]
    example: Any = None
    looked_at: int = 0
    skipped: str = field(default="")

    def finding(self) -> Finding:
        """Return the finding."""
        try:
            self._search() if self.check.draws else self._look(self.component)
        except ViolationError as violation:
            return Finding(self.check, Verdict.FAILED, _line(str(violation)), self._example)
        except Exception as error:  # a stranger's component may raise anything
            return Finding(self.check, Verdict.FAILED, _line(f"{type(error).__name__}: {error}"), self._example)
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
            phases=(Phase.generate, Phase.target, Phase.shrink),
        )(found)()

    def _look(self, example: Any) -> None:
        self.example = example
        try:
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
            return described(getattr(self.example, "model", self.example))


def _line(text: str) -> str:
    return " ".join(text.split())
