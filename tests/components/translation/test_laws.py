"""Friction laws as C and as Structured Text give the forces of the same laws in Python and in the kernels."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from fraexp.components.kinds import FrictionModel
from fraexp.components.local_file import load_file
from fraexp.components.registry import Registry, create
from fraexp.components.translation.blocks import Block
from fraexp.components.translation.c_code import c_text
from fraexp.components.translation.structured_text import st_text
from tests.components.translation.compiled import CompiledBlocks, compile_c, friction_block, needs_gcc
from tests.components.translation.structured_text import Machine

GUIDE = {"curve": {"coulomb_force": 17.9, "characteristic_displacement": 45e-6, "elements": 6}}
DEPENDENCE = {"positions": [0.0, 1e-4], "force_ratios": [1.0, 1.3], "ripples": [{"amplitude": 0.1, "period": 1e-3}]}
LAWS = {
    "rolling": {"name": "rolling", **GUIDE, "viscous_coefficient": 4.69},
    "damped": {"name": "rolling", **GUIDE, "damping": [20.0] * 6},
    "force_slider": {"name": "rolling_force_slider", **GUIDE, "damping": [20.0] * 6},
    "gms": {"name": "gms", "preset": "linear_motor_table"},
    "lugre": {"name": "lugre", "preset": "linear_motor_table"},
    "dahl": {"name": "dahl", "stiffness": 3.9e5, "coulomb_force": 17.9},
    "coulomb": {"name": "coulomb", "coulomb_force": 10, "static_force": 12, "negative_ratio": 1.2},
    "stiction": {"name": "coulomb", "coulomb_force": 10, "static_force": 12, "stiction_displacement": 1e-5},
    "elastoplastic": {"name": "elastoplastic", "preset": "linear_motor_table"},
    "frictionless": {"name": "none", "viscous_coefficient": 3.0},
    "composite": {"name": "composite", "preset": "dahl_and_viscous"},
    "positioned": {"name": "rolling", **GUIDE, "position_dependence": DEPENDENCE},
    "nested": {
        "name": "composite",
        "parts": [{"name": "gms", "preset": "reference"}, {"name": "lugre", "preset": "linear_motor_table"}],
    },
}
TOLERANCE = 1e-12
"""Relative difference of two correct computations of the same law: rounding of libm and of contracted products."""


@pytest.fixture(scope="module")
def models(registry: Registry) -> dict[str, FrictionModel]:
    return {name: create(registry, FrictionModel, spec) for name, spec in LAWS.items()}


@pytest.fixture(scope="module")
def blocks(models: dict[str, FrictionModel]) -> list[Block]:
    return [friction_block(model, name) for name, model in models.items()]


def test_every_built_in_law_is_translated(registry: Registry) -> None:
    assert {spec["name"] for spec in LAWS.values()} == set(registry.names(FrictionModel.kind))


@needs_gcc
def test_compiled_c_passes_its_own_test(tmp_path: Path, blocks: list[Block]) -> None:
    program = compile_c(tmp_path, c_text(blocks, "axis", ["*/ a note */"]), "-Daxis_SELF_TEST")
    done = subprocess.run([program], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("relative error") == len(LAWS)


@pytest.mark.thorough
@needs_gcc
def test_single_precision_passes_its_own_test_within_rounding(tmp_path: Path, blocks: list[Block]) -> None:
    program = compile_c(tmp_path, c_text(blocks, "axis", ["test"], is_single=True), "-Daxis_SELF_TEST")
    done = subprocess.run([program], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stdout


@needs_gcc
def test_the_own_test_notices_a_changed_constant(tmp_path: Path, blocks: list[Block]) -> None:
    source = c_text([block for block in blocks if block.name == "dahl"], "axis", ["test"])
    changed = source.replace("(axis_real)390000.0", "(axis_real)390000.1")
    assert changed != source
    program = compile_c(tmp_path, changed, "-Daxis_SELF_TEST")
    assert subprocess.run([program], capture_output=True, check=False, timeout=60).returncode == 1


@pytest.mark.thorough
def test_structured_text_gives_the_forces_of_the_law(blocks: list[Block]) -> None:
    plc = Machine(st_text(blocks, "axis", ["*) a note (*"]))
    program = plc.create("axis_self_test")
    plc.cycle("axis_self_test", program)
    assert program["is_done"]
    for block in blocks:
        assert program[f"{block.name}_error"] <= TOLERANCE, block.name
        force = program[f"{block.name}_block"]["force"]
        assert force == pytest.approx(block.test_outputs[-1], rel=1e-9)
        assert np.ptp(block.test_outputs) > 0


def test_structured_text_notices_a_changed_constant(blocks: list[Block]) -> None:
    source = st_text([block for block in blocks if block.name == "dahl"], "axis", ["test"])
    plc = Machine(source.replace("stiffness := 390000.0;", "stiffness := 390000.1;"))
    program = plc.create("axis_self_test")
    plc.cycle("axis_self_test", program)
    assert program["dahl_error"] > 1e-9


def long_motion(samples: int, seed: int) -> np.ndarray:
    """Return a displacement [m] that sticks, slides, rests and turns at random, beginning at 0."""
    rng = np.random.default_rng(seed)
    speed = rng.normal(size=samples) * 10.0 ** rng.uniform(-9, -4.5, samples)
    drift = 3e-4 * np.sin(np.arange(samples) * rng.uniform(0.001, 0.01))
    moving = np.repeat(rng.uniform(size=samples // 50 + 1) < 0.9, 50)[:samples]
    displacement = np.cumsum(np.where(moving, speed * 0.3 + np.diff(drift, prepend=0.0), 0.0))
    return displacement - displacement[0]


@needs_gcc
@pytest.mark.thorough
@pytest.mark.parametrize("name", LAWS)
def test_compiled_c_equals_the_kernel_over_a_million_samples(
    tmp_path: Path, models: dict[str, FrictionModel], name: str
) -> None:
    model, samples, time = models[name], 1_000_000, 5e-4
    displacement = long_motion(samples, 3)
    moved = np.diff(displacement, prepend=0.0)
    found = CompiledBlocks(tmp_path, [friction_block(model)]).run(
        "friction", np.column_stack([moved, np.full(samples, time)])
    )
    law_alone = found - model.viscous * moved / time
    expected = model.force(displacement, time)
    assert np.abs(law_alone - expected).max() <= TOLERANCE * np.abs(expected).max() + 1e-15


LOCAL_LAW = '''
"""A law of a user's own, with what the subset has to offer."""

import math

import numpy as np

from fraexp.api import FrictionModel, param

FLOOR = 0.25


def _soft(x, width):
    if x > 5.0 * width or x < -5.0 * width:
        return math.copysign(1.0, x)
    return np.tanh(x / width)


class Own(FrictionModel, name="own", version=1):
    """Two elements and a curve."""

    states = ("force [N]", "deflection [m]")
    stiffness: tuple[float, ...] = param("N/m", "stiffness")
    default: float = param("N", "a reserved word of C")
    K: float = param("N", "differs from k by its case alone")

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, default, K):
        k, σ = stiffness[0], stiffness[-1]
        end = z[1] + dy
        count = 0
        for _ in range(3):
            if end > 1e-5 and k / end > 0.0:
                end -= 1e-7
            elif not (end < -1e-5):
                break
            else:
                end += 1e-7
                continue
            count += 1
        z_next[1] = min(max(end, -2e-5), 2e-5, 3e-5)
        z_next[0] = σ * z_next[count - count - 1] if 0.0 < K <= 9.0 else 0.0
        limit = FLOOR * default + count / 4
        return z_next[0] + k * limit * _soft(dy / dt, 1e-3) / k
'''


@needs_gcc
def test_a_local_law_is_translated_like_a_built_in_one(tmp_path: Path) -> None:
    file = tmp_path / "own.py"
    file.write_text(LOCAL_LAW, encoding="utf-8")
    model = load_file(file).Own(stiffness=(2e5, 1e5), default=4.0, K=9.0)
    block = friction_block(model, samples=300)
    model.check_law()
    assert np.ptp(block.test_outputs) > 1.0
    found = CompiledBlocks(tmp_path, [block]).run("friction", block.test_inputs)
    np.testing.assert_allclose(found, block.test_outputs, rtol=1e-13, atol=1e-13)
    plc = Machine(st_text([block], "axis", ["test"]))
    program = plc.create("axis_self_test")
    plc.cycle("axis_self_test", program)
    assert program["worst_error"] < TOLERANCE
