"""Elastoplastic friction: an exact spring up to its elastic limit, LuGre beyond it."""

import numpy as np
import pytest
from fraexp_plugins.friction.elastoplastic import Elastoplastic, _deflection_at_alpha
from scipy.integrate import solve_ivp

from tests.machines import along, cosine

REFERENCE = Elastoplastic.parse(Elastoplastic.presets["dupont_2002"], "elastoplastic")
UNDAMPED = REFERENCE.model_copy(update={"bristle_damping": 0.0})  # the force is sigma0 z
ELASTIC = 0.7 * 1.0 / 1e5  # m


def test_it_is_a_spring_on_the_way_back():
    y = along(0, 100e-6, 100e-6 - 15e-6)  # from full slip through zero to the elastic limit of the other side
    force = UNDAMPED.force(y, 1.0)[200:]
    assert force[0] == pytest.approx(1.5, rel=1e-3)
    assert np.allclose(np.diff(force), 1e5 * np.diff(y[200:]), rtol=0, atol=1e-12)


def test_it_has_no_drift_within_the_elastic_limit_even_from_full_slip():
    ripple = 100e-6 - 13e-6 + np.tile(cosine(4e-6, 100), 50)
    force = UNDAMPED.force(np.concatenate([along(0, 100e-6), ripple]), 1.0)[201:]
    assert np.allclose(force, np.tile(force[:100], 50), rtol=0, atol=1e-11)


def alpha(z: float, v: float, steady: float) -> float:
    if np.sign(z) != np.sign(v) or abs(z) <= ELASTIC:
        return 0.0
    if abs(z) >= steady:
        return 1.0
    return 0.5 + 0.5 * np.sin(np.pi * (abs(z) - (steady + ELASTIC) / 2) / (steady - ELASTIC))


@pytest.mark.parametrize("frequency", [0.5, 20.0])
def test_it_converges_to_its_differential_equation(frequency):
    omega, amplitude = 2 * np.pi * frequency, 30e-6

    def right(time: float, z: np.ndarray) -> list[float]:
        v = amplitude * omega * np.cos(omega * time)
        steady = (1.0 + 0.5 * np.exp(-((v / 1e-3) ** 2))) / 1e5
        return [v * (1 - alpha(z[0], v, steady) * np.sign(v) * z[0] / steady)]

    end, errors = 1.7 / frequency, []
    answer = solve_ivp(right, (0, end), [0.0], rtol=1e-9, atol=1e-14, max_step=end / 2000)
    for points in (500, 1000, 2000):
        time = np.linspace(0, end, points + 1)
        force = UNDAMPED.force(amplitude * np.sin(omega * time), time[1])
        errors.append(abs(force[-1] - 1e5 * answer.y[0, -1]))
    assert errors[0] < 2e-3
    assert errors[2] < 1e-4


def test_no_plastic_flow_is_lost_in_the_smallest_steps():
    steady, alpha, steps = 15e-6, 0.3, 20_000
    path, z = 1e-10 * steady, 0.8 * steady  # alpha*path/steady is 3e-11
    for _ in range(steps):
        z = _deflection_at_alpha(z, path, steady, alpha)
    whole = _deflection_at_alpha(0.8 * steady, steps * path, steady, alpha)
    elastic = _deflection_at_alpha(0.8 * steady, steps * path, steady, 0.0)
    assert elastic == 0.8 * steady + steps * path
    assert elastic - whole == pytest.approx(steps * path * alpha * 0.8, rel=1e-5)
    assert z == pytest.approx(whole, rel=steps * 1.2e-16, abs=0)  # one rounding a step
