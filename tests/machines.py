"""Components and experiments that several tests use."""

import itertools
from typing import Any

import numpy as np
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.modal import Modal

from fraexp.components.kinds import Controller, Excitation, FrictionModel, Plant
from fraexp.components.registry import Registry, create
from fraexp.data.signals import Signals
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics

TABLE = Modal(
    rigid_body_gain=0.132, frequencies=(38.8, 80.0), damping_ratios=(0.04, 0.02), modal_gain_ratios=(0.342, 0.3)
)
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
    excitation = SteppedSine(amplitude=amplitude, frequencies=frequencies, settling_tolerance=tolerance)
    return excited(excitation, friction, plant=plant, controller=controller, steps=steps, **loop)


def excited(
    excitation: Excitation,
    friction: FrictionModel,
    *,
    plant: Plant = TABLE,
    controller: Controller = LEAD,
    steps: int = 0,
    **loop: object,
) -> Signals:
    """Return the signals of an excitation in a loop; its dead time is 1 ms by default."""
    settings = ControlLoop.parse({"sample_time": 500e-6, "input_dead_time": 1e-3, **loop}, "loop")
    machine = Machine(plant, friction, controller, settings, Numerics(steps_per_sample=steps))
    return simulate_loop(machine, excitation, lambda _: None)


def decibel(ratio: np.ndarray) -> np.ndarray:
    """Return 20 log10 of the magnitude."""
    return 20 * np.log10(np.abs(ratio))


def degrees(ratio: np.ndarray) -> np.ndarray:
    """Return the phase in degrees."""
    return np.angle(ratio, deg=True)


def table_models(registry: Registry) -> dict[str, FrictionModel]:
    """Return every kind of friction with parameters of the same guide: 17.9 N, about 4e5 N/m at rest."""
    like_rolling = {"stiffness": guide().stiffness, "limit_force": guide().limit_force, "viscous_coefficient": 4.69}
    preset = {"preset": "linear_motor_table"}
    specs: dict[str, dict[str, Any]] = {
        "rolling": like_rolling,
        "gms": preset,
        "elastoplastic": preset,
        "lugre": preset,
        "dahl": {"stiffness": 3.9e5, "coulomb_force": 17.9, "viscous_coefficient": 4.69},
        "coulomb": {"coulomb_force": 17.9, "static_force": 22.0, "viscous_coefficient": 4.69},
        "rolling_force_slider": like_rolling,
        "composite": {"parts": [{"name": "rolling", **like_rolling}, {"name": "none", "viscous_coefficient": 10.0}]},
    }
    return {name: create(registry, FrictionModel, {"name": name, **spec}) for name, spec in specs.items()}


def cosine(amplitude: float, points: int = 20_000) -> np.ndarray:
    """Return one period of a displacement, from its peak on."""
    return amplitude * np.cos(2 * np.pi * np.arange(points) / points)


def harmonic(signal: np.ndarray, number: int = 1) -> complex:
    """Return the phasor of a harmonic of one period."""
    return complex(np.fft.rfft(signal)[number] * 2 / signal.size)


def work(force: np.ndarray, displacement: np.ndarray) -> float:
    """Return the energy per cycle [J] of one period of force [N] and displacement [m]."""
    return float(np.sum((force + np.roll(force, -1)) / 2 * (np.roll(displacement, -1) - displacement)))


def along(*corners: float, points: int = 200) -> np.ndarray:
    """Return a path that goes straight from corner to corner, each after `points` samples; it begins with the first."""
    legs = [np.linspace(a, b, points + 1)[1:] for a, b in itertools.pairwise(corners)]
    return np.concatenate([[corners[0]], *legs])
