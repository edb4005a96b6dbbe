"""The drift test: a force below Coulomb friction, with a ripple, must not move a machine; LuGre bristles creep."""

import numpy as np
import pytest
from fraexp_plugins.controllers.transfer_function import TransferFunction
from fraexp_plugins.estimators.drift import Drift
from fraexp_plugins.excitations.biased_sine import BiasedSine
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.modal import Modal

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
