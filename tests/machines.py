"""Components and experiments that several tests use."""

import numpy as np
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.friction.frictionless import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.modal import Modal

from fraexp.components import Controller, FrictionModel, Plant
from fraexp.signals import Signals
from fraexp.simulation import Loop, Machine, Numerics, simulate_loop

TABLE = Modal(gain=0.132, frequencies=(38.8, 80.0), damping_ratios=(0.04, 0.02), residues=(0.342, 0.3))
LEAD = Pid(proportional=6052.9, derivative_time=0.0566, filter_time=0.00629)
FRICTIONLESS = Frictionless()


def guide(coulomb: float = 17.9, width: float = 46.8e-6, viscous: float = 4.69, elements: int = 20) -> Rolling:
    """Return rolling friction with an exponential virgin curve: force [N], width [m], viscous coefficient [N s/m]."""
    knots = np.geomspace(0.01 * width, 2.2 * width, elements)
    curve = coulomb * (1 - np.exp(-knots / width)) / (1 - np.exp(-2.2))
    slopes = np.diff(curve, prepend=0.0) / np.diff(knots, prepend=0.0)
    stiffness = slopes - np.append(slopes[1:], 0.0)
    return Rolling(stiffness=tuple(stiffness), limit_force=tuple(stiffness * knots), viscous_coefficient=viscous)


def simulated(
    friction: FrictionModel,
    frequencies: tuple[float, ...],
    amplitude: float = 12.0,
    *,
    plant: Plant = TABLE,
    controller: Controller = LEAD,
    steps: int = 5,
    tolerance: float = 1e-5,
    **loop: object,
) -> Signals:
    """Return the signals of a stepped sine at `frequencies` [Hz] in a loop; its dead time is 1 ms by default."""
    settings = {"sample_time": 500e-6, "input_dead_time": 1e-3, **loop}
    machine = Machine(plant, friction, controller, Loop.parse(settings, "loop"), Numerics(steps_per_sample=steps))
    excitation = SteppedSine(amplitude=amplitude, frequencies=frequencies, tolerance=tolerance)
    return simulate_loop(machine, excitation, lambda _: None)


def decibel(ratio: np.ndarray) -> np.ndarray:
    """Return 20 log10 of the magnitude."""
    return 20 * np.log10(np.abs(ratio))


def degrees(ratio: np.ndarray) -> np.ndarray:
    """Return the phase in degrees."""
    return np.angle(ratio, deg=True)
