"""Lightly damped machines, whose motion takes hundreds of periods to repeat: the periodic motion is found in few."""

import numpy as np
import pytest
from fraexp_plugins.controllers.transfer_function import TransferFunction
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.friction.rolling import Rolling

from fraexp.analysis.fourier import phasors
from fraexp.components.kinds import FrictionModel, Plant
from fraexp.components.ports import StateSpace
from fraexp.kernels import batch
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.machines import FRICTIONLESS
from tests.physics.harmonic_balance import Elements, solve
from tests.physics.test_against_harmonic_balance import PUBLISHED, Oscillator, hold

SAMPLE, TIMEOUT = 10e-3, 3000.0
MODES, DAMPING = (2.0, 2.1), 0.004
WINDOWS = 20
"""Maximum number of windows that a point may take."""


class Oscillators(Plant, name="oscillators", version=1):
    """Two lightly damped modes of equal gain, whose transients beat with each other and with the excitation."""

    def state_space(self) -> StateSpace:
        blocks = [np.array([[0.0, 1.0], [-(w**2), -2 * DAMPING * w]]) for w in MODES]
        zero = np.zeros((2, 2))
        a = np.block([[blocks[0], zero], [zero, blocks[1]]])
        return StateSpace(a, np.array([0.0, 1.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0, 0.0]))

    def response(self, omega):
        return sum(1 / (w**2 - omega**2 + 2j * DAMPING * w * omega) for w in MODES)


class Drawn(Plant, name="drawn", version=1):
    """1/(s² + 2 ζ ω s + ω²)."""

    omega: float
    damping: float

    def state_space(self) -> StateSpace:
        a = np.array([[0.0, 1.0], [-(self.omega**2), -2 * self.damping * self.omega]])
        return StateSpace(a, np.array([0.0, 1.0]), np.array([1.0, 0.0]))

    def response(self, omega):
        return 1 / (self.omega**2 - omega**2 + 2j * self.damping * self.omega * omega)


def slow_signals(plant: Plant, friction: FrictionModel, frequencies, amplitude: float, tolerance=1e-5, timeout=TIMEOUT):
    excitation = SteppedSine(
        amplitude=amplitude, frequencies=tuple(frequencies), settling_tolerance=tolerance, settling_timeout=timeout
    )
    loop = ControlLoop(sample_time=SAMPLE, divergence_limit=1e4)
    machine = Machine(plant, friction, TransferFunction(numerator=(0.0,)), loop, Numerics(steps_per_sample=4))
    return simulate_loop(machine, excitation, lambda _: None)


def responses(signals):
    return np.array([(phasors(each, "y") / phasors(each, "u"))[0, 0] for each in signals.segments])


def balanced(dynamic_stiffness, amplitude: float, frequency: float, elements: Elements) -> complex:
    factor = hold(2 * np.pi * frequency, SAMPLE)
    y = solve(dynamic_stiffness, amplitude * abs(factor), elements)[0]
    return complex(y * factor / abs(factor) / amplitude)


@pytest.fixture
def windows(monkeypatch) -> dict[int, int]:
    """How many windows were simulated of each period, counted in samples."""
    found: dict[int, int] = {}

    def advance(laws, jobs, pool, budget):
        status = original(laws, jobs, pool, budget)
        for period, count in zip(
            jobs.arrays.jobs["period"].tolist(), jobs.arrays.results["windows"].tolist(), strict=True
        ):
            found[period] = max(count, found.get(period, 0))
        return status

    original = batch.advance
    monkeypatch.setattr(batch, "advance", advance)
    return found


@pytest.mark.parametrize("amplitude", [1.0, 2.0])
def test_the_published_oscillator_settles_within_twenty_windows(amplitude, windows):
    """Of a time constant of 100 s it would need up to 350; a window is one common period of excitation and samples."""
    friction = Rolling(stiffness=(5.0,), limit_force=(1.0,))
    signals = slow_signals(Oscillator(), friction, PUBLISHED[:, 0], amplitude)
    assert all(segment.settling.settled for segment in signals.segments)
    assert max(windows.values()) <= WINDOWS


def test_modes_that_beat_have_their_response(windows):
    signals = slow_signals(Oscillators(), FRICTIONLESS, (0.25, 0.3125, 0.5, 1.0), 1.0, 1e-6)
    assert all(segment.settling.settled for segment in signals.segments)
    omega = 2 * np.pi * np.array([segment.frequency[0] for segment in signals.segments])
    np.testing.assert_allclose(responses(signals), Oscillators().response(omega) * hold(omega, SAMPLE), rtol=1e-5)
    assert max(windows.values()) <= WINDOWS


@pytest.mark.parametrize("seed", range(4))
def test_drawn_oscillators_agree_with_harmonic_balance(seed):
    draw = np.random.default_rng(seed)
    omega, damping, amplitude = 2 * np.pi * draw.uniform(0.2, 0.6), 10 ** draw.uniform(-2.7, -1.5), draw.uniform(0.1, 3)
    count = draw.integers(1, 5)
    elements = Elements(omega**2 / count * 10 ** draw.uniform(-1.5, 0, count), 10 ** draw.uniform(-2, 0, count))
    friction = Rolling(stiffness=tuple(elements.stiffness), limit_force=tuple(elements.stiffness * elements.width))
    frequencies = sorted(draw.uniform(0.3, 1.5, 4) * omega / 2 / np.pi)
    signals = slow_signals(Drawn(omega=omega, damping=damping), friction, frequencies, amplitude)
    for segment, response in zip(signals.segments, responses(signals), strict=True):
        assert segment.settling.settled
        frequency = float(segment.frequency[0])
        odd = 2 * np.pi * frequency * (2 * np.arange(24) + 1)
        dynamic = omega**2 - odd**2 + 2j * damping * omega * odd
        assert response == pytest.approx(balanced(dynamic, amplitude, frequency, elements), rel=6e-5)


def test_neighbours_do_not_matter():
    """A frequency has the same bits alone, beside others, and behind others in the same lane."""
    friction, frequencies = Rolling(stiffness=(5.0,), limit_force=(1.0,)), tuple(np.linspace(0.1, 0.4, 13))
    together = slow_signals(Oscillator(), friction, frequencies, 2.0)
    for frequency, segment in list(zip(frequencies, together.segments, strict=True))[::4]:
        (alone,) = slow_signals(Oscillator(), friction, (frequency,), 2.0).segments
        assert alone.settling == segment.settling
        assert np.array_equal(alone.channels["y"], segment.channels["y"])


def test_what_would_not_settle_in_time_has_not_settled():
    signals = slow_signals(Oscillator(), Rolling(stiffness=(5.0,), limit_force=(1.0,)), (0.2,), 1.0, timeout=200.0)
    assert not signals.segments[0].settling.settled
