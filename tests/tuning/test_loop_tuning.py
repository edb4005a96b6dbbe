"""Tuned gains keep their promise for drawn plants, and go from a response to code."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.tuning.loop_tuning import _LoopPath

from fraexp.cli.main import main
from fraexp.components.kinds import Controller, Estimator, Plant
from fraexp.components.registry import Registry, create
from fraexp.data.results import Metric
from fraexp.errors import ParameterError, RecordError
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import build_machine
from fraexp.workspace.controller_export import controller_parts
from fraexp.workspace.workspace_service import WorkspaceService
from tests.refusals import refused
from tests.tuning.drawn_loops import MACHINES, TunedMachine, spectral_radii, tune, unstable_loops

pytestmark = pytest.mark.thorough  # each tuning takes seconds; margins and limit cycles are tested beside it


@pytest.fixture(scope="module")
def tuned(registry: Registry) -> TunedMachine:
    return tune(registry, "linear_motor_table", noise=3e-6, model_error=0.02)


def metric(tuned: TunedMachine, name: str) -> float:
    return next(each.value for each in tuned.result.metrics if each.name == name)


def test_tuned_gains_keep_the_margins_and_are_stiffer(tuned: TunedMachine) -> None:
    assert metric(tuned, "modulus margin") >= 0.5
    assert metric(tuned, "gain margin") >= 2.0
    assert metric(tuned, "phase margin") >= 30.0
    assert metric(tuned, "given modulus margin") < 0.5
    assert tuned.controller.model_dump()["proportional"] > 3 * tuned.given.model_dump()["proportional"]
    assert metric(tuned, "mass feedforward") == pytest.approx(1 / 0.132, rel=0.02)
    names = [curve.name for curve in tuned.result.curves]
    assert names[:4] == ["given loop", "given loop", "tuned loop", "tuned loop"]


@pytest.mark.parametrize(("draws", "seed"), [(1000, 2), (100, 1)])
def test_no_plant_drawn_in_the_band_is_unstable(tuned: TunedMachine, draws: int, seed: int) -> None:
    count, worst = unstable_loops(tuned, tuned.controller, draws, seed)
    assert (count, worst < 1.0) == (0, True)


def test_eigenvalues_notice_more_gain_than_the_margin_allows(tuned: TunedMachine, registry: Registry) -> None:
    values = tuned.controller.spec()
    fast = create(registry, Controller, {**values, "proportional": 8 * values["proportional"]})
    count, _ = unstable_loops(tuned, fast, 50)
    assert count > 25
    fit = next(fit for fit in tuned.result.fits if fit.kind == "plant")
    plant = create(registry, Plant, fit.component)
    rise = 0.99 * metric(tuned, "gain margin")
    within = create(registry, Controller, {**values, "proportional": rise * values["proportional"]})
    assert spectral_radii(tuned, within, [plant], np.array([[1.0, 0.0, 4.69]]))[0] < 1.0


def test_what_no_controller_can_keep_is_refused(registry: Registry) -> None:
    with refused(RecordError, "modulus margin", 0.5, "band"):
        tune(registry, "linear_motor_table", 1e-7, 0.5)
    with refused(ParameterError, "max_amplitude", "10 nm", "min_amplitude"):
        tune(registry, "linear_motor_table", 1e-7, 0.02, max_amplitude=1e-8)


def test_a_record_is_tuned_with_the_delays_and_the_friction_that_its_method_knows(registry: Registry) -> None:
    """Without them a dead time of 1 ms was taken for none, and the gains were unstable on the machine."""
    sections = tomllib.loads((MACHINES / "linear_motor_table.toml").read_text("utf-8"))
    experiment: dict[str, Any] = {name: sections[name] for name in ("plant", "friction", "controller", "loop")}
    experiment["loop"] = {**experiment["loop"], "input_dead_time": 1e-3, "output_time_constants": [1e-4]}
    experiment["numerics"] = {}
    machine = build_machine(experiment, registry)
    excitation = SteppedSine(amplitude=40.0, points=20, min_frequency=8.0)
    signals = simulate_loop(machine, excitation, lambda _: None)
    observer = {"name": "effective_input"}
    known = registry.create(Estimator.kind, observer, experiment).spec()
    found = []
    for method, environment in ((observer, experiment), (known, {})):
        fit = {"name": "modal_fit", "modes": 2, "method": method}
        spec = {"name": "loop_tuning", "method": fit, "controller": experiment["controller"]}
        estimator: Any = registry.create(Estimator.kind, spec, environment)
        result = estimator.estimate(signals)
        found.append({each.name: each.value for each in result.metrics})
        found[-1] |= next(fit.component for fit in result.fits if fit.kind == Controller.kind)
    assert found[0] == found[1]
    assert (found[0]["loop dead time"], found[0]["loop sample time"]) == pytest.approx((1e-3, 5e-4), rel=0.01)
    lagging = replace(result, metrics=(*result.metrics, Metric("input_time_constant", 4e-4, "s")))
    path = _LoopPath.of_loop(estimator, signals, lagging, result.fits[0])
    assert (path.input_time_constants, path.output_time_constants) == ((4e-4,), (1e-4,))


STUDY = """
title = "From a response to gains"
machine = "linear_motor_table"
excitation = { name = "stepped_sine", amplitude = 40, points = 30, min_frequency = 8 }
estimator = { name = "loop_tuning", method = { name = "modal_fit", modes = 2, method = { name = "effective_input" } } }
"""
MOVE = """
title = "The machine with the gains"
machine = "linear_motor_table"
excitation = { name = "point_to_point", targets = [1.5e-3], duration = 0.04, dwell_time = 0.16 }
estimator = { name = "positioning_metrics" }
[controller]
"""


def test_gains_go_from_a_response_to_a_study_and_to_code(
    tmp_path: Path, checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "machines").symlink_to(checkout / "studies" / "machines")
    (tmp_path / "studies" / "gains.toml").write_text(STUDY, "utf-8")
    at = ["--workspace", str(tmp_path)]
    assert main([*at, "run", "gains", "--executor", "serial"]) == 0
    workspace = WorkspaceService.open(tmp_path, None)
    with workspace.open_store() as store:
        (sweep,) = store.sweeps(1)
        result = store.result(sweep.key)
    component = next(fit.component for fit in result.fits if fit.kind == "controller")
    lines = [f"{key} = {json.dumps(value)}" for key, value in component.items()]
    (tmp_path / "studies" / "move.toml").write_text(MOVE + "\n".join(lines), "utf-8")
    assert main([*at, "run", "move", "--executor", "serial"]) == 0
    with workspace.open_store() as store:
        (moved,) = store.sweeps(2)
        metrics = {each.name: each.value for each in store.result(moved.key).metrics}
    assert abs(metrics["overshoot"]) < 4e-6
    parts = controller_parts(sweep, result, workspace.registry)
    assert parts.controller is not None
    assert parts.controller.name == "notched_pid"
    assert [block.name for block in parts.blocks()] == ["friction", "observer", "smith_delay", "feedback", "tracking"]
    key = sweep.key[4:12]
    capsys.readouterr()
    assert main([*at, "tune", key, "--set", "integral_action=false"]) == 0
    assert "modulus margin" in capsys.readouterr().out
    assert main([*at, "plot", key, "--kind", "curves", "-o", str(tmp_path / "loops.png")]) == 0
    assert main([*at, "export", key, "-o", str(tmp_path / "axis.st")]) == 0
    assert "FB_axis_feedback" in (tmp_path / "axis.st").read_text("utf-8")
