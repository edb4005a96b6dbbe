"""The check of a simulation, against the same machine in steps so fine that their error does not count."""

import numpy as np
import pytest
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.excitations.displacement_sine import DisplacementSine
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.modal import Modal
from fraexp_plugins.positioning.point_to_point import PointToPoint

from fraexp.components.kinds import Excitation, FrictionModel
from fraexp.data.signals import Signals
from fraexp.simulation.loop import drive_friction, simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.examples import some, thorough

STIFFNESS = (4e5, 2.5e5, 1.2e5, 6e4, 3e4, 1.2e4, 5e3)
WIDTHS = (2e-6, 5e-6, 12e-6, 25e-6, 45e-6, 80e-6, 140e-6)
ELEMENTS = {"stiffness": STIFFNESS, "limit_force": tuple(k * y for k, y in zip(STIFFNESS, WIDTHS, strict=True))}
NARROW = Rolling(**ELEMENTS, viscous_coefficient=60.0)
DAMPED = Rolling(**ELEMENTS, viscous_coefficient=2.0, damping=(300.0, 200.0, 150.0, 100.0, 60.0, 30.0, 15.0))
PLANT = Modal(
    rigid_body_gain=0.5, frequencies=(23.0, 140.0), damping_ratios=(0.01, 0.3), modal_gain_ratios=(0.15, -0.4)
)
BRISTLES = LuGre(bristle_stiffness=1e6, bristle_damping=300.0, coulomb_force=12.0, static_force=18.0)
FREQUENCIES = (5.0, 20.0, 60.0, 100.0)


SINE = SteppedSine(amplitude=8.0, frequencies=FREQUENCIES, settling_tolerance=1e-7)
MOVE = PointToPoint(
    targets=(1e-3, 0.2e-3), duration=0.05, dwell_time=0.1, profile="jerk_limited", plant=PLANT, friction=None
)


def signals(
    friction: FrictionModel,
    steps: int = 0,
    resolution: float = 0.0,
    tolerance: float = 1e-4,
    excitation: Excitation = SINE,
) -> Signals:
    """A machine that was not chosen to suit the preset, at 8 N."""
    loop = ControlLoop(
        sample_time=0.8e-3,
        input_dead_time=1.04e-3,
        output_dead_time=0.36e-3,
        input_time_constants=(0.6e-3,),
        resolution=resolution,
    )
    controller = Pid(proportional=800.0, derivative_time=0.03, filter_time=0.004)
    machine = Machine(PLANT, friction, controller, loop, Numerics(steps_per_sample=steps, tolerance=tolerance))
    return simulate_loop(machine, excitation, lambda _: None)


def response(of: Signals) -> np.ndarray:
    found = Conventional().estimate(of).response
    assert found is not None
    return found.response


@pytest.mark.parametrize("friction", [NARROW, thorough(DAMPED)], ids=["narrow", "damped"])
def test_the_steps_are_those_that_the_tolerance_needs(friction):
    truth, found = response(signals(friction, steps=150)), signals(friction)
    assert np.max(np.abs(response(found) / truth - 1)) < 1e-4
    assert found.verification.step_error.max() <= 1e-4


@pytest.mark.parametrize("steps", some([1, 4, 9], 4))
@pytest.mark.parametrize("friction", [NARROW, thorough(DAMPED)], ids=["narrow", "damped"])
def test_the_estimated_error_is_about_the_true_one(friction, steps):
    truth, found = response(signals(friction, steps=150)), signals(friction, steps=steps)
    error, estimated = np.abs(response(found) / truth - 1).max(), found.verification.step_error.max()
    assert 0.4 * error <= estimated <= 10 * error


@pytest.mark.parametrize("steps", some([4, 9], 9))
@pytest.mark.parametrize("friction", [NARROW, thorough(DAMPED)], ids=["narrow", "damped"])
def test_the_estimated_error_of_a_move_is_about_the_true_one(friction, steps):
    truth, found = (signals(friction, steps=each, excitation=MOVE) for each in (150, steps))
    exact, y = (each.segments[0].channels["y"] for each in (truth, found))
    error, estimated = np.abs(y - exact).max() / np.ptp(exact), found.verification.step_error.max()
    assert 0.4 * error <= estimated <= 10 * error


@pytest.mark.thorough
def test_a_move_takes_the_steps_that_the_tolerance_needs():
    exact, y = (
        signals(DAMPED, steps=steps, excitation=MOVE, tolerance=1e-5).segments[0].channels["y"] for steps in (150, 0)
    )
    assert np.abs(y - exact).max() < 1e-5 * np.ptp(exact)


@pytest.mark.parametrize("sample_time", [5e-4, 1e-3])
def test_the_estimated_error_of_a_driven_law_is_about_the_true_one(sample_time):
    """The reference drives the law with the same displacement in thirty times as many samples."""
    coarse, fine = (
        drive_friction(BRISTLES, DisplacementSine(amplitude=1e-4, frequency=1.0), each)
        for each in (sample_time, sample_time / 30)
    )
    force, exact = (each.segments[0].channels["friction"][0] for each in (coarse, fine))
    error, estimated = np.abs(force - exact[::30]).max() / np.ptp(exact), coarse.verification.step_error.max()
    assert 0.4 * error <= estimated <= 10 * error


def test_the_encoder_has_no_part_in_it():
    ideal, coarse = (signals(NARROW, resolution=resolution).verification for resolution in (0.0, 1e-6))
    assert coarse.step_error == pytest.approx(ideal.step_error, rel=1e-2, abs=1e-6)


def test_a_loose_tolerance_takes_fewer_steps():
    loose, tight = (int(signals(NARROW, tolerance=each).numerics.split()[0]) for each in (1e-2, 1e-4))
    assert loose < tight
