"""A small machine around the component under test, as plain data of installed components."""

from collections.abc import Mapping
from typing import Any

from fraexp.components.kinds import Controller, Excitation, FrictionModel, Plant
from fraexp.components.registry import create
from fraexp.data.signals import Signals
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from fraexp.testing.examples import installed

SAMPLE_TIME = 500e-6
"""Sample time [s]."""
CROSSOVER = 8.0
"""Crossover of the loop [Hz]."""
STEPS = 10
"""Steps per sample."""
FREQUENCIES = (5.0, 23.0, 61.0)
"""Frequencies [Hz] at which a response is compared."""


def experiment(mass: float, amplitude: float, friction: Mapping[str, Any]) -> dict[str, Any]:
    """Return a free mass [kg] with a lead controller, excited by `amplitude` [N], as a study has it."""
    omega = 2 * 3.141592653589793 * CROSSOVER
    return {
        "plant": {"name": "modal", "gain": 1 / mass},
        "friction": friction,
        "controller": {
            "name": "pid", "proportional": mass * omega**2 / 4,
            "derivative_time": 3 / omega, "filter_time": 0.3 / omega,
        },
        "excitation": {"name": "stepped_sine", "amplitude": amplitude, "frequencies": FREQUENCIES, "settle_limit": 5.0},
        "loop": {"sample_time": SAMPLE_TIME, "stroke": 1.0},
    }  # fmt: skip


def simulated(parts: Mapping[str, Any], friction: FrictionModel) -> Signals:
    """Return the signals of such an experiment with this friction."""
    machine = Machine(
        plant=create(installed(), Plant, parts["plant"]),  # type: ignore[type-abstract]
        friction=friction,
        controller=create(installed(), Controller, parts["controller"]),  # type: ignore[type-abstract]
        loop=ControlLoop.parse(parts["loop"], "loop"),
        numerics=Numerics(steps_per_sample=STEPS),
    )
    excitation = create(installed(), Excitation, parts["excitation"])  # type: ignore[type-abstract]
    return simulate_loop(machine, excitation, lambda _: None)
