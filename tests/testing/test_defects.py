"""That the checks bite: a component with a defect is caught by the check of that name, one without is not."""

from dataclasses import replace

import pytest

from fraexp.components.kinds import Component
from fraexp.errors import PluginError
from fraexp.testing import Verdict, checks_for, findings
from fraexp.testing.check_catalogue import FRICTION
from tests.examples import thorough
from tests.refusals import refused
from tests.testing import defects, other_defects


def only(component: type[Component], name: str):
    return [check for check in checks_for(component) if check.name == name]


@pytest.mark.parametrize(
    ("component", "name"),
    [*defects.FRICTION.items(), *other_defects.OTHERS],
    ids=lambda part: part if isinstance(part, str) else part.name,
)
def test_a_seeded_defect_is_caught_by_name(component: type[Component], name: str) -> None:
    (finding,) = findings(component, [replace(check, shrinks=False) for check in only(component, name)])
    assert finding.verdict is Verdict.FAILED
    assert finding.reason
    assert "\n" not in finding.reason + finding.example
    assert finding.check.make_strategy is None or component.name in finding.example


def test_every_check_of_friction_has_a_defect_that_it_catches() -> None:
    caught = {*defects.FRICTION.values(), "observer"}
    assert [check.name for check in FRICTION if check.name not in caught] == []


@pytest.mark.thorough
def test_the_observer_check_catches_what_depends_on_the_step() -> None:
    (finding,) = findings(defects.Leaking, only(defects.Leaking, "observer"))
    assert finding.verdict is Verdict.FAILED


@pytest.mark.parametrize(
    "component", [thorough(defects.Element), *other_defects.SOUND], ids=lambda component: component.name
)
def test_a_component_without_defect_passes(component: type[Component]) -> None:
    assert [finding.reason for finding in findings(component) if finding.verdict is not Verdict.PASSED] == []


def test_a_smooth_function_of_the_velocity_passes_however_narrow_its_transition() -> None:
    checks = [*only(defects.OfVelocity, "continuous"), *only(defects.OfVelocity, "refinement")]
    assert [found.verdict for found in findings(defects.OfVelocity, checks)] == [Verdict.PASSED] * 2


def test_an_expected_failure_must_fail() -> None:
    expected = {"odd": "one direction is weaker"}
    (found,) = findings(defects.Lopsided, only(defects.Lopsided, "odd"), expected)
    assert (found.verdict, found.reason) == (Verdict.EXPECTED, "one direction is weaker")
    (found,) = findings(defects.Element, only(defects.Element, "odd"), expected)
    assert found.verdict is Verdict.UNEXPECTED
    assert found.is_failure


def test_an_expected_failure_of_an_unknown_check_is_refused() -> None:
    with refused(PluginError, "element.expected_failures", "'enrgy'", "'energy'"):
        list(findings(defects.Element, expected_failures={"enrgy": "a slip"}))
