"""Friction and plant along the measured motion: near the right ones without a replay, and laws told apart."""

import numpy as np
import pytest
from fraexp_plugins.estimators._shared.parameter_uncertainty import parameter_value
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.identification._law_numbers import shape_parameters
from fraexp_plugins.identification._machine_fit import Fitted, ReplayError
from fraexp_plugins.identification._machine_problem import SCALES, FreeParameters, Models
from fraexp_plugins.identification._motion_start import fits_along_motion
from fraexp_plugins.identification._record_fit import LinearisedFit, RecordFit, State
from fraexp_plugins.plants.modal import Modal

from fraexp.api import ReplayModel
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


def test_an_error_of_the_replay_that_the_law_forbids_to_correct_is_left_in_the_interval():
    forces = {"coulomb_force": 10.0, "static_force": 10.0, "stribeck_velocity": 0.01}
    law = LuGre(bristle_stiffness=1e6, bristle_damping=100.0, **forces)
    ports = Modal(rigid_body_gain=0.2).ports().closed_by("", "")
    model = ReplayModel(ports, dict.fromkeys(ports.contacts, law), 1e-3, (0.0, ()), (0.0, ()), 1e-4, 1e-5)
    fit = RecordFit([], Models(Modal(rigid_body_gain=0.2), model), FreeParameters(("static_force",)), 1e-7, 0.0)
    for change, is_allowed in ((1e-3, True), (-1e-3, False)):
        error = ReplayError(np.array([change]), (), remaining=0.5)
        found = Fitted(fit, State(np.zeros(1), ()), LinearisedFit((), (), (), ()), error)
        assert found.shared == pytest.approx([change if is_allowed else 0.0])
        assert found.shared_error == pytest.approx([change / 2 if is_allowed else 1.5 * change])
