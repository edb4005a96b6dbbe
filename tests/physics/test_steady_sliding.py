"""Friction at constant velocity: the Stribeck curve of every model that has one, and Coulomb friction to and fro."""

import numpy as np
import pytest
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre

from tests.machines import cosine, harmonic, work

SLIDING = [
    Coulomb.parse(Coulomb.presets["unit"], "coulomb"),
    LuGre.parse(LuGre.presets["canudas_de_wit_1995"], "lugre"),
    Elastoplastic.parse(Elastoplastic.presets["dupont_2002"], "elastoplastic"),
    GeneralizedMaxwellSlip.parse(GeneralizedMaxwellSlip.presets["reference"], "gms"),
]


@pytest.mark.parametrize("velocity", [1e-5, 4e-4, -1e-3, 3e-3, -1e-2])
@pytest.mark.parametrize("model", SLIDING, ids=lambda model: model.name)
def test_stribeck_curve(model, velocity):
    """After 1 mm, far more than any presliding, and 4 s, far more than the frictional lag S/C of GMS."""
    time = np.linspace(0, max(4.0, 1e-3 / abs(velocity)), 20_000)
    force = model.force(velocity * time, time[1])
    expected = np.sign(velocity) * (1.0 + 0.5 * np.exp(-((velocity / 1e-3) ** 2)))
    assert force[-1] == pytest.approx(expected, rel=1e-9)


def test_viscous_part_is_linear_and_apart_from_the_law():
    assert [model.viscous for model in SLIDING] == [0.0, 0.4, 0.4, 0.0]


@pytest.mark.parametrize("amplitude", [1e-6, 1e-3, 2.0])
def test_describing_function_and_energy_of_coulomb_friction_at_any_stroke(amplitude):
    model, y = Coulomb(coulomb_force=3.0, stiction_displacement=1e-14), cosine(amplitude)
    force = model.force(y, 1e-4, periodic=True)
    assert (harmonic(force) / amplitude).imag == pytest.approx(4 * 3.0 / (np.pi * amplitude), rel=1e-6)
    assert work(force, y) == pytest.approx(4 * 3.0 * amplitude, rel=1e-6)


def test_asymmetric_coulomb_friction_has_another_force_each_way():
    model = Coulomb(coulomb_force=2.0, negative_ratio=0.7, stiction_displacement=1e-14)
    force = model.force(cosine(1e-3), 1e-4, periodic=True)
    y = np.diff(cosine(1e-3))
    assert np.allclose(force[1:][y > 0], 2.0)
    assert np.allclose(force[1:][y < 0], -1.4)
    assert np.mean(force) == pytest.approx((2.0 - 1.4) / 2, rel=1e-3)


def test_at_rest_coulomb_friction_takes_any_value_within_the_static_one():
    model = Coulomb(coulomb_force=1.0, static_force=1.5, stiction_displacement=1e-9)
    rest = model.force(np.array([0.0, 0.25e-9, 0.5e-9, 0.5e-9, -0.5e-9]), 1.0)  # so slowly that S is Fs
    assert np.allclose(rest, [0.0, 0.375, 0.75, 0.75, -0.75])
