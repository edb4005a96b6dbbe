"""Friction compensation fed back inside the loop, against its closed form P/(1 + P(N - αN̂))."""

import numpy as np
import pytest
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.friction.elastoplastic import Elastoplastic

from fraexp.analysis.delays import hold_response, path_response
from fraexp.analysis.fourier import phasors
from fraexp.data.results import Outcome
from fraexp.data.signals import Signals
from fraexp.simulation.experiments import Compensation
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.machines import LEAD, TABLE, decibel, degrees, guide

FREQUENCIES = tuple(np.geomspace(25.5, 190, 8))
FRICTION = guide()
DEAD_TIME = 1e-3


def compensated(gain: float, amplitude: float, **loop: object) -> Signals:
    settings = {"sample_time": 500e-6, "input_dead_time": DEAD_TIME, **loop}
    machine = Machine(
        TABLE,
        FRICTION,
        LEAD,
        ControlLoop.parse(settings, "loop"),
        Numerics(steps_per_sample=5),
        Compensation(gain=gain, friction=FRICTION),
    )
    excitation = SteppedSine(amplitude=amplitude, frequencies=FREQUENCIES, settling_tolerance=1e-5, settling_timeout=10)
    return simulate_loop(machine, excitation, lambda _: None)


def fundamental(signals: Signals, channel: str) -> np.ndarray:
    return np.array([phasors(segment, channel).mean(axis=0)[0] for segment in signals.segments])


def sine_describing_function(amplitude: np.ndarray) -> np.ndarray:
    """N(A) of Jenkins elements (physics: A. Gelb and W. E. Vander Velde, 1968), summed."""
    stiffness = np.array(FRICTION.stiffness)
    limit = np.array(FRICTION.limit_force) / stiffness
    theta = np.arccos(np.clip(1 - 2 * limit / amplitude[:, None], -1, 1))
    slipping = stiffness / np.pi * (theta - 0.5 * np.sin(2 * theta) + 1j * np.sin(theta) ** 2)
    return np.where(amplitude[:, None] > limit, slipping, stiffness).sum(axis=1)


@pytest.mark.thorough
@pytest.mark.parametrize("amplitude", [12.0, 75.0])
@pytest.mark.parametrize("gain", [0.0, 0.9])
def test_the_response_is_that_of_the_friction_left_over(gain: float, amplitude: float) -> None:
    signals = compensated(gain, amplitude)
    omega = 2 * np.pi * np.concatenate([segment.frequency for segment in signals.segments])
    path = path_response(omega, DEAD_TIME, ()) * hold_response(omega, 500e-6)
    place = fundamental(signals, "displacement")
    plant = TABLE.response(omega)
    # the force that is fed back comes later than friction by dead time and hold
    left_over = sine_describing_function(np.abs(place)) + 1j * omega * FRICTION.viscous
    law = plant / (1 + plant * left_over * (1 - gain * path))
    found = fundamental(signals, "y") / (path * (fundamental(signals, "u") - fundamental(signals, "compensation")))
    error = decibel(found / law)
    print(f"gain {gain:g} at {amplitude:g} N: {np.abs(error).max():.3f} dB, {np.abs(degrees(found / law)).max():.2f}°")
    # the law is that of first harmonics: uncompensated, the third one of these frequencies meets the mode of 80 Hz
    echoing = (gain == 0) & (np.abs(3 * omega / (2 * np.pi) - 80) < 10)
    assert np.abs(error[~echoing]).max() <= 0.1
    assert np.abs(error).max() <= 0.2


def test_too_much_of_it_is_an_outcome() -> None:
    signals = compensated(30.0, 12.0, divergence_limit=5e-3)
    assert signals.outcome is Outcome.DIVERGED


@pytest.mark.thorough
def test_another_law_than_the_machines_may_be_fed_back_and_is_computed_one_by_one_if_it_must() -> None:
    model = Elastoplastic.model_validate(Elastoplastic.presets["linear_motor_table"])
    assert FRICTION.is_vectorisable and not model.is_vectorisable
    machine = Machine(
        TABLE,
        FRICTION,
        LEAD,
        ControlLoop(sample_time=500e-6),
        Numerics(steps_per_sample=4),
        Compensation(gain=0.8, friction=model),
    )
    signals = simulate_loop(machine, SteppedSine(amplitude=75.0, frequencies=(40.0,)), lambda _: None)
    segment = signals.segments[0]
    assert "implicitly" in signals.numerics
    # driven along the measured positions of a period, from where it is periodic, the model gives what was fed back
    again = model.force(segment.channels["y"].ravel(), 500e-6, periodic=True)
    velocity = np.diff(segment.channels["y"].ravel(), prepend=segment.channels["y"].ravel()[-1]) / 500e-6
    expected = 0.8 * (again + model.viscous * velocity)
    found = segment.channels["compensation"].ravel()
    assert np.abs(found - expected).max() <= 2e-3 * np.abs(expected).max()
