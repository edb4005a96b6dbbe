"""Friction over the stroke: against an independent simulation and closed forms, by both paths, and what refuses it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.plants.modal import Modal

from fraexp.analysis.fourier import phasors
from fraexp.components.kinds import Estimator, FrictionModel, Motion
from fraexp.components.registry import create
from fraexp.data.results import Outcome
from fraexp.errors import ParameterError
from fraexp.simulation import loop_setup
from tests.machines import FRICTIONLESS, LEAD, decibel, guide, simulated, table_models
from tests.physics.fine_bodies import FineLoop, Sliders
from tests.refusals import refused

SAMPLE, GAIN = 500e-6, 0.132
BLOCK = Modal(rigid_body_gain=GAIN)
"""The table as a rigid body."""
START = 0.3e-3
STROKE: dict[str, Any] = {
    "start": START,
    "positions": [-0.2e-3, 0.1e-3, 0.9e-3],
    "force_ratios": [0.7, 1.0, 1.6],
    "ripples": [{"period": 0.5e-3, "amplitude": 0.2, "phase": 0.4}, {"period": 0.13e-3, "amplitude": 0.05}],
    "cogging": [{"period": 0.7e-3, "amplitude": 4.0, "phase": 1.0}],
}
"""All that depends on the position, over a stroke of a millimetre."""


def ratio(x):
    """Return the factor on the friction force at a displacement, written once more."""
    at = x + START
    table = 0.7 if at < -0.2e-3 else 0.7 + (at + 0.2e-3) * 1000 if at < 0.1e-3 else 1.0 + (at - 0.1e-3) * 750
    ripple = 0.2 * np.sin(2 * np.pi * at / 0.5e-3 + 0.4) + 0.05 * np.sin(2 * np.pi * at / 0.13e-3)
    return min(table, 1.6) * (1 + ripple)


def cogging(x):
    """Return the cogging force at a displacement, written once more."""
    return 4.0 * np.sin(2 * np.pi * (x + START) / 0.7e-3 + 1.0)


def positioned(registry, model, **dependence):
    """Return a friction model with a dependence on the position."""
    return create(registry, FrictionModel, {**model.spec(), "position_dependence": dependence})


def sliders(port, law, **over_stroke):
    return Sliders(
        np.array(port), np.array(law.stiffness), np.array(law.limit_force), law.viscous_coefficient, **over_stroke
    )


def responses(signals, channel="y"):
    return np.array([(phasors(each, channel) / phasors(each, "u"))[0, 0] for each in signals.segments])


@pytest.mark.parametrize("path", ["in lanes", "implicitly"])
@pytest.mark.thorough
def test_the_loop_agrees_with_an_independent_simulation(registry, monkeypatch, path):
    if path == "implicitly":
        monkeypatch.setattr(loop_setup, "is_friction_soft", lambda *_: False)
    law = guide(17.9, 40e-6, 4.69, elements=6)
    signals = simulated(positioned(registry, law, **STROKE), (25.0,), 75.0, plant=BLOCK, steps=30)
    assert signals.outcome is Outcome.OK
    assert path in signals.numerics
    one = np.ones((1, 1))
    exact = FineLoop(
        one / GAIN, 0 * one, 0 * one, [sliders([1.0], law, ratio=ratio, cogging=cogging)], np.ones(1),
        {"table": np.ones(1)}, *LEAD.transfer_function(SAMPLE), SAMPLE, 2,
    )  # fmt: skip
    response = responses(signals)[0]
    assert response == pytest.approx(exact.responses(75.0, 80, 60, 15)["table"], rel=1e-4)
    alike = responses(simulated(law, (25.0,), 75.0, plant=BLOCK))[0]
    assert abs(alike / response - 1) > 0.02  # what is compared matters


@pytest.mark.thorough
def test_several_contacts_agree_with_an_independent_simulation(registry):
    component = registry.provider("plant", "two_mass").component
    plant = registry.create("plant", {"name": "two_mass", "preset": next(iter(component.presets))})
    controller = Pid(proportional=8000.0, derivative_time=0.04, filter_time=0.004)
    laws = {"motor": guide(8.0, 20e-6, 2.0, elements=4), "load": guide(6.0, 40e-6, 3.0, elements=3)}
    frictions = {"motor": positioned(registry, laws["motor"], **STROKE), "load": laws["load"]}
    signals = simulated(frictions, (25.0,), 60.0, plant=plant, controller=controller, steps=30)
    assert signals.outcome is Outcome.OK
    bodies = plant.bodies
    contacts = [
        sliders(bodies.contacts["motor"], laws["motor"], ratio=ratio, cogging=cogging),
        sliders(bodies.contacts["load"], laws["load"]),
    ]
    exact = FineLoop(
        bodies.mass, bodies.damping, bodies.stiffness, contacts, next(iter(bodies.thrusts.values())),
        bodies.positions, *controller.transfer_function(SAMPLE), SAMPLE, 2,
    ).responses(60.0, 80, 60, 12)  # fmt: skip
    assert responses(signals)[0] == pytest.approx(exact["motor"], rel=1e-4)
    assert responses(signals, "y.load")[0] == pytest.approx(exact["load"], rel=1e-4)


@pytest.mark.parametrize("phase", [0.0, np.pi])
def test_small_motion_on_cogging_is_that_on_a_spring(registry, phase):
    """Cogging at rest is a spring of 2π A/p, which with half a period of offset pushes away."""
    friction = positioned(
        registry, FRICTIONLESS, start=2e-3, cogging=[{"period": 2e-3, "amplitude": 1.0, "phase": phase}]
    )
    frequencies, spring = (6.0, 12.0, 40.0), np.cos(phase) * 2 * np.pi * 1.0 / 2e-3
    found = responses(simulated(friction, frequencies, 1e-3, plant=BLOCK, steps=0))
    s = 2j * np.pi * np.array(frequencies)
    sampled = responses(simulated(FRICTIONLESS, frequencies, 1e-3, plant=BLOCK, steps=0)) * s**2 / GAIN
    assert found == pytest.approx(sampled / (s**2 / GAIN + spring), rel=2e-3)  # the delay of hold and dead time
    assert abs(spring * GAIN / s[0] ** 2) > 0.2


@pytest.mark.thorough
def test_a_law_that_is_driven_has_the_force_of_the_loop(registry):
    """An observer scales the force that the law gives; the loop's law holds its position as a state."""
    models = table_models(registry)
    for model in (models["rolling"], models["lugre"]):
        friction = positioned(registry, model, **STROKE)
        displacement = np.concatenate([np.linspace(0, 0.5e-3, 200), np.linspace(0.5e-3, -0.4e-3, 300)])
        z, before, forces = np.zeros(friction.state_size), 0.0, []
        for y in displacement:
            z_next = np.zeros(friction.state_size)
            forces.append(friction.law(z, y - before, 1e-4, z_next, *friction.law_arguments()))
            z, before = z_next, y
        driven = friction.force(displacement, 1e-4)
        np.testing.assert_allclose(driven, forces, rtol=0, atol=1e-9 * np.abs(driven).max())
        assert friction.force_bound is None or np.abs(driven).max() <= friction.force_bound
        pair = friction.forces([Motion(displacement, 1e-4), Motion(displacement[::-1], 1e-4)])
        np.testing.assert_allclose(pair[0], driven, rtol=0, atol=1e-9)


def test_the_stiffness_bounds_every_slope(registry):
    law = guide(elements=6)
    friction = positioned(registry, law, **STROKE)
    displacement = np.linspace(-1e-3, 1e-3, 200_001)
    slopes = np.abs(np.diff(friction.force(displacement, 1e-4)) / np.diff(displacement))
    assert slopes.max() <= friction.max_stiffness
    assert friction.stiffness_in_step(1e-4) >= guide(elements=6).stiffness_in_step(1e-4)


def estimator(registry, name, friction, **settings):
    spec = {"name": name, "friction": friction.spec(), "input_dead_time": 1e-3, **settings}
    return create(registry, Estimator, {key: value for key, value in spec.items() if value is not None})


@pytest.mark.thorough
def test_the_proposed_method_finds_the_plant_through_cogging_and_preload(registry):
    friction = positioned(registry, guide(), **STROKE)
    frequencies = (4.0, 10.0, 25.0, 60.0)
    for amplitude in (45.0, 75.0):
        signals = simulated(friction, frequencies, amplitude, steps=0)
        assert signals.outcome is Outcome.OK
        found = estimator(registry, "effective_input", friction).estimate(signals).response
        plant = signals.verification.plants["y"]
        np.testing.assert_allclose(decibel(found.response / plant), 0, atol=0.01)
        unaware = estimator(registry, "effective_input", guide()).estimate(signals).response
        assert np.abs(decibel(unaware.response / plant)).max() > 0.3
        apparent = Conventional().estimate(signals).response
        assert np.abs(decibel(apparent.response / plant)).max() > 3


@pytest.mark.thorough
def test_the_certificate_covers_the_dependence(registry):
    """The estimated error of y/u is about the true one, which a fine simulation shows, and within the tolerance."""
    friction = positioned(registry, guide(17.9, 40e-6, 4.69, elements=6), **STROKE)
    fine = responses(simulated(friction, (25.0,), 75.0, plant=BLOCK, steps=60))[0]
    for steps in (0, 2, 4, 8):
        signals = simulated(friction, (25.0,), 75.0, plant=BLOCK, steps=steps)
        error = abs(responses(signals)[0] / fine - 1)
        assert error < 1e-4
        assert error / 3 < signals.verification.step_error[0] < 10 * error


@pytest.mark.thorough
def test_a_displacement_without_mean_is_refused(registry):
    component = registry.provider("plant", "two_mass").component
    plant = {"name": "two_mass", "preset": next(iter(component.presets))}
    made = registry.create("plant", plant)
    frictions = {"motor": positioned(registry, guide(8.0), **STROKE), "load": FRICTIONLESS}
    controller = Pid(proportional=8000.0, derivative_time=0.04, filter_time=0.004)
    signals = simulated(frictions, (25.0,), 40.0, plant=made, controller=controller, position="load")
    of_contacts = {name: model.spec() for name, model in frictions.items()}
    spec = {"name": "effective_input", "frictions": of_contacts, "nominal_plant": plant}
    method = create(registry, Estimator, {**spec, "position": "load", "input_dead_time": 1e-3})
    assert method.estimate(signals).outcome is Outcome.OK  # y.motor shows where the motor is
    alone = [
        replace(each, channels={k: v for k, v in each.channels.items() if k != "y.motor"}) for each in signals.segments
    ]
    units = {name: unit for name, unit in signals.units.items() if name != "y.motor"}
    with refused(ParameterError, "contact 'motor'"):
        method.estimate(replace(signals, segments=tuple(alone), units=units))


@pytest.mark.parametrize(
    ("dependence", "names"),
    [
        ({"positions": [0, 2, 1], "force_ratios": [1, 1, 1]}, ["positions", "[0.0, 2.0, 1.0]"]),
        ({"positions": [0, 1], "force_ratios": [1, 0]}, ["force_ratios", 0]),
        ({"cogging": [{"period": 0, "amplitude": 1}]}, ["cogging.0.period", "0 m"]),
        ({"cogging": [{"period": 1, "amplitud": 1}]}, ["cogging.0", "'amplitud'", "'amplitude'"]),
        (3, [3]),
    ],
)  # fmt: skip
def test_what_is_no_dependence_is_refused(registry, dependence, names):
    with refused(ParameterError, "rolling", "position_dependence", *names):
        create(registry, FrictionModel, {**guide().spec(), "position_dependence": dependence})


def test_what_cannot_use_a_dependence_refuses_it(registry):
    friction = positioned(registry, guide(), **STROKE)
    with refused(ParameterError, "effective_input.displacement_scale", 1.1, "expected 1"):
        estimator(registry, "effective_input", friction, displacement_scale=1.1)
    with refused(ParameterError, "effective_input.displacement_std", 0.1, "expected 0"):
        estimator(registry, "effective_input", friction, displacement_std=0.1)
    with refused(ParameterError, "composite", "rolling", "position_dependence", "parts"):
        create(registry, FrictionModel, {"name": "composite", "parts": [friction.spec()]})
    with refused(ParameterError, "friction_identification.starts", "position_dependence"):
        create(
            registry,
            Estimator,
            {"name": "friction_identification", "back_propagation": True, "starts": [friction.spec()]},
        )
