"""Friction and plant along the measured motion: near the right ones without a replay, and laws told apart."""

import numpy as np
import pytest
from fraexp_plugins.estimators._shared.parameter_uncertainty import parameter_value
from fraexp_plugins.identification._law_numbers import shape_parameters
from fraexp_plugins.identification._machine_problem import SCALES
from fraexp_plugins.identification._motion_start import fits_along_motion

from fraexp.components.kinds import FrictionModel
from fraexp.components.registry import create
from tests.identification.test_maximum_likelihood import LUGRE, MACHINE, estimator

SINES = {"name": "stepped_sine", "amplitude": 25.0, "points": 8, "min_frequency": 5.0}
WRONG = {"viscous_coefficient": 2.0, "bristle_damping": 0.6, "static_force": 1.1, "stribeck_velocity": 1.4}


def fitted(registry, signals, spec):
    """Return the fit of a law with all its numbers free, and what it finds, by name."""
    friction = create(registry, FrictionModel, spec)
    method = estimator(spec, free=[*SCALES, *shape_parameters(friction)])
    problem = method.problem(signals, 0.0, friction)
    found = fits_along_motion(problem)[0]
    factors = dict(zip(problem.free.names, np.exp(found.shared), strict=False))
    values = {name: factor * parameter_value(friction, name) for name, factor in factors.items() if name not in SCALES}
    return found, values | {name: factors[name] for name in SCALES}


def test_numbers_that_are_wrong_by_a_factor_are_found(recorded, registry):
    signals = recorded(SINES, LUGRE, noise=0.0)
    wrong = LUGRE | {name: factor * LUGRE[name] for name, factor in WRONG.items()}
    found, values = fitted(registry, signals, wrong)
    assert found.residual < 1
    assert values["force_scale"] == pytest.approx(1, rel=0.01)
    assert values["displacement_scale"] == pytest.approx(1, rel=0.03)
    assert values["viscous_coefficient"] == pytest.approx(LUGRE["viscous_coefficient"], rel=0.05)


def test_a_plant_that_is_given_stays(recorded, registry):
    signals = recorded(SINES, noise=0.0)
    method = estimator(nominal_plant=MACHINE["plant"])
    found = fits_along_motion(method.problem(signals, 0.0, method.law))[0]
    assert found.plant == method.nominal_plant
    assert found.shared == pytest.approx([0, 0], abs=0.01)
