"""Laws that never return, or end their process: one line that names the law, its file and its line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.components.registry import discover
from fraexp.errors import PluginError
from fraexp.testing import findings
from fraexp.testing.check_report import Verdict
from fraexp.views.law_trial import SineMotion, SineTrial
from tests.examples import thorough
from tests.refusals import refused

LAW = '''"""A law."""
import itertools
import os
import select

from fraexp.api import FrictionModel


class Mine(FrictionModel, name="mine", version=1):
    """Jenkins 1962, that does not come back."""

    states = ("force [N]",)
    {property}

    @staticmethod
    def advance(z, dy, dt, z_next):
        z_next[0] = min(max(z[0] + 1e5 * dy, -1.0), 1.0)
        {line}
        return z_next[0]
'''
LINE = LAW.splitlines().index("        {line}") + 1
FOREVER = "for _ in itertools.count(): z_next[0] += 1e-9"
IN_C = ["select.select([], [], [], 1e6)", "3 ** 10 ** 9"]
"""Calls that cannot be interrupted: one lets others run, one does not."""


def dropped(folder: Path, line: str = "", prop: str = "") -> Path:
    (folder / "plugins").mkdir()
    (folder / "plugins/mine.py").write_text(LAW.format(line=line, property=prop))
    return folder


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A law has a second, also in the processes that a test starts: what is tested is that it is ended, not when."""
    for module in ("components.law_step", "testing.check_report", "views.law_trial"):
        monkeypatch.setattr(f"fraexp.{module}.LAW_TIME_LIMIT_S", 1.0)
    folder = tmp_path_factory.mktemp("site")
    text = "from fraexp.kernels import watchdog\n\nwatchdog.LAW_TIME_LIMIT_S = 1.0\n"
    (folder / "sitecustomize.py").write_text(text)  # which Python executes when it starts
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)


def fraexp(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "fraexp", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_the_first_trial_names_the_line_and_the_step(tmp_path: Path) -> None:
    law = discover(dropped(tmp_path, FOREVER) / "plugins").create("friction", {"name": "mine"})
    with refused(PluginError, "mine.py", f"line {LINE}", "1 s"):
        law.check_law()


def test_no_further_check_is_made_of_a_law_that_does_not_return(tmp_path: Path) -> None:
    component = discover(dropped(tmp_path, FOREVER) / "plugins").provider("friction", "mine").component
    first, *others = [found for found in findings(component) if found.verdict is not Verdict.PASSED]
    assert (first.check.name, first.verdict) == ("finite", Verdict.FAILED)
    assert f"(mine.py, line {LINE})" in first.reason
    assert {found.verdict for found in others} == {Verdict.NOT_RUN}


@pytest.mark.parametrize("line", ["os.abort()", IN_C[0]])
@pytest.mark.thorough
def test_check_ends_in_one_line(line: str, tmp_path: Path) -> None:
    done = fraexp(dropped(tmp_path, line), "check", "mine", "--quick")
    assert done.returncode == ExitCode.INCOMPLETE
    told = done.stderr.splitlines()[-1]
    assert told.startswith("friction mine: the law of mine (mine.py, line ")
    assert "expected a force" in told
    assert "  not run   " in done.stdout
    if line != "os.abort()":
        assert f"mine.py, line {LINE})" in told
        assert done.stderr.count("\n") == 1


@pytest.mark.thorough
@pytest.mark.parametrize("line", [thorough(FOREVER), "select.select([], [], [], 1e6)"])
def test_a_run_ends_in_one_line(line: str, tmp_path: Path) -> None:
    study = 'title = "Mine"\n[loop]\nsample_time = 1e-3\n[friction]\nname = "mine"\n[excitation]\n'
    study += 'name = "displacement_sine"\nfrequency = 10.0\namplitude = 1e-5\n[estimator]\nname = "hysteresis"\n'
    folder = dropped(tmp_path, line)
    (folder / "studies").mkdir()
    (folder / "studies/mine.toml").write_text(study)
    done = fraexp(folder, "run", "mine", "--executor", "serial")
    assert done.returncode == ExitCode.INCOMPLETE
    assert f"the law of mine (mine.py, line {LINE}) has not returned" in done.stderr + done.stdout


@pytest.mark.thorough
@pytest.mark.parametrize("line", [FOREVER, IN_C[1]])
def test_a_trial_by_hand_ends_in_one_line(line: str, tmp_path: Path) -> None:
    with refused(PluginError, "mine", "mine.py", f"line {LINE}"):
        SineTrial({"name": "mine"}, SineMotion(), discover(dropped(tmp_path, line) / "plugins")).loop()


@pytest.mark.thorough
def test_compiled_code_that_never_returns_ends_with_its_process(tmp_path: Path) -> None:
    line = "while abs(dt - 1e-3 / 16) < 1e-6: z_next[0] += 1e-9"  # a step that only closed loops take
    done = fraexp(dropped(tmp_path, line), "check", "mine")
    assert done.returncode == ExitCode.INCOMPLETE
    assert done.stderr.splitlines()[-1].startswith("friction mine: the law of mine (mine.py, line ")
    assert "  FAIL      energy " in done.stdout
    assert os.linesep + "  not run   observer" in done.stdout
