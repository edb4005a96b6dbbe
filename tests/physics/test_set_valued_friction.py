"""Coulomb friction in the loop against a simulation that locates each event: stick and slip are exact in the step."""

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.friction.coulomb import Coulomb

from fraexp.simulation.discretisation import step_bounds
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.machines import LEAD, TABLE

SAMPLE_TIME, DEAD_SAMPLES, AMPLITUDE = 5e-4, 2, 25.0
COULOMB = Coulomb(coulomb_force=17.9, viscous_coefficient=4.69)


def found(friction, frequency, steps=0, rest=0.0):
    """Return the conventional response of the paper's machine with this friction."""
    loop = ControlLoop(sample_time=SAMPLE_TIME, input_dead_time=DEAD_SAMPLES * SAMPLE_TIME + rest)
    machine = Machine(TABLE, friction, LEAD, loop, Numerics(steps_per_sample=steps))
    signals = simulate_loop(machine, SteppedSine(amplitude=AMPLITUDE, frequencies=(frequency,)), lambda _: None)
    return Conventional().estimate(signals).response.response[0]


@pytest.mark.parametrize("rest", [0.0, 0.13 * SAMPLE_TIME, 0.55 * SAMPLE_TIME])
def test_the_error_falls_with_the_square_of_the_step(rest):
    """Also where the dead time ends within a step of a sample that is divided evenly."""
    coarse, halved, fine = (found(COULOMB, 205.9, steps, rest) for steps in (5, 10, 40))
    assert 3 < abs(coarse - fine) / abs(halved - fine) < 6


def test_steps_end_where_the_thrust_jumps():
    for jump in (1e-9, 0.2, 0.5, 0.999):
        bounds = np.array(step_bounds(1.0, 7, jump))
        assert bounds.size == 8
        assert (bounds[0], bounds[-1]) == (0.0, pytest.approx(1.0))
        assert np.all(np.diff(bounds) > 1e-4)
        assert np.diff(bounds).max() < 2 / 7
        assert jump < 1e-4 or np.abs(bounds - jump).min() == 0


@pytest.mark.thorough
def test_a_stated_stop_is_a_spring_and_converges_to_the_ideal():
    """The law with a stop is solved in displacements, the ideal one in velocities."""
    ideal, *stops = (
        found(COULOMB.model_copy(update={"stiction_displacement": stop}), 20.0) for stop in (None, 1e-8, 1e-9)
    )
    errors = [abs(stop / ideal - 1) for stop in stops]
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < 1e-3


def test_each_direction_has_its_own_friction():
    """On a table pushed to and fro, the mean friction force in motion is that of each way."""
    lopsided = COULOMB.model_copy(update={"negative_ratio": 0.5})
    loop = ControlLoop(sample_time=SAMPLE_TIME, input_dead_time=DEAD_SAMPLES * SAMPLE_TIME)
    machine = Machine(TABLE, lopsided, LEAD, loop, Numerics())
    signals = simulate_loop(machine, SteppedSine(amplitude=75.0, frequencies=(10.0,)), lambda _: None)
    force, y = (signals.segments[0].channels[name][0] for name in ("friction", "displacement"))
    speed = (np.roll(y, -1) - np.roll(y, 1)) / (2 * SAMPLE_TIME)
    assert force[speed > 0.2 * speed.max()] == pytest.approx(17.9, rel=1e-6)
    assert force[speed < 0.2 * speed.min()] == pytest.approx(-8.95, rel=1e-6)
