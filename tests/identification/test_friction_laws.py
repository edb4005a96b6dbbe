"""Laws with a Stribeck effect, and a user's own, are found again from records with many speeds."""

import numpy as np
import pytest
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._law_forces import virgin_curve
from fraexp_plugins.identification.friction_identification import FrictionIdentification

from fraexp.components.kinds import Estimator, FrictionModel
from fraexp.components.registry import create, discover
from fraexp.errors import ParameterError, RecordError
from tests.examples import thorough
from tests.identification.friction_records import driven, signals, values
from tests.identification.test_law_selection import BOUC_WEN
from tests.responses import judged

RATED = {"coulomb_force": 10.0, "static_force": 14.0, "stribeck_velocity": 1e-3}
GMS = GeneralizedMaxwellSlip(
    stiffness=(2e5, 6e4), force_fractions=(0.4, 0.6), attraction_rate=500.0, viscous_coefficient=50.0, **RATED
)
BRISTLE = Elastoplastic(bristle_stiffness=3e5, viscous_coefficient=50.0, elastic_limit_ratio=0.6, **RATED)
STEP = 5e-4
NOISE = 0.01


def varied(model, noise=0.0):
    """A record from rest at speeds from far below to above 1 mm/s."""
    t = STEP * np.arange(12_000)
    y = 300e-6 * np.sin(2 * np.pi * t) * (1 + 0.9 * np.sin(0.4 * np.pi * t)) + 40e-6 * np.sin(10.6 * np.pi * t)
    return signals(y, driven(model, y, STEP, noise=noise), STEP, 1, from_rest=True)


@pytest.mark.parametrize(
    ("model", "estimator"),
    [
        (GMS, FrictionIdentification(laws=(GeneralizedMaxwellSlip,), elements=2)),
        thorough(BRISTLE, FrictionIdentification(laws=(Elastoplastic,))),
    ],
    ids=lambda one: one.name,
)
def test_the_law_is_found_and_held_out_parts_are_met_to_the_noise(model, estimator, registry):
    result = judged(estimator, varied(model, NOISE))
    found = values(result)
    clean = varied(model).segments[0].channels["friction"]
    assert not result.message
    assert found["rms error, held-out cycles"] == pytest.approx(NOISE * np.abs(clean).max(), rel=0.05)
    for name, truth in RATED.items():
        title = name.replace("_", " ").replace("coulomb", "Coulomb")
        assert found[title] == pytest.approx(truth, rel=0.02)
        assert abs(found[title] - truth) < 2 * found[f"{title}, 95 %"]
    component = dict(result.fits[0].component)
    assert create(registry, FrictionModel, component).viscous == pytest.approx(50.0, rel=0.15)
    assert set(result.fits[0].parameters) >= set(RATED)


@pytest.mark.thorough
def test_of_several_laws_the_one_that_predicts_held_out_cycles_is_chosen():
    """Rolling elements have no part in a Stribeck effect, and Dahl's law has one stiffness."""
    start = Dahl(stiffness=2e5, coulomb_force=9.0)
    result = FrictionIdentification(laws=(Rolling, GeneralizedMaxwellSlip), starts=(start,), elements=2).estimate(
        varied(GMS, NOISE)
    )
    chosen = result.findings[0]
    errors = {each.name: each.value for each in chosen.quantities}
    assert (chosen.place, result.fits[0].component["name"]) == ("gms", "gms")
    assert min(errors["error of rolling"], errors["error of dahl"]) > 2 * errors["error of gms"]


def test_one_speed_alone_is_refused():
    y = 400e-6 * np.interp(np.arange(8000) % 1000, [0, 250, 750, 1000], [0, 1, -1, 0])
    once = signals(y, driven(GMS, y, STEP), STEP, 8)
    with pytest.raises(RecordError, match="friction_identification: all sliding is at one speed"):
        FrictionIdentification(laws=(GeneralizedMaxwellSlip,)).estimate(once)


def test_the_limits_of_a_virgin_curve_never_fall_and_hold_it():
    x = np.linspace(1e-5, 2e-4, 40)
    force = 10 * (1 - np.exp(-x / 5e-5))
    deviation = np.where((x > 5e-5) & (x < 1.5e-4), 8.0, 0.5)  # elements that are not separately identifiable there
    curve = virgin_curve(x, force, deviation)
    lower, upper = (curve.columns[name] for name in ("lower 95 %", "upper 95 %"))
    assert (lower >= 0).all() and (np.diff(lower) >= 0).all() and (np.diff(upper) >= 0).all()
    assert ((lower <= force) & (force <= upper)).all()
    assert upper.max() == pytest.approx(force[-1] + 1.959964 * 0.5)
    assert upper[0] == pytest.approx(force[0] + 1.959964 * 0.5), "where it is known nothing changes"


@pytest.mark.parametrize("named", [False, True])
def test_a_users_own_law_is_found_by_its_name_and_from_a_start(named, tmp_path):
    (tmp_path / "bouc_wen.py").write_text(BOUC_WEN)
    registry = discover(tmp_path)
    law = {"name": "bouc_wen", "stiffness": 2e5, "limit_force": 9.0, "exponent": 1.6}
    start = {"laws": ["bouc_wen"]} if named else {"starts": [{**law, "limit_force": 5.0, "exponent": 1.0}]}
    estimator = create(registry, Estimator, {"name": "friction_identification", **start})
    (fit,) = estimator.estimate(varied(create(registry, FrictionModel, law), NOISE)).fits
    found = {n: each for n, *each in zip(fit.parameters, fit.values, fit.standard_deviation, strict=True)}
    assert fit.component["name"] == "bouc_wen"
    for name in ("stiffness", "limit_force", "exponent"):
        value, std = found[name]
        assert value == pytest.approx(law[name], rel=0.02)
        assert abs(value - law[name]) < 4 * std


def test_a_law_and_a_way_that_do_not_go_together_are_refused():
    with pytest.raises(ParameterError, match=r"none has no numbers to fit"):
        FrictionIdentification(laws=(Frictionless,))
    with pytest.raises(ParameterError, match=r"back_propagation frees the thresholds of the law rolling; leave it out"):
        FrictionIdentification(laws=(GeneralizedMaxwellSlip,), back_propagation=True)
    with pytest.raises(ParameterError, match=r"constant_velocity is for the law coulomb alone"):
        FrictionIdentification(constant_velocity=True)
