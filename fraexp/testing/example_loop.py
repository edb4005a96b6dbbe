"""A small machine around the component under test, as plain data of installed components."""

import math
from collections.abc import Mapping
from typing import Any

from fraexp.components.kinds import Controller, Excitation, FrictionModel, Plant
from fraexp.components.registry import create
from fraexp.data.signals import Signals
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from fraexp.testing.examples import installed_components

SAMPLE_TIME_S = 500e-6
"""Sample time [s]."""
CROSSOVER_HZ = 8.0
"""Crossover of the loop [Hz]."""
STEPS = 10
"""Steps per sample."""
FREQUENCIES = (5.0, 23.0, 61.0)
"""Frequencies [Hz] at which a response is compared."""


def experiment(mass: float, amplitude: float, friction: Mapping[str, object]) -> dict[str, Any]:
    """Return a free mass [kg] with a lead controller, excited by `amplitude` [N], as a study has it."""
    omega = 2 * math.pi * CROSSOVER_HZ
    return {
        "plant": {"name": "modal", "rigid_body_gain": 1 / mass},
        "friction": friction,
        "controller": {
            "name": "pid", "proportional": mass * omega**2 / 4,
            "derivative_time": 3 / omega, "filter_time": 0.3 / omega,
        },
        "excitation": {
            "name": "stepped_sine", "amplitude": amplitude, "frequencies": FREQUENCIES, "settling_timeout": 5.0,
        },
        "loop": {"sample_time": SAMPLE_TIME_S, "divergence_limit": 1.0},
    }  # fmt: skip


def simulate_experiment(parts: Mapping[str, Any], friction: FrictionModel) -> Signals:
    """Return the signals of such an experiment with this friction."""
    machine = Machine(
        plant=create(installed_components(), Plant, parts["plant"]),
        friction=friction,
        controller=create(installed_components(), Controller, parts["controller"]),
        loop=ControlLoop.parse(parts["loop"], "loop"),
        numerics=Numerics(steps_per_sample=STEPS),
    )
    excitation = create(installed_components(), Excitation, parts["excitation"])
    return simulate_loop(machine, excitation, lambda _: None)
