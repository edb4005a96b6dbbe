"""All checks of a component as one pytest function."""

from collections.abc import Callable, Mapping

from fraexp.components.kinds import Component
from fraexp.testing.check_catalogue import checks_for
from fraexp.testing.check_report import Verdict, expectations, run_check
from fraexp.testing.conformance_check import Check


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
