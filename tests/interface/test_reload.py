"""Plugins that are written or edited in a session count in its next run."""

from pathlib import Path

import numpy as np
import pytest

import fraexp
from fraexp.components.registry import LOCAL, Registry, discover
from fraexp.execution.job import job_registry
from fraexp.execution.sent_jobs import Job
from tests.examples import thorough
from tests.refusals import refused

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


def peak_force(workspace: fraexp.Workspace, name: str, amplitude: float, executor: str = "serial") -> float:
    """Return the greatest friction force along a sine of an amplitude [m] that a stored run shows [N]."""
    study = fraexp.Study(
        "driven",
        friction={"name": name, "stiffness": 4e5},
        loop={"sample_time": 5e-4},
        excitation={"name": "displacement_sine", "amplitude": amplitude, "frequency": 1.0},
        estimator="hysteresis",
    )
    run = workspace.run(study, executor=executor, progress=False)
    assert not run.missing
    return run[0].metrics["peak force"]


@pytest.fixture
def plugins(tmp_path: Path) -> Path:
    folder = tmp_path / "plugins"
    folder.mkdir()
    return folder


def write_law(folder: Path, name: str, limit: float) -> None:
    (folder / f"{name}.py").write_text(LAW.format(name=name, limit=limit))


@pytest.mark.parametrize("executor", ["serial", thorough("processes:1")])
def test_an_edited_law_is_computed_as_it_is_now(plugins: Path, executor: str) -> None:
    workspace = fraexp.Workspace(plugins.parent)
    for name, limit, amplitude in (("slider", 15.0, SPAN), ("slider", 5.0, 2 * SPAN)):
        write_law(plugins, name, limit)
        assert peak_force(workspace, name, amplitude, executor) == pytest.approx(limit)
    stored = [run[0].sweep.sources.values() for run in workspace.runs()]
    assert len({of.source_hash for sources in stored for of in sources if of.distribution == LOCAL}) == 2


def test_a_called_law_is_that_of_its_file_when_it_was_made(plugins: Path) -> None:
    workspace, motion = fraexp.Workspace(plugins.parent), SPAN * np.sin(np.linspace(0, 6, 50))
    write_law(plugins, "slider", 15.0)
    before = workspace.friction_law("slider", stiffness=4e5)
    write_law(plugins, "slider", 5.0)
    after = workspace.friction_law("slider", stiffness=4e5)
    assert np.max(before.force(motion)) == pytest.approx(15.0)
    assert np.max(after.force(motion)) == pytest.approx(5.0)


def test_broken_plugins_are_reported_in_one_line_each(plugins: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (plugins / "first.py").write_text("def x(:\n")
    (plugins / "second.py").write_text("import nothing_of_that_name\n")
    workspace = fraexp.Workspace(plugins.parent)
    workspace.components()
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 2
    assert "first.py is broken: SyntaxError" in lines[0]
    assert "second.py is broken: ModuleNotFoundError" in lines[1]
    fraexp.Workspace(plugins.parent).components()  # what has been said is not said again
    assert not capfd.readouterr().err
    (plugins / "first.py").unlink()
    workspace.reload()
    assert capfd.readouterr().err.splitlines() == lines[1:]


def test_a_worker_refuses_a_law_that_was_edited_after_the_run_had_read_it(plugins: Path) -> None:
    def job() -> Job:
        registry = discover(plugins)
        return Job({}, (), plugins=str(plugins), sources={"friction:slider": source_hash(registry)})

    def source_hash(registry: Registry) -> str:
        return registry.provider("friction", "slider").source_hash

    write_law(plugins, "slider", 15.0)
    first = job()
    assert source_hash(job_registry(first)) == first.sources["friction:slider"]
    write_law(plugins, "slider", 5.0)
    second = job()
    assert source_hash(job_registry(second)) == second.sources["friction:slider"]
    with refused(fraexp.FraexpError, "'slider'"):
        job_registry(first)
    (plugins / "slider.py").unlink()
    with refused(fraexp.FraexpError, "'slider'"):
        job_registry(first)
