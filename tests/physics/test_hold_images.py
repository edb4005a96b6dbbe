"""The paper's loop at 150 Hz against harmonic balance with the images of the hold.

The held thrust of a sine at f has images at m/Ts ± f, which move the table, and which the samples fold back on f. All
of these are odd multiples of the greatest common divisor of f and 1/Ts, so that one Fourier series describes them.
"""

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from numpy.typing import NDArray

from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.examples import some
from tests.machines import LEAD, TABLE, guide
from tests.physics.harmonic_balance import Elements, solve_contacts

SAMPLE_TIME, DEAD_TIME = 500e-6, 1e-3
BASE = 50.0
"""Greatest common divisor of 150 Hz and 2 kHz [Hz]."""
PER_SAMPLE, DRIVEN = 40, 3
"""Sampling frequency and excited frequency, in multiples of it."""
ORDERS = 2 * np.arange(45) + 1
"""Up to 4450 Hz: two pairs of images."""
BASEBAND = PER_SAMPLE // 2
ROUNDS = 5
"""The images are 1e-4 of the motion: each round makes their error that much smaller."""
FRICTION = guide()


def at(order: int, values: NDArray[np.complex128]) -> complex:
    """Return the phasor at an order that may be negative; 0 beyond the last one."""
    place = (abs(order) - 1) // 2
    value = complex(values[place]) if place < values.size else 0j
    return value if order > 0 else value.conjugate()


def folded(motion: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the phasors of the samples, at the orders below the Nyquist frequency."""
    return np.array([sum(at(int(k) + m * PER_SAMPLE, motion) for m in range(-2, 3)) for k in ORDERS if k < BASEBAND])


def balanced(amplitude: float) -> tuple[complex, complex]:
    """Return y'/u at 150 Hz with and without the images."""
    omega = 2 * np.pi * BASE * ORDERS
    z = np.exp(-1j * omega * SAMPLE_TIME)
    numerator, denominator = LEAD.transfer_function(SAMPLE_TIME)
    controller = np.polyval(numerator[::-1], z) / np.polyval(denominator[::-1], z)
    path = (1 - z) / (1j * omega * SAMPLE_TIME) * np.exp(-1j * omega * DEAD_TIME)
    stiffness = 1 / TABLE.response(omega) + 1j * omega * FRICTION.viscous
    inside = BASEBAND > ORDERS
    compliance = 1 / (stiffness + np.where(inside, path * controller, 0.0))
    elements = Elements(np.array(FRICTION.stiffness), np.array(FRICTION.limit_force) / FRICTION.stiffness)
    reference = amplitude * (ORDERS == DRIVEN)
    motion, responses = np.zeros(ORDERS.size, dtype=complex), []
    for _ in range(ROUNDS):
        samples = np.zeros(ORDERS.size, dtype=complex)
        samples[inside] = folded(motion)
        control = (reference - controller * samples)[inside]
        aliases = np.array([at(int((k + BASEBAND) % PER_SAMPLE - BASEBAND), control) for k in ORDERS])
        thrust = np.where(inside, reference - controller * (samples - motion), aliases)
        motion = solve_contacts(compliance[:, None, None], (compliance * path * thrust)[:, None], [elements], 3072)[
            :, 0
        ]
        place = (DRIVEN - 1) // 2
        found = folded(motion)[place] if responses else motion[place]
        responses.append(complex(found / (amplitude - controller[place] * found)))
    return responses[-1], responses[0]


@pytest.mark.parametrize("amplitude", some([12.0, 75.0], 12.0))
def test_the_images_of_the_hold_are_in_the_response(amplitude):
    """Harmonic balance without them is 1.9e-4 off."""
    expected, without = balanced(amplitude)
    assert abs(without / expected - 1) > 1e-4
    loop, excitation = ControlLoop(sample_time=SAMPLE_TIME, input_dead_time=DEAD_TIME), (BASE * DRIVEN,)
    for numerics, bound in ((Numerics(), 1e-4), (Numerics(steps_per_sample=20), 2e-5)):
        signals = simulate_loop(
            Machine(TABLE, FRICTION, LEAD, loop, numerics),
            SteppedSine(amplitude=amplitude, frequencies=excitation, settling_tolerance=1e-6),
            lambda _: None,
        )
        found = Conventional().estimate(signals).response
        assert abs(found.response[0] / expected - 1) < bound
