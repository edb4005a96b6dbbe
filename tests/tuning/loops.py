"""A loop around a rigid body, and the same loop as a simulation of its own."""

import numpy as np
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.modal import Modal
from fraexp_plugins.tuning._shared.gain_search import LoopFamily
from fraexp_plugins.tuning._shared.plant_band import PlantBand
from fraexp_plugins.tuning.loop_tuning import FrictionGain

from fraexp.analysis.delays import hold_response, image_factor, path_response

SAMPLE_TIME_S = 5e-4
SUBSTEPS = 25
MASS, VISCOUS = 1 / 0.132, 4.69
BODY = Modal(rigid_body_gain=0.132)
GUIDE = Rolling(
    curve={"coulomb_force": 17.9, "characteristic_displacement": 45e-6, "elements": 20}, viscous_coefficient=VISCOUS
)


def lead(proportional: float) -> Pid:
    """Return the lead of the paper's machine with another gain [N/m]."""
    return Pid(proportional=proportional, derivative_time=0.0566204, filter_time=0.00629115)


def family(dead_time: float, points: int = 1500) -> tuple[LoopFamily, FrictionGain]:
    """Return all loops around the body with its guide, for a plant that is known exactly."""
    frequency = np.geomspace(0.05, 900, points)
    omega = 2 * np.pi * frequency
    nominal, zero = BODY.response(omega), np.zeros(points)
    band = PlantBand(frequency, nominal, zero, 1 / nominal, zero, np.zeros(points, dtype=bool))
    path = path_response(omega, dead_time, ()) * hold_response(omega, SAMPLE_TIME_S)
    path = path * image_factor(omega, SAMPLE_TIME_S, dead_time, (), 2)
    friction = FrictionGain.from_model(GUIDE, np.geomspace(1e-8, 1e-2, 120), frequency[0], frequency[-1])
    return LoopFamily(band, friction.gain_at(frequency), path, SAMPLE_TIME_S), friction


def simulate(controller: Pid, late_samples: int, start: float, time: float) -> np.ndarray:
    """Return the sampled position [m] of the body that is released at `start` [m], friction being springs that slip."""
    stiffness, limit = (np.array(each) for each in GUIDE.elements)
    slip = limit / stiffness
    b, a = controller.transfer_function(SAMPLE_TIME_S)
    h = SAMPLE_TIME_S / SUBSTEPS
    position, speed, stretch, filtered = start, 0.0, np.zeros(stiffness.size), 0.0
    waiting, found = [0.0] * late_samples, []
    for _ in range(round(time / SAMPLE_TIME_S)):
        found.append(position)
        control = -b[0] * position + filtered
        filtered = -b[1] * position - a[1] * control
        waiting.append(control)
        thrust = waiting.pop(0)
        for _ in range(SUBSTEPS):  # velocity, then position: symplectic, so that nothing is damped by the step
            speed += h / MASS * (thrust - stiffness @ stretch - VISCOUS * speed)
            position += h * speed
            stretch = np.clip(stretch + h * speed, -slip, slip)
    return np.array(found)


def amplitude_and_frequency(position: np.ndarray) -> tuple[float, float]:
    """Return amplitude [m] and frequency [Hz] of an oscillation, from its fundamental over whole periods."""
    centred = position - position.mean()
    rises = np.flatnonzero((centred[:-1] < 0) & (centred[1:] >= 0))
    exact = rises + centred[rises] / (centred[rises] - centred[rises + 1])
    samples = (exact[-1] - exact[0]) / (len(exact) - 1)
    n = np.arange(rises[0], rises[-1])
    fundamental = 2 / n.size * abs(np.sum(centred[n] * np.exp(-2j * np.pi * n / samples)))
    return float(fundamental), 1 / (samples * SAMPLE_TIME_S)
