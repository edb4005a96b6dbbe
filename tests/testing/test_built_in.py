"""Every installed component passes the checks of its kind, but for what it declares."""

import inspect

import pytest

from fraexp.components import Component
from fraexp.plugins import discover
from fraexp.testing import Check, checks_for
from fraexp.testing.report import Verdict, expectations, run_check

PAIRS = [(supply.component, check) for supply in discover().supplies.values() for check in checks_for(supply.component)]


@pytest.mark.parametrize(
    ("component", "check"), PAIRS, ids=lambda part: f"{part.kind}-{part.name}" if inspect.isclass(part) else part.name
)
def test_a_built_in_component_conforms(component: type[Component], check: Check) -> None:
    finding = run_check(check, component, expectations(component).get(check.name))
    assert not finding.wrong, str(finding)
    assert finding.verdict is not Verdict.SKIPPED or finding.reason
