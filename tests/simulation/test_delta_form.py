"""Exported feedback keeps its digits, in single precision too, where coefficients of z⁻¹ lose them."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from fraexp.components.kinds import Controller
from fraexp.components.registry import Registry, create
from fraexp.components.translation.blocks import Block
from fraexp.components.translation.structured_text import st_text
from fraexp.simulation.controller_blocks import ControllerParts, delta_centres, delta_form
from fraexp.simulation.discretisation import SignalPath
from tests.components.translation.compiled import CompiledBlocks, needs_gcc
from tests.components.translation.structured_text import Machine
from tests.examples import thorough

SAMPLE_TIME_S = 5e-4
PID = {"proportional": 2e5, "derivative_time": 5e-3, "filter_time": 3e-4}
NOTCHES = {"notch_frequencies": [41.0, 120.0], "notch_widths": [0.3, 0.3], "notch_depths": [0.1, 0.2]}
CONTROLLERS: dict[str, dict[str, Any]] = {
    "pid": {"name": "pid", **PID, "integral_time": 0.5},
    "notched": {"name": "notched_pid", **PID, **NOTCHES, "integral_time": 2.0},
    "fast": {"name": "notched_pid", **PID, **NOTCHES, "integral_time": 2.0, "filter_time": 1e-5},
}
LONG = [*CONTROLLERS][:2]
"""Those with which a million samples are computed."""


def feedback(registry: Registry, spec: dict[str, Any]) -> tuple[Block, Controller]:
    controller, path = create(registry, Controller, spec), SignalPath(0.0, ())
    parts = ControllerParts(None, controller, SAMPLE_TIME_S, path, path, force_limit=1e6)
    return next(block for block in parts.blocks() if block.name == "feedback"), controller


def errors(samples: int, seed: int = 24701) -> NDArray[np.float64]:
    """Return position errors [m] that single precision holds exactly: from 0, steps of a second, noise and a sine."""
    draw, k = np.random.default_rng(seed), np.arange(samples)
    steps = np.repeat(draw.normal(size=samples // 2000 + 1), 2000)[:samples]
    error = 1e-6 * (steps + draw.normal(size=samples) + np.sin(0.01 * k))
    error[0] = 0.0
    return error.astype(np.float32).astype(float)


def at_rest(error: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return reference and position of these errors, the reference at rest."""
    return np.column_stack([np.zeros(error.size), -error])


def reference(controller: Controller, error: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the control input by coefficients of z⁻¹ in extended precision, which loses 2000 times less."""
    numerator, denominator = controller.transfer_function(SAMPLE_TIME_S)
    parts = [part.astype(np.longdouble) for part in (numerator, denominator, error)]
    return np.asarray(lfilter(*parts), dtype=float)


@needs_gcc
@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision here")
@pytest.mark.parametrize("name", [LONG[0], thorough(LONG[1])])
@pytest.mark.parametrize(("is_single", "tolerance"), [(True, 1e-6), (False, 1e-12)])
def test_c_keeps_its_digits_over_a_million_samples(
    tmp_path: Path, registry: Registry, name: str, is_single: bool, tolerance: float
) -> None:
    block, controller = feedback(registry, CONTROLLERS[name])
    error = errors(1_000_000)
    expected = reference(controller, error)
    found = CompiledBlocks(tmp_path, [block], is_single).run("feedback", at_rest(error))
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


@pytest.mark.parametrize("name", ["notched", "fast"])
def test_structured_text_in_single_precision_keeps_its_digits(registry: Registry, name: str) -> None:
    block, _ = feedback(registry, CONTROLLERS[name])
    error = errors(600)
    expected = block.run(at_rest(error))
    plc = Machine(st_text([block], "axis", ["test"], is_single=True))
    instance = plc.create("FB_axis_feedback")
    found = np.array([plc.cycle("FB_axis_feedback", instance, position=-one)["control"] for one in error.tolist()])
    assert 0 < np.abs(found - expected).max() <= 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("numerator", [[2.0], [1.0, -2.0, 0.5], [0.3, 0.2, 0.1, 0.4, -0.7]])
@pytest.mark.parametrize("denominator", [[1.0], [1.0, -1.0], [1.0, 0.9], [1.0, -1.7, 0.72, 0.1]])
def test_it_is_the_same_transfer_function(numerator: list[float], denominator: list[float]) -> None:
    parts = [np.array(numerator), np.array(denominator)]
    z = np.exp(2j * np.pi * np.linspace(0.01, 0.49, 7))
    expected = np.divide(*(np.polyval(part[::-1], 1 / z) for part in parts))
    size = max(len(numerator), len(denominator))
    centres = delta_centres(parts[1], size)
    found = [delta_form([*map(Fraction, part), *[Fraction(0)] * (size - len(part))], centres) for part in parts]
    centres = np.concatenate([[0.0], centres])
    products = np.cumprod([1 / (z - centre) if k else z**0 for k, centre in enumerate(centres)], axis=0)
    assert np.divide(*(part @ products for part in found)) == pytest.approx(expected, rel=1e-12)
