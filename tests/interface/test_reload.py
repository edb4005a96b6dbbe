"""Plugins that are written or edited in a session count in its next run."""

from pathlib import Path

import pytest

import fraexp

LAW = """
from fraexp.api import FrictionModel, param

class Slider(FrictionModel, name="{name}", version=1):
    '''A spring that slides at {limit} N.'''

    states = ("force [N]",)
    stiffness: float = param("N/m", "stiffness", above=0)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness):
        z_next[0] = min(max(z[0] + stiffness * dy, -{limit}), {limit})
        return z_next[0]
"""
SPAN = 2e-4
"""Amplitude [m], many times the displacement at which the spring slides."""


def peak_force(workspace: fraexp.Workspace, name: str, amplitude: float) -> float:
    """Return the greatest friction force along a sine of an amplitude [m] that a stored run shows [N]."""
    study = fraexp.Study(
        "driven",
        friction={"name": name, "stiffness": 4e5},
        loop={"sample_time": 5e-4},
        excitation={"name": "displacement_sine", "amplitude": amplitude, "frequency": 1.0},
        estimator="hysteresis",
    )
    run = workspace.run(study, executor="serial", progress=False)
    assert not run.missing
    return run[0].metrics["peak force"]


def test_an_edited_or_new_law_is_computed_as_it_is_now(tmp_path: Path) -> None:
    (tmp_path / "plugins").mkdir()
    workspace = fraexp.Workspace(tmp_path)

    def write(name: str, limit: float) -> None:
        (tmp_path / "plugins" / f"{name}.py").write_text(LAW.format(name=name, limit=limit))
        workspace.reload()

    write("slider", 15.0)
    assert peak_force(workspace, "slider", SPAN) == pytest.approx(15.0)
    write("slider", 5.0)
    assert peak_force(workspace, "slider", 2 * SPAN) == pytest.approx(5.0)
    write("another", 7.0)
    assert peak_force(workspace, "another", SPAN) == pytest.approx(7.0)
