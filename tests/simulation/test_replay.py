"""A machine along its own record: it repeats every sample within what rounding leaves."""

import numpy as np
import pytest

from fraexp.components.kinds import Controller, Excitation, FrictionModel, Plant
from fraexp.components.registry import create
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from fraexp.simulation.replay import Replay, ReplayModel, replay

RESOLUTION = 1e-7
FRICTION = {"name": "rolling", "stiffness": [1e6, 5e5, 5e5], "limit_force": [2.0, 4.0, 8.0]}


def damping_along(run):
    """Return half of the mean power over the mean square velocity: that of a slow motion against Coulomb friction."""
    velocity = np.gradient(run.position, run.model.sample_time)
    return np.mean(run.control_input * velocity) / (2 * np.mean(velocity**2))


@pytest.mark.parametrize("is_weak", [False, True])
@pytest.mark.parametrize("viscous", [0.5, 200.0])
def test_the_machine_of_a_record_repeats_it_however_viscous_its_friction_is(registry, viscous, is_weak):
    plant = create(registry, Plant, {"name": "modal", "rigid_body_gain": 0.85})
    friction = create(registry, FrictionModel, {**FRICTION, "viscous_coefficient": viscous})
    pid = {"name": "pid", "proportional": 1600.0, "derivative_time": 0.04, "filter_time": 6e-3}
    loop = ControlLoop.parse({"sample_time": 2.5e-4, "resolution": RESOLUTION}, "loop")
    machine = Machine(plant, friction, create(registry, Controller, pid), loop, Numerics())
    sine = {"name": "stepped_sine", "amplitude": 30.0, "frequencies": [2.7, 3.7, 30.0], "settling_tolerance": 1e-6}
    signals = simulate_loop(machine, create(registry, Excitation, sine), lambda _: None)
    (contact,) = plant.ports().contacts
    model = ReplayModel(plant.ports(), {contact: friction}, loop.sample_time, (0.0, ()), (0.0, ()), 1e-5)
    runs = [
        Replay(model, segment.channels["u"].ravel(), segment.channels["y"].ravel(), segment.frequency)
        for segment in signals.segments
    ]
    if is_weak:
        runs = [run._replace(damping=damping_along(run)) for run in runs]
    for run, replayed in zip(runs, replay(runs), strict=True):
        residual = run.position - replayed.position
        residual -= residual.mean()
        assert np.sqrt(np.mean(residual**2)) < 1.15 * RESOLUTION / np.sqrt(12)


def test_a_weak_pull_takes_hardly_any_noise_of_the_record_into_the_model(registry):
    """The likelihood takes the record less the model for the noise alone."""
    plant = create(registry, Plant, {"name": "modal", "rigid_body_gain": 0.85})
    friction = create(registry, FrictionModel, FRICTION)
    (contact,) = plant.ports().contacts
    sample_time, frequency, size = 2.5e-4, 10.0, 3200
    model = ReplayModel(plant.ports(), {contact: friction}, sample_time, (0.0, ()), (0.0, ()), 1e-6)
    wave = np.exp(2j * np.pi * frequency * sample_time * np.arange(size))
    run = Replay(model, 30 * wave.imag, np.zeros(size), np.array([frequency]))
    run = run._replace(position=replay([run])[0].position)
    noise = 1e-8 * np.sqrt(2) * np.real(np.exp(0.7j) * wave)
    taken = []
    for damping in (None, damping_along(run)):
        clean = run._replace(damping=damping)
        noisy = clean._replace(position=run.position + noise)
        without, with_noise = (each.position for each in replay([clean, noisy]))
        taken.append(np.std(with_noise - without) / np.std(noise))
    assert taken[1] < 0.15
    assert taken[0] > 3 * taken[1]
