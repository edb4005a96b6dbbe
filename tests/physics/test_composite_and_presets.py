"""Sums of models, and the named parameter sets that models come with."""

import re

import numpy as np
import pytest
from fraexp_plugins.friction.composite import Composite
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre

from fraexp.components.kinds import FrictionModel
from fraexp.components.registry import create
from fraexp.testing.walk import interpreted_class
from tests.machines import FRICTIONLESS, guide

PARTS = (
    guide(),
    Dahl(stiffness=2e5, coulomb_force=2.0, viscous_coefficient=1.5),
    GeneralizedMaxwellSlip.parse(GeneralizedMaxwellSlip.presets["reference"], "gms"),
    LuGre.parse(LuGre.presets["canudas_de_wit_1995"], "lugre"),
)
WALK = np.cumsum(np.random.default_rng(1).normal(0, 3e-6, 3000))


@pytest.mark.thorough
def test_a_composite_is_the_sum_of_its_parts_to_the_last_bit():
    parts = PARTS[:3]
    total = np.zeros(WALK.size)
    for part in reversed(parts):
        total = part.force(WALK, 1e-4) + total
    composite = Composite(parts=parts)
    assert np.array_equal(composite.force(WALK, 1e-4), total)
    assert composite.viscous == pytest.approx(sum(part.viscous for part in parts), rel=1e-15)
    assert composite.max_stiffness == pytest.approx(sum(part.max_stiffness for part in parts))


def test_a_composite_may_hold_composites_and_the_same_model_twice():
    made = interpreted_class(Composite)
    inner = Composite(parts=(PARTS[1], PARTS[1]))
    both = made(parts=(inner, FRICTIONLESS, inner))
    assert np.allclose(both.force(WALK, 1e-4), 4 * PARTS[1].force(WALK, 1e-4), rtol=1e-13)
    assert both.viscous == 6.0


def test_every_preset_makes_a_model_that_resists(registry):
    found = 0
    for name in registry.names("friction"):
        for preset in registry.provider("friction", name).component.presets:
            model = create(registry, FrictionModel, {"name": name, "preset": preset})
            force = model.force(np.linspace(0, 1e-3, 2000), 1e-3)
            assert np.isfinite(force).all(), (name, preset)
            assert force[-1] > 0, (name, preset)
            found += 1
    assert found >= 7


def test_every_model_of_the_literature_names_its_source_and_has_a_reference_set(registry):
    for name in ("gms", "elastoplastic", "lugre", "coulomb"):
        model = registry.provider("friction", name).component
        assert re.search(r"doi:10\.\d{4,9}/\S+", model.__doc__), name
        assert model.presets, name


def test_published_parameters_are_the_published_ones():
    assert LuGre.presets["canudas_de_wit_1995"] == {
        "bristle_stiffness": 1e5,
        "bristle_damping": pytest.approx(np.sqrt(1e5)),
        "viscous_coefficient": 0.4,
        "coulomb_force": 1.0,
        "static_force": 1.5,
        "stribeck_velocity": 1e-3,
    }
    gms = PARTS[2]
    assert sum(gms.stiffness) == pytest.approx(9.76e4, rel=1e-3)
