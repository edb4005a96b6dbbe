"""Fig 8 with integral action, against a simulation that shares no code with fraexp's loop, controller and friction."""

import tomllib
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.positioning.point_to_point import PointToPoint
from numpy.typing import NDArray

from fraexp.components.kinds import Excitation
from fraexp.components.registry import create, discover
from fraexp.execution.job import run_job
from fraexp.execution.sent_jobs import Job
from fraexp.study.study_file import packaged_studies

MACHINE = tomllib.loads((packaged_studies() / "machines" / "linear_motor_table_integral.toml").read_text("utf-8"))
STEPS_PER_SAMPLE = 100
"""Explicit steps: 5 µs is short beside the period of the table on its friction, 0.6 ms."""
DEAD_SAMPLES = 2


def elements(curve: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stiffness and breakaway displacement of the elements of an exponential virgin curve (eqs 6 to 11)."""
    knots = np.geomspace(curve["min_knot"], curve["max_knot"], curve["elements"])
    force = 1 - np.exp(-knots / curve["characteristic_displacement"])
    slopes = np.diff(curve["coulomb_force"] * force / force[-1], prepend=0.0) / np.diff(knots, prepend=0.0)
    return slopes - np.append(slopes[1:], 0.0), knots


def feedback(error: float, state: list[float], settings: dict[str, float], sample_time: float) -> float:
    """Return Kp (1 + 1/(Ti s) + Td s/(Tf s + 1)) of the error by the trapezoidal rule."""
    before, integral, slope = state
    integral += sample_time * (error + before) / 2
    filter_time = settings["filter_time"]
    slope = (2 * (error - before) + (2 * filter_time - sample_time) * slope) / (2 * filter_time + sample_time)
    state[:] = [error, integral, slope]
    return settings["proportional"] * (
        error + integral / settings["integral_time"] + settings["derivative_time"] * slope
    )


def simulated(thrust: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the measured position [m] at each sample, by semi-implicit Euler."""
    plant, loop, friction = MACHINE["plant"], MACHINE["loop"], MACHINE["friction"]
    omega = 2 * np.pi * np.array([0.0, *plant["frequencies"]])
    damping = 2 * np.array([0.0, *plant["damping_ratios"]]) * omega
    gain = plant["rigid_body_gain"] * np.array([1.0, *plant["modal_gain_ratios"]])
    stiffness, widths = elements(friction["curve"])
    step = loop["sample_time"] / STEPS_PER_SAMPLE
    q, speed, stretch = np.zeros(3), np.zeros(3), np.zeros(widths.size)
    held, state, measured = [0.0] * DEAD_SAMPLES, [0.0, 0.0, 0.0], np.zeros(thrust.size)
    y = 0.0
    for k in range(thrust.size):
        measured[k] = loop["resolution"] * np.round(y / loop["resolution"])
        held.append(thrust[k] + feedback(reference[k] - measured[k], state, MACHINE["controller"], loop["sample_time"]))
        force = held.pop(0)
        for _ in range(STEPS_PER_SAMPLE):
            driving = force - stiffness @ stretch - friction["viscous_coefficient"] * (gain @ speed)
            speed += step * (driving - damping * speed - omega**2 * q)
            q += step * speed
            moved = gain @ q - y
            y += moved
            stretch = np.clip(stretch + moved, -widths, widths)
    return measured


@pytest.mark.parametrize(("k0", "f1"), [(0.132, 38.8), (0.177, 41.9)])
def test_the_move_is_that_of_an_independent_simulation(k0: float, f1: float) -> None:
    registry = discover()
    design = {**MACHINE["plant"], "rigid_body_gain": k0, "frequencies": [f1, 80.0]}
    motion = {"name": "point_to_point", "targets": [1.5e-3], "duration": 0.04, "dwell_time": 0.16, "plant": design}
    motion |= {"friction": MACHINE["friction"], "input_dead_time": 1e-3}
    excitation = create(registry, Excitation, motion)
    assert isinstance(excitation, PointToPoint)
    sections = {key: MACHINE[key] for key in ("plant", "friction", "controller", "loop")}
    experiment = {"source": "loop", **sections, "numerics": {}, "excitation": excitation.spec()}
    (answer,) = run_job(Job(experiment, ({"name": "positioning_metrics"},)), lambda _: None)
    position = answer.curves[0].columns["position"]
    (period,) = excitation.periods(MACHINE["loop"]["sample_time"])
    expected = simulated(period.waveform, period.reference)
    np.testing.assert_allclose(position, expected, rtol=0, atol=2.01 * MACHINE["loop"]["resolution"])
    assert abs(position[-1] - 1.5e-3) < 4e-6  # either move ends in the window
