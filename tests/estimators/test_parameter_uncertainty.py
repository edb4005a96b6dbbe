"""The band of the proposed method that knows how uncertain its friction model is."""

import numpy as np
import pytest
from fraexp_plugins.estimators._shared.parameter_uncertainty import (
    Deviation,
    check_deviations,
    covariance_root,
    moved_within_bounds,
)
from fraexp_plugins.estimators.best_linear_approximation import BestLinearApproximation
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.composite import Composite
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.rolling import Rolling

from fraexp.errors import ParameterError
from tests.machines import guide, simulated
from tests.refusals import refused

DELAYS = {"input_dead_time": 1e-3}
CURVE = {"coulomb_force": 17.9, "characteristic_displacement": 45e-6}


@pytest.fixture(scope="module")
def signals():
    return simulated(guide(), (5.0, 20.0, 40.0), 12.0)


def covariance_of(signals, **given):
    return EffectiveInput(friction=guide(), **DELAYS, **given).estimate(signals).response.model_covariance


def test_the_covariance_is_that_of_the_error_law(signals):
    """1/P̂ - 1/P = N - N̂, and N̂ is proportional to the force: a deviation s gives s² N̂ N̂ᵀ."""
    stated = covariance_of(signals, force_std=0.05)
    inverses = [
        1 / EffectiveInput(friction=guide(viscous=0.0), **DELAYS, force_scale=scale).estimate(signals).response.response
        for scale in (1.0, 2.0)
    ]
    change = 0.05 * (inverses[0] - inverses[1])
    parts = np.stack([change.real, change.imag], axis=1)
    assert np.allclose(stated, parts[:, :, None] * parts[:, None, :], rtol=1e-6, atol=0)


def test_a_parameter_deviates_as_its_scale_does(signals):
    friction = Rolling(curve=CURVE)
    deviation = Deviation(parameter="curve.coulomb_force", std=0.05 * 17.9)
    by_name, by_scale = (
        EffectiveInput(friction=friction, **DELAYS, **given).estimate(signals).response.model_covariance
        for given in ({"deviations": (deviation,)}, {"force_std": 0.05, "displacement_std": 0.0})
    )
    assert np.allclose(by_name, by_scale, rtol=1e-9, atol=0)


def test_the_covariance_is_that_of_drawn_parameters():
    """Columns of a square root: their outer products add up to the covariance, and move what they belong to."""
    friction = Composite(parts=(Dahl(stiffness=3.9e5, coulomb_force=17.9), Rolling(curve=CURVE)))
    deviations = [
        Deviation(parameter="parts.0.coulomb_force", std=0.5),
        Deviation(parameter="parts.1.curve.characteristic_displacement", std=2e-6),
    ]
    correlation = ((1.0, -0.6), (-0.6, 1.0))
    root = covariance_root(friction, deviations, correlation)
    assert np.allclose(root @ root.T, [[0.25, -0.6e-6], [-0.6e-6, 4e-12]], rtol=1e-9, atol=0)
    moved = moved_within_bounds(friction, deviations, root[:, 0])
    assert moved.parts[0].coulomb_force == pytest.approx(17.9 + root[0, 0])
    assert moved.parts[1].curve.characteristic_displacement == pytest.approx(45e-6 + root[1, 0])


@pytest.mark.parametrize(
    ("parameter", "text", "number"),
    [
        ("viscous_coefficient", "0.5 N s/m", 0.5),
        ("curve.characteristic_displacement", "2 um", 2e-6),
        ("curve.coulomb_force", "0.5", 0.5),
    ],
)
def test_a_deviation_is_read_in_the_unit_of_its_parameter(signals, parameter, text, number):
    friction = Rolling(curve=CURVE, viscous_coefficient=4.69)
    covariances = []
    for given in (text, number):
        plain = {"friction": friction, "deviations": [{"parameter": parameter, "std": given}], **DELAYS}
        estimator = EffectiveInput.parse(plain, "effective_input")
        assert estimator.deviations[0].in_si_units(friction) == pytest.approx(number, rel=1e-12)
        covariances.append(estimator.estimate(signals).response.model_covariance)
    assert np.allclose(*covariances, rtol=1e-9, atol=0)


def test_a_place_in_a_list_has_the_unit_of_the_list():
    friction = Composite(
        parts=(Dahl(stiffness=3.9e5, coulomb_force=17.9), Rolling(stiffness=(1e5,), limit_force=(5.0,)))
    )
    assert Deviation(parameter="parts.0.stiffness", std="1 N/um").in_si_units(friction) == pytest.approx(1e6)
    assert Deviation(parameter="parts.1.limit_force.0", std="2 mN").in_si_units(friction) == pytest.approx(2e-3)


@pytest.mark.parametrize("names", [("curve.coulomb_force", "curve.coulomb_force"), ("stiffness.0", "stiffness.00")])
def test_a_parameter_that_deviates_twice_is_refused(names):
    friction = Rolling(curve=CURVE) if "curve" in names[0] else Rolling(stiffness=(1e5,), limit_force=(5.0,))
    twice = [Deviation(parameter=name, std=0.5) for name in names]
    with refused(ParameterError, "deviations", f"'{names[1]}'"):
        check_deviations(friction, twice, ())
    with refused(ParameterError, "deviations"):
        covariance_root(friction, twice, ())


def test_bounds_shorten_the_step():
    """A limit force of 0.5 ± 0.4 N cannot be two deviations lower."""
    friction, deviation = (Rolling(stiffness=(1e5,), limit_force=(0.5,)), Deviation(parameter="limit_force.0", std=0.4))
    assert moved_within_bounds(friction, [deviation], np.array([-0.8])).limit_force == pytest.approx((0.1,))
    assert moved_within_bounds(friction, [deviation], np.array([0.8])).limit_force == pytest.approx((1.3,))


def test_any_method_behind_the_observer_gets_the_band(signals):
    """The same error law: the covariance does not depend on how û_e and y' are averaged."""
    plain = covariance_of(signals, force_std=0.03)
    for method in (Conventional(), BestLinearApproximation()):
        found = covariance_of(signals, force_std=0.03, method=method)
        assert np.allclose(found, plain, rtol=1e-6, atol=0)


def test_without_a_stated_uncertainty_the_band_is_that_of_noise(signals):
    assert covariance_of(signals) is None


@pytest.mark.parametrize(
    ("parameter", "std", "names"),
    [
        ("curve.coulom", 1.0, ("'curve.coulom'", "'coulomb_force'")),
        ("stiffness.3", 1.0, ("'stiffness.3'", "'3'")),
        ("curve", 1.0, ("'curve'", "VirginCurve")),
        ("curve.characteristic_displacement", "2 N", ("std", "'N'", "'m'")),
        ("curve.characteristic_displacement", -2e-6, ("std", "-2e-06", 0)),
    ],
)
def test_what_is_stated_wrongly_is_refused_in_one_line(parameter, std, names):
    with refused(ParameterError, "effective_input", "deviations", *names):
        EffectiveInput.parse(
            {"friction": Rolling(curve=CURVE), "deviations": ({"parameter": parameter, "std": std},)}, "effective_input"
        )


def test_a_correlation_has_a_row_for_each_deviation():
    with refused(ParameterError, "effective_input.correlation", "[1]", "0 rows"):
        EffectiveInput.parse({"friction": Rolling(curve=CURVE), "correlation": ((1.0,),)}, "effective_input")


@pytest.mark.parametrize("matrix", [((1.0, 0.5), (0.4, 1.0)), ((1.0, 1.2), (1.2, 1.0)), ((2.0, 0.0), (0.0, 1.0))])
def test_a_matrix_that_is_no_correlation_is_refused(matrix):
    names = [{"parameter": f"curve.{name}", "std": 1e-7} for name in CURVE]
    with refused(ParameterError, "effective_input.correlation"):
        EffectiveInput.parse(
            {"friction": Rolling(curve=CURVE), "deviations": names, "correlation": matrix}, "effective_input"
        )
