"""Dahl and LuGre friction against their closed forms."""

import numpy as np
import pytest
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.lugre import LuGre
from scipy.special import ive

from tests.machines import along, cosine, harmonic, work

FC, SIGMA = 2.0, 5e4
DAHL = Dahl(stiffness=SIGMA, coulomb_force=FC)
REFERENCE = LuGre.parse(LuGre.presets["canudas_de_wit_1995"], "lugre")
RATIOS = (0.05, 0.3, 1.0, 3.0, 10.0, 40.0)


@pytest.mark.parametrize("a", RATIOS)
def test_describing_function(a):
    amplitude = a * FC / SIGMA
    found = harmonic(DAHL.force(cosine(amplitude), 1e-4, periodic=True)) / amplitude
    bessel = 2 * ive(1, a) / (1 + np.exp(-2 * a))  # I1(a)/cosh(a), without overflow
    expected = 2 * FC / amplitude * bessel + 4j * FC / (np.pi * amplitude) * (1 - np.tanh(a) / a)
    assert abs(found / expected - 1) < 1e-6


@pytest.mark.parametrize("a", RATIOS)
def test_peak_and_energy_of_the_steady_loop(a):
    y = cosine(a * FC / SIGMA)
    force = DAHL.force(y, 1e-4, periodic=True)
    assert force[0] == pytest.approx(FC * np.tanh(a), rel=1e-9)
    assert work(force, y) == pytest.approx(4 * FC * (y[0] - FC / SIGMA * np.tanh(a)), rel=1e-4 / a)  # trapezoidal rule


def test_branch_after_a_reversal():
    turn = 60e-6
    y = along(0, turn, -turn)
    force = DAHL.force(y, 1e-4)
    at_turn, back = FC * (1 - np.exp(-SIGMA * turn / FC)), slice(200, None)
    expected = -FC + (at_turn + FC) * np.exp(-SIGMA * (turn - y[back]) / FC)
    assert np.allclose(force[back], expected, rtol=0, atol=1e-12 * FC)


def test_return_points_are_forgotten():
    """Dahl's model has no nonlocal memory: a minor loop does not close, and so does not lead back to the outer one."""
    visits = np.array([0, 1.5, -1.2, 1, -0.3, 0.7, -0.3, 1, -1.2, 1.5]) * FC / SIGMA
    force = DAHL.force(along(*visits), 1e-4)[::200]
    for first, again in ((1, 9), (2, 8), (3, 7), (4, 6)):
        assert visits[first] == visits[again]
        assert abs(force[first] - force[again]) > 1e-3 * FC


@pytest.mark.parametrize("velocity", [2e-5, -3e-4, 1e-3, -1e-2])
def test_lugre_approaches_the_stribeck_curve_exponentially(velocity):
    lugre = REFERENCE.model_copy(update={"bristle_damping": 0.0})  # then the force is sigma0 z
    time = np.linspace(0, 40e-6 / abs(velocity), 200)
    force = lugre.force(velocity * time, time[1])
    steady = 1.0 + 0.5 * np.exp(-((velocity / 1e-3) ** 2))
    expected = np.sign(velocity) * steady * (1 - np.exp(-1e5 * abs(velocity) * time / steady))
    assert np.allclose(force, expected, rtol=0, atol=1e-12)


def test_lugre_damping_is_of_second_order_in_the_step():
    """The force of its bristles' rate, sigma1 dz/dt, from the closed form of a sine that no bristle slips in."""
    lugre, omega, amplitude = REFERENCE, 2 * np.pi * 50, 1e-13
    errors = []
    for points in (100, 200, 400):
        force = lugre.force(cosine(amplitude, points), 1 / 50 / points, periodic=True)
        errors.append(abs(harmonic(force) / amplitude / (1e5 + 1j * omega * lugre.bristle_damping) - 1))
    assert errors[0] < 5e-3
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
