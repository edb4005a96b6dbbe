"""A record in whose loop noise goes round begins where no replay of it ends."""

from functools import partial

import numpy as np
import pytest
from fraexp_plugins.identification._record_fit import RecordFit, State

from fraexp.components.kinds import Controller, Estimator, Excitation, FrictionModel, Plant
from fraexp.components.registry import create
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics

RESOLUTION, NOISE = 1e-7, 2e-7
PLANT = {
    "name": "modal", "rigid_body_gain": 0.05, "frequencies": [62], "damping_ratios": [0.02], "modal_gain_ratios": [0.3],
}  # fmt: skip
FRICTION = {
    "name": "lugre", "bristle_stiffness": 1.2e6, "bristle_damping": 300, "viscous_coefficient": 12,
    "coulomb_force": 25, "static_force": 33, "stribeck_velocity": 0.004,
}  # fmt: skip
CONTROLLER = {"name": "pid", "proportional": 20000, "derivative_time": 0.03, "filter_time": 0.003}
LOOP = {"sample_time": 5e-4, "input_dead_time": 1e-3, "resolution": RESOLUTION}
SHAPE = ("viscous_coefficient", "static_force", "bristle_damping", "stribeck_velocity")


def record_sines(registry, seed, **sines):
    """Return what the machine with noise of this seed records of sines of 45 N."""
    machine = Machine(
        create(registry, Plant, PLANT),
        create(registry, FrictionModel, FRICTION),
        create(registry, Controller, CONTROLLER),
        ControlLoop.parse({**LOOP, "noise": NOISE, "seed": seed}, "loop"),
        Numerics(),
    )
    spec = {"name": "stepped_sine", "amplitude": 45.0, **sines}
    return simulate_loop(machine, create(registry, Excitation, spec), lambda _: None)


@pytest.fixture(scope="module")
def recorded(registry):
    """Return what records the machine with noise of this seed."""

    return partial(record_sines, registry)


@pytest.fixture(scope="module")
def estimator(registry):
    spec = {
        "name": "maximum_likelihood", "friction": FRICTION, "free": ("force_scale", "displacement_scale", *SHAPE),
        "resolution": RESOLUTION, "noise": NOISE, "input_dead_time": LOOP["input_dead_time"],
    }  # fmt: skip
    return create(registry, Estimator, spec)


def test_a_replay_with_its_own_start_is_the_true_motion(registry, recorded, estimator):
    """A periodic replay of the right machine is off by more than the noise, so that a wrong one is likelier."""
    signals = recorded(2, frequencies=[1.5, 2.0, 3.0])
    fit = RecordFit.around(estimator.problem(signals, NOISE, estimator.law), create(registry, Plant, PLANT))
    state = State(np.zeros(len(fit.free.names)), tuple(np.zeros(record.count) for record in fit.records))
    (periodic,) = fit._positions([state])
    off, left = [], []
    for record, position in zip(fit.with_needed_drifts(state).records, periodic, strict=True):
        settled = record.settled_samples
        off.append((record.segment.channels["displacement"].ravel() - position)[settled])
        left.append(off[-1] - record.drift_in(off[-1]) @ record.drifts[:, settled])
    assert max(np.std(each) for each in off) > NOISE
    assert max(np.std(each) for each in left) < 0.1 * NOISE


@pytest.mark.thorough
def test_intervals_hold_the_law_in_a_loop_with_noise(recorded, estimator):
    result = estimator.estimate(recorded(2, min_frequency=1.5, max_frequency=150, points=20))
    found = {metric.name: metric.value for metric in result.metrics}
    true = {"force_scale": 1.0, "displacement_scale": 1.0, **FRICTION}
    off = {name: abs(found[name] - true[name]) / found[f"{name}, 95 %"] for name in estimator.free}
    assert max(off.values()) < 1.5, off
