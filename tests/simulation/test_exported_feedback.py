"""Exported feedback on a machine: within its limit, without a kick at steps, and without windup."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from fraexp.components.kinds import Controller
from fraexp.components.registry import Registry, create
from fraexp.components.translation.blocks import Block
from fraexp.components.translation.c_code import c_text
from fraexp.components.translation.structured_text import st_text
from fraexp.simulation.controller_blocks import ControllerParts
from fraexp.simulation.discretisation import SignalPath
from tests.components.translation.compiled import CompiledBlocks, compile_c, needs_gcc
from tests.components.translation.structured_text import Machine

MACHINES = Path(__file__).parents[3] / "shared" / "machines"
SAMPLE_TIME_S, LIMIT_N, MASS_KG, STEP_M = 5e-4, 180.0, 8.0, 1e-3
PID = {"proportional": 31582.7, "derivative_time": 0.02228, "filter_time": 0.002, "integral_time": 0.1}
NOTCH = {"notch_frequencies": [53.29], "notch_widths": [0.5], "notch_depths": [0.2]}
CONTROLLERS: dict[str, dict[str, Any]] = {
    "pid": {"name": "pid", **PID},
    "lead": {"name": "pid", **PID, "integral_time": 0.0},
    "stiff": {"name": "pid", "proportional": 126330.8, "derivative_time": 0.012, "filter_time": 6e-4},
    "notched": {"name": "notched_pid", **PID, **NOTCH},
    "general": {"name": "transfer_function", "numerator": [387500.0, -384000.0], "denominator": [1.0, -0.7778]},
}


def block_of(registry: Registry, spec: dict[str, Any], name: str = "feedback", limit: float | None = LIMIT_N) -> Block:
    path = SignalPath(0.0, ())
    parts = ControllerParts(None, create(registry, Controller, spec), SAMPLE_TIME_S, path, path, force_limit=limit)
    return next(block for block in parts.blocks() if block.name == name)


def move_mass(block: Block, reference: NDArray[np.float64], load: float = 0.0) -> tuple[NDArray[np.float64], ...]:
    """Return position [m] and control input [N] of a rigid mass with a sample of dead time, which fraexp does not run.

    A held force moves it exactly as F Ts²/(2 m); `load` [N] pushes it all the time.
    """
    states = {name: np.zeros(size) for name, size in block.states.items()}
    settings = {one.name: one.test_value for one in block.settings}
    found, position, velocity, force = [], 0.0, 0.0, 0.0
    for target in reference.tolist():
        control = block.function(**states, setpoint=target, position=position, **settings, **block.constants)
        found.append((position, control))
        acceleration = (force + load) / MASS_KG
        position += velocity * SAMPLE_TIME_S + 0.5 * acceleration * SAMPLE_TIME_S**2
        velocity, force = velocity + acceleration * SAMPLE_TIME_S, control
    return tuple(np.array(found).T)


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("step", [STEP_M, 1e-2])
def test_a_step_stays_within_the_limit_and_overshoots_moderately(registry: Registry, name: str, step: float) -> None:
    position, control = move_mass(block_of(registry, CONTROLLERS[name]), np.full(4000, step))
    assert np.abs(control).max() <= LIMIT_N
    assert position.max() <= 1.3 * step
    assert np.abs(position[-200:] - step).max() <= 0.01 * step


@pytest.mark.parametrize("name", CONTROLLERS)
def test_it_recovers_at_once_from_two_seconds_at_the_limit(registry: Registry, name: str) -> None:
    """The axis is held off its setpoint, the control input stands at its limit, then the setpoint returns."""
    block = block_of(registry, CONTROLLERS[name])
    states = {state: np.zeros(size) for state, size in block.states.items()}
    settings = {one.name: one.test_value for one in block.settings}
    for _ in range(4000):
        control = block.function(**states, setpoint=0.02, position=0.0, **settings, **block.constants)
    assert control == LIMIT_N
    after = [block.function(**states, setpoint=-0.001, position=0.0, **settings, **block.constants) for _ in range(40)]
    assert min(after) < 0.0, "the integral holds the axis against its reference"


@pytest.mark.parametrize("name", CONTROLLERS)
def test_at_rest_and_on_smooth_motion_it_is_the_controller_of_the_simulation(registry: Registry, name: str) -> None:
    numerator, denominator = create(registry, Controller, CONTROLLERS[name]).transfer_function(SAMPLE_TIME_S)
    k = np.arange(2000)
    position, smooth = 1e-5 * np.sin(0.05 * k), 1e-5 * np.sin(0.04 * k)
    for block, reference in (("feedback", np.zeros(k.size)), ("tracking", smooth)):
        found = block_of(registry, CONTROLLERS[name], block).run(np.column_stack([reference, position]))
        expected = lfilter(numerator, denominator, reference - position)
        assert np.abs(expected).max() < LIMIT_N
        assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()


def test_an_axis_that_rests_elsewhere_is_not_kicked_at_the_first_sample(registry: Registry) -> None:
    block = block_of(registry, CONTROLLERS["lead"])
    (control,) = block.run(np.array([[0.3, 0.299]]))
    assert control == pytest.approx(PID["proportional"] * 1e-3)


@needs_gcc
def test_an_unknown_limit_has_to_be_stated(tmp_path: Path, registry: Registry) -> None:
    source = c_text([block_of(registry, CONTROLLERS["pid"], limit=None)], "axis", ["test"])
    (tmp_path / "axis.c").write_text(source, "utf-8")
    command = ["gcc", "-fsyntax-only", str(tmp_path / "axis.c")]
    refused = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert refused.returncode != 0
    assert "greatest control input of the drive [N] is not known: state it" in refused.stderr
    compile_c(tmp_path, source + "int main(void) { return 0; }", "-Daxis_FORCE_LIMIT=180")
    (tmp_path / "test").mkdir()
    subprocess.run([compile_c(tmp_path / "test", source, "-Daxis_SELF_TEST")], check=True, timeout=60)


def test_structured_text_has_the_limit_as_an_input_that_is_0_until_it_is_stated(registry: Registry) -> None:
    for limit, expected in ((LIMIT_N, LIMIT_N), (None, 0.0)):
        plc = Machine(st_text([block_of(registry, CONTROLLERS["pid"], limit=limit)], "axis", ["test"]))
        instance = plc.create("FB_axis_feedback")
        assert plc.cycle("FB_axis_feedback", instance, setpoint=1.0)["control"] == expected
        assert plc.cycle("FB_axis_feedback", instance, position=np.nan)["control"] == 0.0
        instance["position"] = 0.0
        assert plc.cycle("FB_axis_feedback", instance, force_limit=50.0)["control"] == 50.0


@needs_gcc
def test_c_agrees_with_plain_python_at_the_limit(tmp_path: Path, registry: Registry) -> None:
    block = block_of(registry, CONTROLLERS["notched"])
    k = np.arange(3000)
    rows = np.column_stack([np.where(k % 1000 < 500, 5e-3, -5e-3), 1e-3 * np.sin(0.01 * k)])
    expected = block.run(rows)
    lost = np.insert(rows, [100, 2000], [[np.nan, 0.0], [0.0, -np.inf]], axis=0)
    assert np.array_equal(block.run(lost), np.insert(expected, [100, 2000], 0.0))
    rows, expected = lost, block.run(lost)
    assert np.mean(np.abs(expected) == LIMIT_N) > 0.05
    assert np.abs(CompiledBlocks(tmp_path, [block]).run("feedback", rows) - expected).max() <= 1e-12 * LIMIT_N


@needs_gcc
@pytest.mark.skipif(not MACHINES.is_dir(), reason="the machines that others wrote are not here")
@pytest.mark.parametrize(("name", "overshoot"), [("pid", 0.05), ("stiff", 0.0), ("notched", 0.05)])
def test_a_strangers_axis_makes_a_step_of_a_millimetre(
    tmp_path: Path, registry: Registry, name: str, overshoot: float
) -> None:
    (tmp_path / "x.c").write_text(c_text([block_of(registry, CONTROLLERS[name])], "x", ["test"]), "utf-8")
    loop = tmp_path / "loop"
    command = ["gcc", "-O2", "-w", '-DCTRL="x.c"', "-DNAME=x", "-DRY", f"-I{tmp_path}", f"-I{MACHINES}"]
    subprocess.run([*command, str(MACHINES / "loop.c"), "-o", str(loop), "-lm"], check=True, timeout=120)
    run = [str(loop), str(MACHINES / "a_linmot.cfg"), "1", str(STEP_M)]
    words = subprocess.run(run, capture_output=True, text=True, check=True, timeout=120).stdout.split()
    assert float(words[words.index("peakF") + 1]) <= LIMIT_N
    assert float(words[words.index("overshoot") + 1]) <= 100 * overshoot
