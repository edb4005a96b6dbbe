"""Every installed component passes the checks of its kind, but for what it declares."""

import inspect
from collections.abc import Iterator
from typing import Any

import pytest
from fraexp_plugins.friction.dahl import Dahl

from fraexp.components.kinds import Component
from fraexp.components.registry import discover
from fraexp.testing import Check, check_report, checks_for
from fraexp.testing.check_report import Verdict, expectations, run_check
from tests.examples import thorough

COSTLY = {
    ("friction", "observer"),
    ("friction", "energy"),
    ("excitation", "refuses"),
    ("excitation", "plain-data"),
    ("excitation", "whole-periods"),
    ("excitation", "repeatable"),
    ("excitation", "schedule"),
    ("machine", "description"),
    ("machine", "silence"),
    ("machine", "stop"),
}
"""Kinds, and checks of theirs that take seconds: in make test, the seeded defects are enough for them."""
ALIKE = {"composite", "dahl", "elastoplastic", "gms", "lugre", "rolling_force_slider"} | {
    "maximum_likelihood"
}  # fmt: skip
"""Friction laws that are made like others, and methods that take long: in make test, the others are enough."""


def pairs() -> Iterator[Any]:
    """Yield each component with each of its checks."""
    for component in (provider.component for provider in discover().providers.values()):
        for check in checks_for(component):
            is_costly = (component.kind, check.name) in COSTLY or component.name in ALIKE
            yield thorough(component, check) if is_costly else (component, check)


@pytest.mark.parametrize(
    ("component", "check"),
    list(pairs()),
    ids=lambda part: f"{part.kind}-{part.name}" if inspect.isclass(part) else part.name,
)
def test_a_built_in_component_conforms(component: type[Component], check: Check) -> None:
    finding = run_check(check, component, expectations(component).get(check.name))
    assert not finding.is_failure, str(finding)
    assert finding.verdict is not Verdict.SKIPPED or finding.reason


def test_a_law_whose_steps_take_long_is_tried_on_fewer_examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_report, "MAX_SEARCH_TIME_S", 0.0)
    (check,) = (each for each in checks_for(Dahl) if each.name == "odd")
    finding = run_check(check, Dahl)
    assert finding.verdict is Verdict.PASSED
    assert finding.reason == f"tried {check_report.MIN_EXAMPLES} examples only: each takes long"
