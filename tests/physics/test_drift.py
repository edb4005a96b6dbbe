"""The drift test: a force below Coulomb friction, with a ripple, must not move a machine; LuGre bristles creep."""

import numpy as np
import pytest
from fraexp_plugins.controllers.transfer_function import TransferFunction
from fraexp_plugins.estimators.drift import Drift
from fraexp_plugins.excitations.biased_sine import BiasedSine
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.modal import Modal
from numba import njit

from fraexp.kernels.law import register_law
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.examples import some

SAMPLE, STEPS = 5e-4, 20
GMS = GeneralizedMaxwellSlip.parse(GeneralizedMaxwellSlip.presets["reference"], "gms")
MICRO_DAMPING = 0.3 * np.sqrt(sum(GMS.stiffness))  # of 1 kg on the stuck elements
LUGRE = LuGre.parse(LuGre.presets["canudas_de_wit_1995"], "lugre")
HOLDING = {
    "rolling": Rolling(stiffness=GMS.stiffness, limit_force=(0.1,) * 10, viscous_coefficient=MICRO_DAMPING),
    "gms": GMS.model_copy(update={"viscous_coefficient": MICRO_DAMPING}),
    "elastoplastic": Elastoplastic.parse(Elastoplastic.presets["dupont_2002"], "elastoplastic"),
}


def drift(friction) -> float:
    """Return how far 1 kg has gone from the second to the last of 50 periods [m]."""
    still = TransferFunction(numerator=(0.0,))
    plant = Modal(rigid_body_gain=1.0, frequencies=(), damping_ratios=(), modal_gain_ratios=())
    machine = Machine(plant, friction, still, ControlLoop(sample_time=SAMPLE), Numerics(steps_per_sample=STEPS))
    push = BiasedSine(bias=0.4, amplitude=0.2, frequency=5.0, recorded_periods=50)
    (found,) = Drift().estimate(simulate_loop(machine, push, lambda _: None)).metrics
    return found.value


@pytest.mark.parametrize("name", some(HOLDING, "rolling"))
def test_models_with_an_elastic_range_hold(name):
    assert abs(drift(HOLDING[name])) < 1e-11  # m: what is left in the second period of the first one's swinging


@pytest.mark.thorough
def test_lugre_creeps_by_its_known_amount():
    assert drift(LUGRE) == pytest.approx(118e-6, rel=0.05)


@pytest.mark.thorough
def test_dahl_creeps_too():
    assert drift(Dahl(stiffness=1e5, coulomb_force=1.0)) > 100e-6


def _make_backward_euler(law):
    @njit
    def run(force, step, z, arguments):
        position, velocity = np.zeros(force.size), 0.0
        for k in range(1, force.size):
            old, new = z[(k - 1) % 2], z[k % 2]
            low, high = velocity - 10.0 * step - 1e-9, velocity + 10.0 * step + 1e-9
            for _ in range(50):  # bisection of the rising v + step (f(v step) + sigma2 v - u)
                trial = 0.5 * (low + high)
                friction = law(old, trial * step, step, new, *arguments) + 0.4 * trial
                if trial - velocity + step * (friction - force[k]) > 0.0:
                    high = trial
                else:
                    low = trial
            velocity = 0.5 * (low + high)
            law(old, velocity * step, step, new, *arguments)
            position[k] = position[k - 1] + velocity * step
        return position

    return run


@pytest.mark.thorough
def test_the_creep_of_lugre_is_the_same_in_a_loop_of_another_kind():
    """Backward Euler with a bisection in each step of 0.1 ms, which shares nothing with fraexp's loop but the law."""
    step = 1e-4
    time = np.arange(100_001) * step
    force = 0.4 + 0.2 * np.sin(2 * np.pi * 5 * time)
    run = _make_backward_euler(register_law(LUGRE.law))
    position = run(force, step, np.zeros((2, LUGRE.state_size)), LUGRE.law_arguments())
    means = position[1:].reshape(50, -1).mean(axis=1)
    assert means[-1] - means[1] == pytest.approx(drift(LUGRE), rel=0.02)
