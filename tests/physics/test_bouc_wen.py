"""A law that fraexp does not have, dropped in: the Bouc-Wen benchmark, against an adaptive integrator.

J. P. Noël and M. Schoukens, Hysteretic benchmark with a dynamic nonlinearity, Workshop on Nonlinear System
Identification Benchmarks, Brussels 2016.
"""

import math
from typing import ClassVar

import numpy as np
import pytest
from fraexp_plugins.controllers.transfer_function import TransferFunction
from fraexp_plugins.excitations.biased_sine import BiasedSine
from scipy.integrate import solve_ivp

from fraexp.components.kinds import FrictionModel, Plant
from fraexp.components.parameters import param
from fraexp.components.ports import StateSpace
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics

MASS, DAMPING, STIFFNESS = 2.0, 10.0, 5e4
ALPHA, BETA, GAMMA, DELTA = 5e4, 1e3, 0.8, -1.1
SAMPLE, FREQUENCY, AMPLITUDE, PERIODS = 1e-3, 20.0, 80.0, 3


class Spring(Plant, name="spring_test", version=1):
    """1/(m s² + c s + k)."""

    def state_space(self) -> StateSpace:
        a = np.array([[0.0, 1.0], [-STIFFNESS / MASS, -DAMPING / MASS]])
        return StateSpace(a, np.array([0.0, 1 / MASS]), np.array([1.0, 0.0]))

    def response(self, omega):
        return 1 / (STIFFNESS - MASS * omega**2 + 1j * DAMPING * omega)


class BoucWen(FrictionModel, name="bouc_wen_test", version=1):
    """dz/dy = α - β(γ z sgn v + δ|z|) for ν = 1, by the classical Runge-Kutta method along the step."""

    states: ClassVar[tuple[str, ...]] = ("force [N]",)

    alpha: float = param("N/m", "stiffness α at rest", ALPHA)
    beta: float = param("1/m", "β", BETA)
    gamma: float = param("1", "γ", GAMMA)
    delta: float = param("1", "δ", DELTA)

    @staticmethod
    def advance(z, dy, dt, z_next, alpha, beta, gamma, delta):
        way, one = math.copysign(1.0, dy), z[0]
        first = alpha - beta * (gamma * one * way + delta * abs(one))
        two = one + 0.5 * dy * first
        second = alpha - beta * (gamma * two * way + delta * abs(two))
        three = one + 0.5 * dy * second
        third = alpha - beta * (gamma * three * way + delta * abs(three))
        four = one + dy * third
        fourth = alpha - beta * (gamma * four * way + delta * abs(four))
        z_next[0] = one + dy * (first + 2.0 * second + 2.0 * third + fourth) / 6.0
        return z_next[0]


def integrated(thrust: np.ndarray) -> np.ndarray:
    """Return the position at the samples while each thrust is held, from rest on."""

    def rate(_, x, u):
        y, v, z = x
        force_rate = ALPHA * v - BETA * (GAMMA * abs(v) * z + DELTA * v * abs(z))
        return v, (u - DAMPING * v - STIFFNESS * y - z) / MASS, force_rate

    state, found = np.zeros(3), []
    for u in thrust:
        found.append(state[0])
        done = solve_ivp(rate, (0, SAMPLE), state, "DOP853", args=(u,), rtol=1e-9, atol=1e-13, max_step=SAMPLE / 4)
        state = done.y[:, -1]
    return np.array(found)


def simulated(steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return thrust, position and force at the samples, from rest on."""
    loop = ControlLoop(sample_time=SAMPLE, divergence_limit=1.0)
    excitation = BiasedSine(bias=0.0, amplitude=AMPLITUDE, frequency=FREQUENCY, recorded_periods=PERIODS)
    machine = Machine(Spring(), BoucWen(), TransferFunction(numerator=(0.0,)), loop, Numerics(steps_per_sample=steps))
    channels = simulate_loop(machine, excitation, lambda _: None).segments[0].channels
    u, y, force = (channels[name].ravel() for name in ("u", "y", "friction"))
    return u, y, force


@pytest.mark.thorough
def test_a_law_that_is_dropped_in_is_simulated_as_it_is_published():
    u, y, force = simulated(0)
    assert np.abs(force - ALPHA * y).max() > 0.5 * np.abs(force).max()  # far from linear
    truth = integrated(u)
    for found, bound in ((y, Numerics().tolerance), (simulated(20)[1], 2e-5)):
        assert np.max(np.abs(found - truth)) < bound * np.abs(truth).max()
