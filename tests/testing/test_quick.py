"""The quick check: what it finds in plain Python, what it leaves out, and what it says of both."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.kinds import Component
from fraexp.testing.check_catalogue import checks_for, quick_checks_for
from fraexp.testing.check_report import Verdict, findings
from tests.testing import defects, other_defects

SLOW_TO_SEE = {"compiled", "endurance", "linear-plant", "result-units", "outcome", "covariance"}
"""Checks of what takes compiled code or a simulation."""
SEEDED = [*defects.FRICTION.items(), *other_defects.OTHERS]
QUICK = [(component, name) for component, name in SEEDED if name not in SLOW_TO_SEE]


def named(part: object) -> str:
    return part if isinstance(part, str) else part.name


@pytest.mark.thorough
@pytest.mark.parametrize(("component", "name"), QUICK, ids=named)
def test_a_seeded_defect_is_found_quickly_by_name(component: type[Component], name: str) -> None:
    found = {finding.check.name: finding for finding in findings(component, is_quick=True)}
    assert found[name].verdict is Verdict.FAILED
    assert found[name].reason


@pytest.mark.parametrize("component", [defects.Element, *other_defects.SOUND], ids=named)
def test_nothing_is_found_in_a_component_without_defect(component: type[Component]) -> None:
    assert [
        finding.reason for finding in findings(component, is_quick=True) if finding.verdict is not Verdict.PASSED
    ] == []


def test_only_what_needs_the_compiler_or_a_simulation_is_left_out() -> None:
    for component in {component for component, _ in SEEDED}:
        quick = {check.name for check in quick_checks_for(component)}
        assert {check.name for check in checks_for(component)} - quick <= {*SLOW_TO_SEE, "observer"}


@pytest.mark.thorough
def test_the_command_compiles_nothing_and_says_what_it_leaves_out(tmp_path: Path) -> None:
    code = (
        "import sys, json; sys.argv[1:] = ["
        f"json.dumps({{'name': 'dahl', 'kind': None, 'workspace': '.', 'quick': True, 'folder': {str(tmp_path)!r}}})]\n"
        "from fraexp.testing.check_process import main; main(); assert 'numba' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == {"end": True}


@pytest.mark.thorough
def test_failures_stand_first_and_what_was_left_out_last(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "friction", "mine"]) == ExitCode.OK
    file = tmp_path / "plugins/mine.py"
    capsys.readouterr()
    assert main(["check", "mine", "--quick"]) == ExitCode.OK
    printed = capsys.readouterr()
    assert "  omitted   compiled, endurance, observer" in printed.out
    assert "friction mine: no fault found by the quick checks" in printed.err
    file.write_text(file.read_text().replace("-limit", "-0.9 * limit"))
    assert main(["check", "mine", "--quick"]) == ExitCode.INCOMPLETE
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("  FAIL      odd ")
    assert lines[-2].startswith("  omitted   compiled")


def test_one_document_names_what_was_left_out(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "conventional", "--quick", "--json"]) == ExitCode.OK
    (report,) = json.loads(capsys.readouterr().out)
    assert (report["kind"], report["name"], report["sound"]) == ("estimator", "conventional", True)
    assert {check["verdict"] for check in report["checks"]} == {"passed"}
    assert report["left_out"] == ["linear-plant", "result-units", "covariance", "outcome"]
