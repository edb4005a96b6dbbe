"""The conventional response against harmonic balance: a published frictional oscillator, and the paper's loop."""

import numpy as np
import pytest
from fraexp_plugins.controllers.transfer_function import TransferFunction
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.friction.rolling import Rolling

from fraexp.components.kinds import Plant
from fraexp.components.ports import StateSpace
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.machines import LEAD, TABLE, guide
from tests.physics.harmonic_balance import Elements, solve

OSCILLATOR_SAMPLE, LOOP_SAMPLE, DEAD_TIME = 10e-3, 500e-6, 1e-3
PUBLISHED = np.array(
    [  # Hz, dB re 1 mm/N, degrees, third over first harmonic
        [0.10, 42.6114, -14.135, 0.08606],
        [0.20, 44.9137, -16.402, 0.06815],
        [0.30, 61.7250, -39.370, 0.00573],
        [0.40, 54.1991, -147.168, 0.00638],
        [0.45, 50.3042, -152.378, 0.00675],
        [0.50, 47.5383, -157.329, 0.00624],
        [0.60, 43.3988, -167.530, 0.00385],
    ]
)
"""ẍ + 0.02 ẋ + 4 x + f(x) = 2 cos ωt with one element of 5 N/m that slips at 1 N; 31 harmonics."""
ONE = Elements(np.array([5.0]), np.array([0.2]))
FRICTION = guide()


class Oscillator(Plant, name="oscillator", version=1):
    """1/(s² + 0.02 s + 4)."""

    def state_space(self) -> StateSpace:
        return StateSpace(np.array([[0.0, 1.0], [-4.0, -0.02]]), np.array([0.0, 1.0]), np.array([1.0, 0.0]))

    def response(self, omega):
        return 1 / (4 - omega**2 + 0.02j * omega)


def hold(omega, sample_time):
    """Return the zero-order hold, (1 - e^{-jωTs})/(jωTs)."""
    return (1 - np.exp(-1j * omega * sample_time)) / (1j * omega * sample_time)


def balanced_oscillator(frequency: float, thrust: complex) -> np.ndarray:
    omega = 2 * np.pi * frequency * (2 * np.arange(16) + 1)
    return solve(4 - omega**2 + 0.02j * omega, thrust, ONE)


def conventional(machine: Machine, excitation: SteppedSine):
    response = Conventional().estimate(simulate_loop(machine, excitation, lambda _: None)).response
    assert response.settled.all()
    return response


def oscillator_errors(amplitude: float, numerics: Numerics) -> tuple[list[float], list[float]]:
    """Return how far response and third harmonic are from harmonic balance; the hold's factor is on the thrust."""
    excitation = SteppedSine(
        amplitude=amplitude, frequencies=tuple(PUBLISHED[:, 0]), settling_tolerance=1e-7, settling_timeout=3000.0
    )
    friction = Rolling(stiffness=(5.0,), limit_force=(1.0,))
    loop = ControlLoop(sample_time=OSCILLATOR_SAMPLE, divergence_limit=100.0)
    machine = Machine(Oscillator(), friction, TransferFunction(numerator=(0.0,)), loop, numerics)
    found, errors, thirds = conventional(machine, excitation), [], []
    for frequency, response, third in zip(found.frequency, found.response, found.harmonics[:, 1], strict=True):
        factor = hold(2 * np.pi * frequency, OSCILLATOR_SAMPLE)
        y = balanced_oscillator(frequency, amplitude * abs(factor))
        expected = y[0] * factor / abs(factor) / amplitude
        errors.append(abs(response / expected - 1))
        thirds.append(abs(abs(third) - abs(y[1] / y[0])))
    return errors, thirds


@pytest.mark.parametrize("row", PUBLISHED, ids=lambda row: f"{row[0]:g}Hz")
def test_harmonic_balance_gives_the_published_table(row):
    frequency, decibel, degrees, third = row
    y = balanced_oscillator(frequency, 2.0)
    assert 20 * np.log10(abs(y[0]) / 2 * 1e3) == pytest.approx(decibel, abs=1e-4)
    assert np.angle(y[0], deg=True) == pytest.approx(degrees, abs=4e-3)  # 5e-5 of the response
    assert abs(y[1] / y[0]) == pytest.approx(third, abs=1e-5)


@pytest.mark.parametrize("amplitude", [1.0, 2.0])
def test_the_published_oscillator_driven_open_loop(amplitude):
    errors, thirds = oscillator_errors(amplitude, Numerics(steps_per_sample=4))
    assert max(errors) < 2e-5
    assert max(thirds) < 1e-5


@pytest.mark.parametrize("amplitude", [1.0, 2.0])
def test_so_it_is_within_the_tolerance_at_the_steps_that_are_chosen(amplitude):
    assert max(oscillator_errors(amplitude, Numerics())[0]) < Numerics().tolerance


def balanced_loop(frequency: float, amplitude: float) -> complex:
    """Return y'/u of the paper's loop; its images are neglected."""
    omega = 2 * np.pi * frequency * (2 * np.arange(24) + 1)
    z = np.exp(-1j * omega * LOOP_SAMPLE)
    numerator, denominator = LEAD.transfer_function(LOOP_SAMPLE)
    controller = np.polyval(numerator[::-1], z) / np.polyval(denominator[::-1], z)
    path = hold(omega, LOOP_SAMPLE) * np.exp(-1j * omega * DEAD_TIME)
    elements = Elements(np.array(FRICTION.stiffness), np.array(FRICTION.limit_force) / FRICTION.stiffness)
    around = 1 / TABLE.response(omega) + 1j * omega * FRICTION.viscous + path * controller
    y = solve(around, complex(path[0] * amplitude), elements)[0]
    return complex(y / (amplitude - controller[0] * y))


@pytest.mark.parametrize("amplitude", [12.0, 75.0])
def test_the_papers_loop(amplitude):
    """Up to 80 Hz: beyond it the hold's images, which harmonic balance neglects, are more than 5e-5."""
    loop, frequencies = (
        ControlLoop(sample_time=LOOP_SAMPLE, input_dead_time=DEAD_TIME),
        (2.0, 5.0, 12.0, 25.0, 40.0, 80.0),
    )
    for numerics, bound in ((Numerics(), 1e-4), (Numerics(steps_per_sample=20), 2e-5)):
        machine = Machine(TABLE, FRICTION, LEAD, loop, numerics)
        found = conventional(machine, SteppedSine(amplitude=amplitude, frequencies=frequencies))
        expected = [balanced_loop(frequency, amplitude) for frequency in found.frequency]
        assert np.max(np.abs(found.response / expected - 1)) < bound
