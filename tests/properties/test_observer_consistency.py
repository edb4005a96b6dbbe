"""The paper's claim as a property: with the right model the observer finds û_e and P, whatever the machine."""

import numpy as np
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.modal import Modal
from hypothesis import given, settings
from hypothesis import strategies as st

from fraexp.analysis.fourier import phasors
from tests.examples import portion
from tests.machines import FRICTIONLESS, guide, simulated

FREQUENCIES = (4.0, 23.0, 61.0)
SAMPLE_TIME_S = 500e-6
number = st.floats

machines = st.fixed_dictionaries(
    {
        "mass": number(1.0, 30.0),
        "mode": number(25.0, 90.0),
        "damping": number(0.02, 0.2),
        "residue": number(0.05, 0.6),
        "coulomb_force": number(0.5, 20.0),
        "width": number(10e-6, 200e-6),
        "viscous": number(0.0, 50.0),
        "crossover": number(2.0, 8.0),
        "dead_time": number(0.0, 1.5e-3),
        "output_dead_time": number(0.0, 1e-3),
        "amplitude": number(2.0, 80.0),
    }
)


def built(values: dict[str, float]):
    """Return plant, friction, controller and delays of drawn numbers."""
    plant = Modal(
        rigid_body_gain=1 / values["mass"],
        frequencies=(values["mode"],),
        damping_ratios=(values["damping"],),
        modal_gain_ratios=(values["residue"],),
    )
    friction = guide(values["coulomb_force"], values["width"], values["viscous"], elements=10)
    omega = 2 * np.pi * values["crossover"]
    controller = Pid(proportional=values["mass"] * omega**2 / 4, derivative_time=3 / omega, filter_time=0.2 / omega)
    delays = {"input_dead_time": values["dead_time"], "output_dead_time": values["output_dead_time"]}
    return plant, friction, controller, delays


@settings(max_examples=portion(25))
@given(machines)
def test_matched_model_recovers_plant_and_effective_input(values):
    plant, friction, controller, delays = built(values)
    signals = simulated(
        friction, FREQUENCIES, values["amplitude"], plant=plant, controller=controller, steps=16, **delays
    )
    response = EffectiveInput(friction=friction, **delays).estimate(signals).response
    omega = 2 * np.pi * response.frequency
    # errors of y' enter P through P·N
    weight = np.maximum(1.0, np.abs(plant.response(omega)) * friction.max_stiffness)
    tolerance = np.maximum(6e-4, held_images(plant, friction, response.frequency)) * weight
    assert np.all(np.abs(response.response / plant.response(omega) - 1) < tolerance)
    true_input = response.output_amplitude / np.abs(plant.response(omega))
    assert np.allclose(response.input_amplitude, true_input, rtol=tolerance.max())


def held_images(plant: Modal, friction: Rolling, frequency: np.ndarray) -> np.ndarray:
    """Return the images of the held thrust in the motion over the line onto which sampling folds them, at most.

    The friction is taken as its stiffest spring, with which the motion at the line is least.
    """

    def compliance(at: np.ndarray) -> np.ndarray:
        free = plant.response(2 * np.pi * at)
        return np.abs(free / (1 + friction.max_stiffness * free))

    images = [order / SAMPLE_TIME_S + sign * frequency for order in (1, 2, 3) for sign in (-1, 1)]
    return sum(frequency / image * compliance(image) for image in images) / compliance(frequency)


@settings(max_examples=portion(15))
@given(machines)
def test_the_estimated_friction_is_the_delayed_true_one(values):
    plant, friction, controller, delays = built(values)
    signals = simulated(
        friction, FREQUENCIES, values["amplitude"], plant=plant, controller=controller, steps=16, **delays
    )
    estimator = EffectiveInput(friction=friction, oversampling=8, **delays)
    for segment in signals.segments:
        omega = 2 * np.pi * segment.frequency
        delayed = phasors(segment, "friction") * estimator.output_path(omega)
        estimated = estimator._friction_phasors([segment])[0]
        scale = np.max(np.abs(phasors(segment, "u")))
        assert np.all(np.abs(estimated - delayed) < 2e-3 * scale)  # the true force is only known at the samples


@settings(max_examples=portion(15))
@given(machines)
def test_without_friction_both_methods_agree(values):
    plant, _, controller, delays = built(values)
    amplitude = values["amplitude"]
    signals = simulated(
        FRICTIONLESS, FREQUENCIES, amplitude, plant=plant, controller=controller, tolerance=1e-8, **delays
    )
    conventional = Conventional(refer_to_plant=True, **delays).estimate(signals).response
    proposed = EffectiveInput(friction=FRICTIONLESS, **delays).estimate(signals).response
    assert np.allclose(proposed.response, conventional.response, rtol=1e-12, atol=0)
