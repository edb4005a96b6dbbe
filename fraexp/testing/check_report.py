"""Run checks and report their findings."""

import inspect
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.components.kinds import Component, FrictionModel
from fraexp.components.law_step import law_place, overdue_text, step_text
from fraexp.components.registry import reason_of
from fraexp.errors import FraexpError, PluginError, did_you_mean
from fraexp.kernels.law_error import LawError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, error_location, time_limit
from fraexp.testing.check_catalogue import checks_for, quick_checks_for
from fraexp.testing.conformance_check import Check, NotApplicableError, ViolationError
from fraexp.testing.walk import Walk, describe_component, interpreted_class


def conformance(
    component: type[Component], expected_failures: Mapping[str, str] | None = None
) -> Callable[[Check], None]:
    """Return a parametrised test of a component class: ``test_mine = fraexp.testing.conformance(Mine)``.

    `expected_failures` are names of checks with the reason why they must fail, besides those that the class declares.
    """
    import pytest  # only where tests are run

    expected = expectations(component, expected_failures)
    checks = checks_for(component)

    @pytest.mark.parametrize("check", checks, ids=[check.name for check in checks])
    def test(check: Check) -> None:
        finding = run_check(check, component, expected.get(check.name))
        if finding.is_failure:
            pytest.fail(str(finding), pytrace=False)
        outcomes: dict[Verdict, Callable[[str], object]] = {
            Verdict.SKIPPED: pytest.skip,
            Verdict.EXPECTED: pytest.xfail,
        }
        if finding.verdict in outcomes:
            outcomes[finding.verdict](finding.reason)

    return test


def overdue_reason(error: OverdueError, example: object) -> str:
    """Return in one line why an example was given up: what did not return, and where."""
    owner = getattr(example, "model", example)
    if not isinstance(owner, FrictionModel):
        cls: Any = owner if inspect.isclass(owner) else type(owner)
        place = error_location(error, inspect.getfile(cls), inspect.getsourcelines(cls)[1])
        found = f"{cls.name} ({place}) has not returned after {LAW_TIME_LIMIT_S:g} s"
        return f"{found}; check the conditions that end its loops"
    return f"the law of {owner.name} {overdue_text(error, owner.law, _tried_step(error))}"


def _tried_step(error: OverdueError) -> str:
    """Return the step that the law was tried with; empty if it was none."""
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code is Walk.try_step.__code__:
            seen = trace.tb_frame.f_locals
            return step_text(seen["dy"], seen["self"].time_step)
        trace = trace.tb_next
    return ""


def compile_error_reason(error: Exception, example: object) -> str:
    """Return in one line why a law cannot be compiled; the compiler may have named the place where it was called."""
    text = " ".join(str(error).split())
    owner = getattr(example, "model", example)
    if not isinstance(owner, FrictionModel):
        return text
    named = text if isinstance(error, LawError) else f"it cannot be compiled: {text}"
    return f"the law of {owner.name} ({law_place(owner.law)}): {named}"


ExampleListener = Callable[[Check, object], None]
"""Called with check and example before the example is tried."""


class Verdict(Enum):
    """How a check came out; the value is the word for reports."""

    PASSED = "pass"
    SKIPPED = "skipped"
    EXPECTED = "expected failure"
    FAILED = "FAIL"
    UNEXPECTED = "FAIL: passes, though declared to fail"
    NOT_RUN = "not run"


@dataclass(frozen=True)
class CheckOutcome:
    """The result of one check."""

    check: Check
    verdict: Verdict
    reason: str = ""
    """Why it failed, was skipped, or is expected to fail; in one line."""
    example: str = ""
    """The smallest example that was found; empty for a check of the class itself."""
    stop_reason: str = ""
    """Why the checks that follow are not run: all of them, or the compiled ones; empty if they are."""

    @property
    def is_failure(self) -> bool:
        """Whether the component must be repaired."""
        return self.verdict in (Verdict.FAILED, Verdict.UNEXPECTED)

    def __str__(self) -> str:
        """One or two lines for people."""
        example = f"\n  {self.example}" if self.example else ""
        return f"{self.check.name}: {self.check.meaning} {self.reason}{example}"


def findings(
    component: type[Component],
    checks: Iterable[Check] | None = None,
    expected_failures: Mapping[str, str] | None = None,
    on_example: ExampleListener = lambda check, example: None,
    is_quick: bool = False,
) -> Iterator[CheckOutcome]:
    """Yield the findings of the checks of a component class, by default of all that apply, one after another.

    `expected_failures` are names of checks with reasons, besides those that the class declares: such a check must
    fail, and is reported if it passes. `on_example` is called with each example. Quick checks try fewer examples, and
    compile nothing.
    """
    expected = expectations(component, expected_failures)
    applicable = (quick_checks_for if is_quick else checks_for)(component)
    last: CheckOutcome | None = None
    for check in applicable if checks is None else checks:
        if last and (check.is_compiled or not last.check.is_compiled):
            yield CheckOutcome(check, Verdict.NOT_RUN, last.stop_reason)
            continue
        target = interpreted_class(component) if is_quick and check.make_strategy else component
        finding = run_check(check, target, expected.get(check.name), on_example)
        if is_quick and finding.verdict is Verdict.UNEXPECTED:  # a few examples are no proof that it passes
            finding = CheckOutcome(check, Verdict.SKIPPED, f"declared to fail: {expected[check.name]}")
        last = finding if finding.stop_reason else last
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
    on_example: ExampleListener = lambda check, example: None,
) -> CheckOutcome:
    """Run one check; `expected` is the reason why it must fail, if it must."""
    if expected is not None:  # that no example fails must not be chance
        check = replace(check, examples=EXPECTED_FAILURE_EFFORT * check.examples)
    with np.errstate(all="ignore"):  # what overflows shows as an infinite force
        found = _ExampleSearch(check, component, on_example).finding()
    if expected is None or found.stop_reason or found.verdict is Verdict.SKIPPED:
        return found
    if found.verdict is Verdict.FAILED:
        return CheckOutcome(check, Verdict.EXPECTED, expected, found.example)
    return CheckOutcome(check, Verdict.UNEXPECTED, f"remove it from expected_failures ({expected})")


@dataclass
class _ExampleSearch:
    """The search for an example that breaks a check."""

    check: Check
    component: type[Component]
    on_example: ExampleListener
    example: object = None
    tried: int = 0
    """Number of examples to which the check applies."""
    skipped: str = field(default="")
    left_out: int = 0
    """Number of examples for which there was no time."""
    began: float = field(default_factory=time.process_time)

    def finding(self) -> CheckOutcome:
        """Return the finding."""
        try:
            self._search() if self.check.make_strategy else self._try(self.component)
        except ViolationError as violation:
            return CheckOutcome(self.check, Verdict.FAILED, _one_line(str(violation)), self._example_text)
        except OverdueError as error:
            reason = overdue_reason(error, self.example)
            return CheckOutcome(
                self.check, Verdict.FAILED, reason, self._owner_text, f"{self.component.name} does not return"
            )
        except Exception as error:  # a stranger's component may raise anything
            reason = _one_line(str(error) if isinstance(error, FraexpError) else reason_of(error, self._file))
            if isinstance(error, LawError) or type(error).__module__.startswith("numba"):
                return CheckOutcome(
                    self.check,
                    Verdict.FAILED,
                    compile_error_reason(error, self.example),
                    self._owner_text,
                    NOT_COMPILED,
                )
            return CheckOutcome(self.check, Verdict.FAILED, reason, self._example_text)
        if not self.tried:
            return CheckOutcome(self.check, Verdict.SKIPPED, self.skipped)
        cut = f"tried {self.tried} examples only: each takes long" if self.left_out else ""
        return CheckOutcome(self.check, Verdict.PASSED, cut)

    def _search(self) -> None:
        from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings

        make_strategy = self.check.make_strategy
        if make_strategy is None:
            return
        search = seed(EXAMPLE_SEED)(given(make_strategy(self.component))(self._try))
        settings(
            max_examples=self.check.examples,
            deadline=None,
            derandomize=True,
            database=None,
            report_multiple_bugs=False,
            verbosity=Verbosity.quiet,
            suppress_health_check=list(HealthCheck),
            phases=(Phase.generate, Phase.target, *([Phase.shrink] if self.check.shrinks else [])),
        )(search)()

    def _try(self, example: object) -> None:
        if self.tried >= MIN_EXAMPLES and time.process_time() - self.began > MAX_SEARCH_TIME_S:
            self.left_out += 1
            return
        self.example = example
        self.on_example(self.check, example)
        try:
            with nullcontext() if self.check.is_compiled else time_limit(LAW_TIME_LIMIT_S):
                self.check.body(example)
            self.tried += 1
        except NotApplicableError as reason:
            self.skipped = str(reason)

    @property
    def _file(self) -> Path | None:
        """The file of the component's class."""
        try:
            return Path(inspect.getfile(self.component))
        except (OSError, TypeError):
            return None

    @property
    def _example_text(self) -> str:
        if self.example is None or self.example is self.component:
            return ""
        try:
            return describe_component(self.example) if isinstance(self.example, Component) else str(self.example)
        except Exception:  # the component may be too broken to be described further
            return self._owner_text

    @property
    def _owner_text(self) -> str:
        """The component of the example, described without trying it."""
        owner = getattr(self.example, "model", self.example)
        return describe_component(owner) if isinstance(owner, Component) else ""


MIN_EXAMPLES = 8
"""Number of examples that are tried however long they take."""
MAX_SEARCH_TIME_S = 30.0
"""Processor time of a check from which no further example is tried [s]: most take less than one in all."""
EXPECTED_FAILURE_EFFORT = 8
"""Factor on the examples of a check that must fail: the search ends with the first one that does."""
EXAMPLE_SEED = 1
"""Seed of all examples, so that a component has the same findings whenever it is checked. Any number will do, and tests
take others. Without one hypothesis takes the source text of the function that tries them: an edit there would try every
component on other examples."""
NOT_COMPILED = "the law cannot be compiled"
"""Why the checks that need the compiled law are not run."""


def _one_line(text: str) -> str:
    return " ".join(text.split())
