"""Coulomb friction at several contacts: against a simulation that locates each event, sums of laws, and its limits."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.two_mass import TwoMass

from fraexp.data.results import Outcome
from fraexp.execution.verdict import certify
from tests.examples import some
from tests.machines import TABLE, decibel, simulated
from tests.physics.coupled_events import Dry, EventLoop, Stop
from tests.physics.test_contacts import AMPLITUDES, CONTROLLERS, SAMPLE, TwoPlaces, example, responses
from tests.responses import judged

DRIVE = TwoMass(motor_mass=3.0, load_mass=5.0, stiffness=2e5, damping=20.0)
CONTROLLER = CONTROLLERS["two_mass"]
BARELY = Coulomb(coulomb_force=1e-6)


def on_drive(frictions, frequencies, amplitude=25.0, steps=0, **settings):
    return simulated(frictions, frequencies, amplitude, plant=DRIVE, controller=CONTROLLER, steps=steps, **settings)


def drawn_friction(rng, name, amplitude):
    """Return friction as fraexp has it and as the events have it: dry, with Stribeck effect, or a stop."""
    force = amplitude * rng.uniform(0.1, 0.35)
    if rng.random() < 0.3:
        stiffness = force / rng.uniform(5e-6, 50e-6)
        return Rolling(stiffness=(stiffness,), limit_force=(force,)), Stop, (stiffness, force)
    static, velocity = force * rng.choice([1.0, rng.uniform(1.05, 1.4)]), rng.uniform(1e-3, 1e-2)
    law = Coulomb(coulomb_force=force, static_force=static, stribeck_velocity=velocity)
    return law, Dry, (force, static, velocity)


def drawn_machine(registry, name, seed=3):
    """Return a plant, friction at its contacts, an amplitude, samples of a period, and what the dead time exceeds."""
    rng = np.random.default_rng(seed)
    plant, amplitude = example(registry, name), AMPLITUDES[name]
    changed = {key: value * rng.uniform(0.7, 1.4) for key, value in plant if isinstance(value, float)}
    plant = plant.model_copy(update=changed)
    drawn = {contact: drawn_friction(rng, contact, amplitude) for contact in plant.bodies.contacts}
    if not any(kind is Dry for _, kind, _ in drawn.values()):
        return drawn_machine(registry, name, seed + 1000)
    return plant, drawn, amplitude, round(0.5 / rng.uniform(8.0, 60.0) / SAMPLE) * 2, rng.choice([0.0, rng.random()])


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["two_mass", "ball_screw", "flexible_joint"])
def test_machines_agree_with_event_location(registry, name):
    """Of y and each other position, relative to the greatest."""
    plant, drawn, amplitude, samples, late = drawn_machine(registry, name)
    bodies, controller, rest = plant.bodies, CONTROLLERS[name], late * SAMPLE
    parts = [(kind, kind(bodies.contacts[contact], *numbers)) for contact, (_, kind, numbers) in drawn.items()]
    dry, stops = ([part for kind, part in parts if kind is wanted] for wanted in (Dry, Stop))
    loop = EventLoop(
        bodies.mass, bodies.damping, bodies.stiffness, dry, stops, next(iter(bodies.thrusts.values())),
        bodies.positions, controller.transfer_function(SAMPLE), SAMPLE, 2, rest,
    )  # fmt: skip
    frictions = {contact: law for contact, (law, _, _) in drawn.items()}
    signals = simulated(
        frictions, (1 / (samples * SAMPLE),), amplitude, plant=plant, controller=controller, steps=0,
        input_dead_time=2 * SAMPLE + rest,
    )  # fmt: skip
    assert signals.outcome is Outcome.OK
    assert "stick and slip" in signals.numerics
    exact = loop.responses(amplitude, samples)
    fed_back, *others = plant.ports().closed_by("", "").positions
    greatest = max(map(abs, exact.values()))
    for channel, position in [("y", fed_back), *((f"y.{each}", each) for each in others)]:
        assert abs(responses(signals, channel)[0] - exact[position]) < 1e-4 * greatest


def test_the_error_falls_with_the_square_of_the_step():
    frictions = {"motor": Coulomb(coulomb_force=8.0), "load": Coulomb(coulomb_force=6.0, static_force=7.0)}
    coarse, halved, fine = (responses(on_drive(frictions, (25.0, 90.0), steps=steps)) for steps in (5, 10, 40))
    assert np.all(np.abs(coarse - fine) > 3 * np.abs(halved - fine))
    assert np.all(np.abs(halved / fine - 1) < 1e-4)


@pytest.mark.parametrize("amplitude", [17.0, 40.0])
def test_two_contacts_at_one_place_are_their_sum(amplitude):
    """Which of two contacts holds a body is not determined; the motion is."""
    parts = {"nut": Coulomb(coulomb_force=10.0), "guide": Coulomb(coulomb_force=6.0)}
    plant = TwoPlaces(**dict(TABLE))
    apart = simulated(parts, (5.0, 25.0), amplitude, plant=plant)
    together = simulated(Coulomb(coulomb_force=16.0), (5.0, 25.0), amplitude)
    assert responses(apart) == pytest.approx(responses(together), rel=1e-8)


def test_a_machine_that_never_breaks_away_does_not_move():
    frictions = {"motor": Coulomb(coulomb_force=26.0), "load": Coulomb(coulomb_force=1.0)}
    signals = on_drive(frictions, (5.0, 60.0))
    assert np.abs(signals.segments[0].channels["displacement.load"]).max() < 1e-20
    for output in ("y", "y.load"):
        assert Conventional(output=output).estimate(signals).outcome is Outcome.NO_MOTION


def test_a_load_that_sticks_has_no_response_that_counts():
    """The motor moves against the spring of the load, which is held to less than a nanometre."""
    frictions = {"motor": Coulomb(coulomb_force=8.0), "load": Coulomb(coulomb_force=6.0)}
    signals = on_drive(frictions, (150.0,))
    assert np.ptp(signals.segments[0].channels["y.load"]) < 1e-9
    found = {output: Conventional(output=output) for output in ("y", "y.load")}
    certified = {name: certify(each, signals, each.estimate(signals), 1e-4) for name, each in found.items()}
    assert certified["y"].outcome is Outcome.OK
    assert certified["y.load"].outcome is Outcome.NO_MOTION
    assert (certified["y.load"].findings[0].kind, certified["y.load"].findings[0].place) == (
        "held by friction",
        "y.load",
    )


def test_frequencies_at_which_a_load_sticks_take_no_others_with_them():
    """Steps so fine that their error does not count show which responses are right."""
    frictions = {"motor": Coulomb(coulomb_force=8.0), "load": Coulomb(coulomb_force=6.0)}
    frequencies = (10.0, 25.0, 40.0, 60.0, 80.0, 100.0, 125.0, 150.0)
    signals = on_drive(frictions, frequencies)
    stands = np.array([np.ptp(segment.channels["y.load"]) < 1e-9 for segment in signals.segments])
    assert stands.any()
    assert stands.sum() < stands.size - 3
    conventional = Conventional(output="y.load")
    response = certify(conventional, signals, conventional.estimate(signals), 1e-4).response
    fine = conventional.estimate(on_drive(frictions, frequencies, steps=60)).response
    error = np.abs(response.response / fine.response - 1)
    np.testing.assert_array_equal(response.settled, ~stands)
    assert np.all(error[~stands] <= response.numerical_error[~stands])
    assert response.numerical_error[~stands].max() < 1e-3


@pytest.mark.parametrize(
    "encoder", some([{"resolution": 1e-7}, {"noise": 2e-8}, {"resolution": 1e-8, "noise": 1e-8}], {"resolution": 1e-7})
)
def test_an_encoder_does_not_hide_that_a_load_sticks(encoder):
    """What it shows there is its own: noise, or steps that it takes because of it."""
    frictions = {"motor": Coulomb(coulomb_force=8.0), "load": Coulomb(coulomb_force=6.0)}
    signals = on_drive(frictions, (10.0, 25.0, 40.0, 60.0, 80.0, 100.0, 125.0, 150.0), **encoder)
    stands = np.array([np.ptp(segment.channels["displacement.load"]) < 1e-9 for segment in signals.segments])
    assert 0 < stands.sum() < stands.size - 2
    found = {output: Conventional(output=output) for output in ("y", "y.load")}
    own, load = (certify(each, signals, each.estimate(signals), 1e-4) for each in found.values())
    assert own.response.settled.all()
    np.testing.assert_array_equal(load.response.settled, ~stands)
    assert load.outcome is Outcome.INACCURATE
    assert len(load.findings[0].frequencies) == stands.sum()


def test_the_proposed_method_says_how_far_standstill_may_put_it_off():
    """Without a certificate, as along a measured record."""
    frictions = {"motor": Coulomb(coulomb_force=8.0), "load": Coulomb(coulomb_force=6.0)}
    signals = replace(on_drive(frictions, (2.0, 3.0), 90.0), verification=None)
    estimator = EffectiveInput(frictions=frictions, nominal_plant=DRIVE, input_dead_time=1e-3)
    found = judged(estimator, signals)
    plant = DRIVE.ports().response(2 * np.pi * found.response.frequency)
    error = np.abs(decibel(plant / found.response.response)).max()
    assert found.outcome is Outcome.INACCURATE
    hidden = next(each for each in found.findings if each.kind == "hidden by standstill")
    assert hidden.place == "contact motor or load"
    assert 0.2 < error < hidden.quantities[0].value < 15 * error


@pytest.mark.parametrize("place", ["motor", "load"])
def test_motion_that_shows_dry_friction_is_ok(place):
    frictions = {"motor": BARELY, "load": BARELY, place: Coulomb(coulomb_force=5.0)}
    signals = on_drive(frictions, (15.0, 25.0), 40.0)
    estimator = EffectiveInput(frictions=frictions, nominal_plant=DRIVE, input_dead_time=1e-3)
    found = judged(estimator, signals)
    plant = DRIVE.ports().response(2 * np.pi * found.response.frequency)
    assert found.outcome is Outcome.OK
    assert np.abs(plant / found.response.response - 1).max() < 0.01
