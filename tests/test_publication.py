"""What publication needs: a citation, an article, and types that a strict user's checker accepts."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.waiting import HANG_TIMEOUT_S

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
USER = '''
from typing import Any

import numpy as np

import fraexp
from fraexp.api import Estimator, FrictionModel, Metric, Outcome, Result, Signals, param


class Spring(FrictionModel, name="spring", version=1):
    """A spring."""

    stiffness: float = param("N/m", "stiffness", above=0)
    states = ("force [N]",)

    @staticmethod
    def advance(z: np.ndarray, dy: float, dt: float, z_next: np.ndarray, stiffness: float) -> float:
        z_next[0] = z[0] + stiffness * dy
        return float(z_next[0])


class Peak(Estimator, name="peak", version=1):
    """The largest position."""

    channel: str = param("", "channel of the position", "y")

    def estimate(self, signals: Signals) -> Result:
        peak = max(float(np.abs(segment.channels[self.channel]).max()) for segment in signals.segments)
        return Result(Outcome.OK, metrics=(Metric("peak", peak, signals.unit(self.channel)),))


def analyse(folder: str) -> list[float]:
    workspace = fraexp.Workspace(folder)
    own: dict[str, Any] = {"estimator": Peak(), "friction": Spring(stiffness=1e6)}
    study = fraexp.Study("own", machine="linear_motor_table", excitation="chirp", **own)
    results: fraexp.Run = workspace.run(study, {"excitation.amplitude": 12.0}, executor="serial")
    law: fraexp.FrictionLaw = fraexp.FrictionLaw(Spring(stiffness=1e6))
    stiffness: complex = complex(law.describing_function(1e-6))
    return [abs(stiffness), *(float(np.abs(result.response[0])) for result in results.filter("outcome=ok"))]
'''
"""A user's module, with a plugin of two kinds and a script."""


@pytest.mark.thorough
def test_a_strict_check_of_a_user_s_module_passes(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(USER.replace("np.ndarray", "np.typing.NDArray[np.float64]"), encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", tmp_path / "cache", "own.py"]
    environment = {"MYPYPATH": f"{ROOT}:{ROOT / 'plugins'}", "PATH": ""}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=HANG_TIMEOUT_S
    )
    assert [line for line in (done.stdout + done.stderr).splitlines() if line.startswith("own.py")] == []
    assert "1 source file" in done.stdout


def test_the_citation_is_that_of_this_version() -> None:
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    found = dict(re.findall(r"^([\w-]+): (.+)$", text, re.MULTILINE))
    assert found["cff-version"] == "1.2.0"
    assert (found["title"], found["version"], found["license"]) == ("fraexp", PROJECT["version"], PROJECT["license"])
    assert {"message", "type"} <= found.keys()
    assert "authors:\n  - name:" in text


def test_the_article_cites_what_its_bibliography_has() -> None:
    text = (ROOT / "docs/paper/paper.md").read_text("utf-8")
    known = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "docs/paper/paper.bib").read_text("utf-8"), re.MULTILINE))
    assert set(re.findall(r"@(\w+)", text.partition("---\n\n")[2])) == known
    assert 600 < len(text.split()) < 1200
