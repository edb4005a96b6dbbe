"""Generalized Maxwell slip: the rolling model without Stribeck effect, frictional lag and continuity with it."""

import numpy as np
import pytest
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip

from tests.machines import cosine, harmonic

REFERENCE = GeneralizedMaxwellSlip.parse(GeneralizedMaxwellSlip.presets["reference"], "gms")


def test_the_lag_is_that_of_the_exact_exponential():
    """All elements slip, so F' = C (1 - F/S): at small changes of S a first-order lag of time constant S/C."""
    points, frequency = 4000, 3.0
    omega = 2 * np.pi * frequency
    time = np.arange(20 * points + 1) / points / frequency
    y = 1e-3 * (time + 1e-3 * (1 - np.cos(omega * time)) / omega)
    force = REFERENCE.force(y, time[1])[-points:]
    steady, slope = 1 + 0.5 * np.exp(-1), -0.5 * 2 * np.exp(-1) / 1e-3
    swing = slope * 1e-6 / (1 + 1j * omega * steady / 20.0)  # answers the velocity's sine
    assert harmonic(force) == pytest.approx(-1j * swing, rel=5e-3)


def test_the_force_is_continuous_where_the_velocity_changes_sign():
    changes = []
    for points in (1000, 2000, 4000):
        y = np.tile(cosine(40e-6, points), 3)
        force = REFERENCE.force(y, 1 / points)
        changes.append(np.max(np.abs(np.diff(force[points:]))))
    assert changes[0] < 0.05
    assert changes[0] / changes[1] == pytest.approx(2, rel=0.1)  # no more than the path times the stiffness
    assert changes[1] / changes[2] == pytest.approx(2, rel=0.1)


def test_the_force_is_continuous_when_a_sticking_element_is_set_going_fast():
    """Elements that stick under more than the new, lower limit relax towards it at the rate C/S."""
    jumps = []
    for step in (1e-4, 1e-5):
        creeping = np.arange(int(25e-6 / 1e-5 / step) + 1) * 1e-5 * step
        fast = creeping[-1] + np.arange(1, 3) * 1e-2 * step
        force = REFERENCE.force(np.concatenate([creeping, fast]), step)
        jumps.append(abs(force[creeping.size] - force[creeping.size - 1]))
    assert jumps[1] < 0.2 * jumps[0]
    assert jumps[0] < 0.1


def test_what_was_before_may_decide_the_periodic_force():
    """An element with Fc/Fs Y < A < Y slips in every period or in none, as its past has it."""
    one = GeneralizedMaxwellSlip(
        stiffness=(1e5,),
        force_fractions=(1.0,),
        coulomb_force=1.0,
        static_force=1.5,
        stribeck_velocity=1e-3,
        attraction_rate=5000.0,
    )
    y = cosine(12e-6)  # between 10 and 15 µm; at 30 Hz, whose velocity is above the Stribeck velocity
    step = 1 / 30 / y.size
    at_rest = np.tile(y, 12)  # from the peak: at first the element is stretched one way only, and slips
    rising = np.concatenate([np.arange(y.size) / y.size * y, np.tile(y, 12)])
    swings = [abs(harmonic(one.force(path, step)[-y.size :])) for path in (at_rest, rising)]
    assert swings[1] == pytest.approx(1e5 * 12e-6, rel=1e-9)  # a spring all the time
    assert swings[0] < 0.99 * swings[1]
    level = one.model_copy(update={"static_force": 1.0})
    swings = [abs(harmonic(level.force(path, step)[-y.size :])) for path in (at_rest, rising)]
    assert swings[0] == pytest.approx(swings[1], rel=1e-9)  # the rolling model forgets
