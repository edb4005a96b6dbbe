"""A controller for each of several thrusts: against matrix algebra, an independent simulation, and the plant itself."""

import numpy as np
import pytest
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.estimators.effective_input import EffectiveInput
from scipy.signal import cont2discrete

from fraexp.analysis.fourier import phasors
from fraexp.data.results import Outcome
from fraexp.errors import ParameterError
from tests.machines import FRICTIONLESS, guide, simulated
from tests.physics.fine_bodies import FineLoop, Sliders
from tests.refusals import refused

SAMPLE, DEAD_SAMPLES = 500e-6, 2
CONTROLLER = Pid(proportional=9000.0, derivative_time=0.05, filter_time=0.005)
SOFTER = Pid(proportional=4000.0, integral_time=0.3, derivative_time=0.05, filter_time=0.005)
FREE = {"left": FRICTIONLESS, "right": FRICTIONLESS}
FRICTIONS = {"left": guide(9.0, 30e-6, 5.0, elements=5), "right": guide(12.0, 40e-6, 7.0, elements=6)}


@pytest.fixture(scope="module")
def plant(registry):
    return registry.create("plant", {"name": "gantry", "preset": "short_beam"})


def closed_loops(plant, excited, frequencies, controllers):
    """Return each channel over the excitation, shape (frequencies,), by matrices of the discrete loops."""
    bodies, names = plant.bodies, [excited, *(name for name in controllers if name != excited)]
    inverse, k = np.linalg.inv(bodies.mass), len(bodies.mass)
    a = np.block([[np.zeros((k, k)), np.eye(k)], [-inverse @ bodies.stiffness, -inverse @ bodies.damping]])
    b = np.vstack([np.zeros((k, len(names))), inverse @ np.column_stack([bodies.thrusts[name] for name in names])])
    c = np.hstack([np.array([bodies.positions[name] for name in names]), np.zeros((len(names), k))])
    discrete = cont2discrete((a, b, c, np.zeros((len(names), len(names)))), SAMPLE)
    found = {channel: [] for channel in ("y", f"y.{names[1]}", "u", f"u.{names[1]}")}
    for frequency in frequencies:
        z = np.exp(2j * np.pi * frequency * SAMPLE)
        response = c @ np.linalg.solve(z * np.eye(2 * k) - discrete[0], discrete[1]) * z**-DEAD_SAMPLES
        feedback = np.diag([_feedback(controllers[name], z) for name in names])
        u = np.linalg.solve(np.eye(len(names)) + feedback @ response, np.eye(len(names))[:, 0])
        for channel, value in zip(found, [*(response @ u), *u], strict=True):
            found[channel].append(value)
    return {channel: np.array(values) for channel, values in found.items()}


def _feedback(controller, z):
    numerator, denominator = controller.transfer_function(SAMPLE)
    powers = z ** -np.arange(max(numerator.size, denominator.size))
    return numerator @ powers[: numerator.size] / (denominator @ powers[: denominator.size])


def over_excitation(signals, channel):
    return np.array([(phasors(each, channel) / phasors(each, "excitation"))[0, 0] for each in signals.segments])


@pytest.mark.parametrize("excited", ["left", "right"])
def test_without_friction_the_loops_are_those_of_matrix_algebra(plant, excited):
    controllers = {"left": CONTROLLER, "right": SOFTER}
    frequencies = (4.0, 25.0, 80.0)
    signals = simulated(FREE, frequencies, 20.0, plant=plant, controller=controllers, thrust=excited, tolerance=1e-8)
    assert signals.outcome is Outcome.OK
    for channel, expected in closed_loops(plant, excited, frequencies, controllers).items():
        assert over_excitation(signals, channel) == pytest.approx(expected, rel=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("excited", ["left", "right"])
def test_friction_acts_as_in_an_independent_simulation(plant, excited):
    frequency, bodies, held = 25.0, plant.bodies, {"left": "right", "right": "left"}[excited]
    controllers = dict.fromkeys(FRICTIONS, CONTROLLER)
    signals = simulated(FRICTIONS, (frequency,), 40.0, plant=plant, controller=controllers, thrust=excited, steps=40)
    contacts = [
        Sliders(bodies.contacts[name], np.array(law.stiffness), np.array(law.limit_force), law.viscous_coefficient)
        for name, law in FRICTIONS.items()
    ]
    exact = FineLoop(
        bodies.mass, bodies.damping, bodies.stiffness, contacts, bodies.thrusts[excited],
        {name: bodies.positions[name] for name in (excited, held)}, *CONTROLLER.transfer_function(SAMPLE), SAMPLE,
        DEAD_SAMPLES, {held: bodies.thrusts[held]},
    ).responses(40.0, round(1 / (frequency * SAMPLE)), 60, 12)  # fmt: skip
    for channel, position in (("y", excited), (f"y.{held}", held)):
        found = over_excitation(signals, channel) / over_excitation(signals, "u")
        assert found[0] == pytest.approx(exact[position], rel=1e-4)


@pytest.mark.parametrize("output", ["left", "right"])
def test_the_proposed_response_is_the_plant_without_the_other_loop(plant, output):
    frequencies = (2.0, 10.0, 60.0)
    controllers = dict.fromkeys(FRICTIONS, CONTROLLER)
    signals = simulated(FRICTIONS, frequencies, 40.0, plant=plant, controller=controllers, thrust="left", steps=20)
    settings = {"frictions": FRICTIONS, "nominal_plant": plant, "thrust": "left", "input_dead_time": 1e-3}
    found = EffectiveInput(output="y" if output == "left" else "y.right", **settings).estimate(signals)
    assert found.outcome is Outcome.OK
    expected = plant.ports().closed_by("left", "").response(2 * np.pi * np.array(frequencies), output)
    assert found.response.response == pytest.approx(expected, rel=1e-3)


def test_loops_see_noise_and_steps_of_their_own_encoders(plant):
    controllers = dict.fromkeys(FREE, CONTROLLER)
    signals = simulated(FREE, (20.0,), 20.0, plant=plant, controller=controllers, noise=1e-7, resolution=1e-6)
    (segment,) = signals.segments
    left, right = segment.channels["y"], segment.channels["y.right"]
    for steps in (left / 1e-6, right / 1e-6):
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert not np.array_equal(left, right)


@pytest.mark.parametrize(
    ("controlled", "loop", "names"),
    [
        (["left", "rihgt"], {}, ["[controller.rihgt]", "'right'"]),
        (["right"], {}, ["'left'", "[controller.left]", "[loop] thrust"]),
        (["left", "right"], {"position": "right"}, ["[controller.right]", "'right'", "[loop] position"]),
    ],
)
def test_controllers_fit_the_ports(plant, controlled, loop, names):
    with refused(ParameterError, *names):
        simulated(FREE, (5.0,), plant=plant, controller=dict.fromkeys(controlled, CONTROLLER), **loop)
