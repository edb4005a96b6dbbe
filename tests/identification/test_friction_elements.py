"""Elements of rolling friction are found again from displacement and force, by each of the methods."""

import numpy as np
import pytest
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification.friction_identification import FrictionIdentification

from fraexp.components.kinds import FrictionModel
from fraexp.components.registry import create
from fraexp.data.results import Outcome
from fraexp.data.signals import Segment, Signals
from fraexp.errors import ParameterError, RecordError
from tests.examples import thorough
from tests.identification.friction_records import THREE, driven, motion, record, signals, values
from tests.machines import guide
from tests.responses import judged

GUIDE = guide()
KNOWN = tuple(GUIDE.limit_deflection.tolist())
NOISE = 0.01


def elements(stiffness, limit_force, damping=()):
    return Rolling(stiffness=stiffness, limit_force=limit_force, damping=damping)


def test_known_thresholds_give_every_stiffness_to_rounding(registry):
    result = judged(FrictionIdentification(thresholds=KNOWN), record(GUIDE))
    fit = result.fits[0]
    assert result.outcome is Outcome.OK
    assert not result.message
    assert np.array(fit.component["stiffness"]) == pytest.approx(GUIDE.element_stiffness, rel=1e-8)
    assert fit.component["viscous_coefficient"] == pytest.approx(GUIDE.viscous, rel=1e-8)
    model = create(registry, FrictionModel, fit.component)
    assert dict(zip(fit.parameters, fit.values, strict=True))["limit_force.3"] == model.elements[1][3]
    assert fit.covariance.shape == (fit.values.size, fit.values.size)


@pytest.mark.parametrize(
    "estimator",
    [FrictionIdentification(), thorough(FrictionIdentification(back_propagation=True))],
    ids=lambda one: one.name,
)
def test_with_noise_the_coulomb_force_is_found_and_held_out_cycles_are_met_to_the_noise(estimator):
    y = motion(1000, 8)
    clean = driven(GUIDE, y, 1e-3)
    found = values(estimator.estimate(record(GUIDE, noise=NOISE)))
    assert found["Coulomb force"] == pytest.approx(17.9, rel=5e-3)
    assert found["rms error, held-out cycles"] == pytest.approx(NOISE * np.abs(clean).max(), rel=0.04)


@pytest.mark.parametrize(
    "start",
    [
        thorough({}),
        {"starts": (elements((1e5, 1e5, 1e5), (1.0, 5.0, 9.0)),)},
        {"starts": (elements((5e5, 2e5, 1e5), (1.0, 2.0, 3.0)),)},
    ],
    ids=["least squares", "alike", "narrow"],
)
def test_back_propagation_finds_thresholds_from_any_of_these_starts(start):
    fit = FrictionIdentification(back_propagation=True, **start, elements=3).estimate(record(THREE)).fits[0]
    assert fit.values == pytest.approx([*THREE.stiffness, *THREE.limit_force, THREE.viscous], rel=1e-8)


@pytest.mark.thorough
def test_back_propagation_finds_the_elements_viscous_coefficients():
    damped = Rolling(stiffness=THREE.stiffness, limit_force=THREE.limit_force, damping=(20.0, 10.0, 30.0))
    near = Rolling(stiffness=(2.5e5, 1.2e5, 4e4), limit_force=(2.5, 3.0, 7.0), damping=(10.0, 10.0, 10.0))
    found = (
        FrictionIdentification(back_propagation=True, starts=(near,), fit_damping=True, viscous_coefficient=0.0)
        .estimate(record(damped))
        .fits[0]
    )
    assert found.component["damping"] == pytest.approx(damped.damping, rel=1e-6)


def test_the_offset_is_found_and_so_is_a_viscous_friction_that_differs_by_direction():
    y = motion(1000, 8)
    speed = np.abs(np.gradient(y, 1e-3))
    force = driven(THREE, y, 1e-3, offset=0.7) + 1.5 * speed
    estimator = FrictionIdentification(thresholds=tuple(THREE.limit_deflection.tolist()), fit_asymmetry=True)
    found = values(estimator.estimate(signals(y, force, 1e-3, 8)))
    assert found["offset"] == pytest.approx(0.7, rel=1e-8)
    assert found["viscous asymmetry"] == pytest.approx(1.5, rel=1e-8)
    assert found["viscous coefficient"] == pytest.approx(4.69, rel=1e-8)


def test_a_record_that_begins_anywhere_is_used_from_where_its_beginning_is_forgotten():
    y = motion(1000, 9)
    force = driven(THREE, y, 1e-3)
    late = signals(y[300:8300], force[300:8300], 1e-3, 8)
    fit = FrictionIdentification(thresholds=tuple(THREE.limit_deflection.tolist())).estimate(late).fits[0]
    assert fit.component["stiffness"] == pytest.approx(THREE.stiffness, rel=1e-8)


def test_a_record_from_rest_is_used_from_its_first_sample():
    y = np.concatenate(
        [np.linspace(0, 200e-6, 400), np.linspace(200e-6, 150e-6, 200), np.linspace(150e-6, 300e-6, 400)]
    )
    once = signals(y, driven(THREE, y, 1e-3), 1e-3, 1, from_rest=True)
    thresholds = tuple(THREE.limit_deflection.tolist())
    fit = FrictionIdentification(thresholds=thresholds, viscous_coefficient=4.69).estimate(once).fits[0]
    assert fit.component["stiffness"] == pytest.approx(THREE.stiffness, rel=1e-6)


def test_the_stated_bands_hold_the_truth():
    """Of 40 records 95 % ± 2 standard deviations; `benchmarks/friction_identification.py` counts 500."""
    estimator, force, curve = FrictionIdentification(thresholds=KNOWN), [], []
    for seed in range(40):
        result = estimator.estimate(record(GUIDE, samples=300, noise=NOISE, seed=seed))
        found, columns = values(result), result.curves[0].columns
        force.append(abs(found["Coulomb force"] - sum(GUIDE.elements[1])) <= found["Coulomb force, 95 %"])
        virgin = np.minimum(columns["displacement"][:, None], GUIDE.limit_deflection) @ GUIDE.element_stiffness
        curve.append(np.mean((columns["lower 95 %"] <= virgin) & (virgin <= columns["upper 95 %"])))
    assert np.mean(force) >= 0.88
    assert np.mean(curve) >= 0.90


def test_a_motion_that_never_slips_through_is_refused():
    y = motion(1000, 8, amplitude=20e-6)
    with pytest.raises(RecordError, match=r"stays in presliding.*several times as wide"):
        FrictionIdentification().estimate(signals(y, driven(THREE, y, 1e-3), 1e-3, 8))


def test_thresholds_that_the_motion_never_forgets_are_refused():
    with pytest.raises(RecordError, match=r"spans twice the largest threshold, 10 mm, in 0 rows"):
        FrictionIdentification(thresholds=(1e-5, 1e-2)).estimate(record(THREE))


def test_a_force_of_the_wrong_sign_is_refused():
    y = motion(1000, 8)
    with pytest.raises(RecordError, match=r"no friction is identifiable.*check its sign"):
        FrictionIdentification().estimate(signals(y, -driven(THREE, y, 1e-3), 1e-3, 8))


def test_what_does_not_move_or_vary_is_refused():
    y = motion(1000, 8)
    with pytest.raises(RecordError, match="'displacement' does not move"):
        FrictionIdentification().estimate(signals(0 * y, y, 1e-3, 8))
    with pytest.raises(RecordError, match="'friction' does not vary"):
        FrictionIdentification().estimate(record(Frictionless()))
    with pytest.raises(RecordError, match="no channel 'frictoin'; did you mean 'friction'"):
        FrictionIdentification(force="frictoin").estimate(record(THREE))


def test_a_coarse_scale_is_remarked_on():
    y = np.round(motion(1000, 8) / 10e-6) * 10e-6
    found = FrictionIdentification().estimate(signals(y, driven(THREE, y, 1e-3), 1e-3, 8)).findings
    assert ("not identifiable", "stiffness") in {(each.kind, each.place) for each in found}


def test_one_speed_alone_is_remarked_on_and_no_viscous_friction_is_stated():
    y = 400e-6 * np.interp(np.arange(8000) % 1000, [0, 250, 750, 1000], [0, 1, -1, 0])
    result = FrictionIdentification().estimate(signals(y, driven(THREE, y, 1e-3), 1e-3, 8))
    assert "all sliding is at one speed" in result.message
    assert "viscous coefficient" not in values(result)


def test_a_motion_that_hardly_turns_is_remarked_on():
    y = np.linspace(0, 400e-6, 1000) + 100e-6 * np.linspace(0, 1, 1000) ** 3
    once = signals(y, driven(THREE, y, 1e-3), 1e-3, 1, from_rest=True)
    assert "the motion has 0 reversals" in FrictionIdentification(viscous_coefficient=4.69).estimate(once).message


def test_a_descent_that_does_not_end_is_an_error():
    with pytest.raises(RecordError, match=r"did not converge in 2 steps: .*raise max_iterations"):
        FrictionIdentification(starts=(Rolling(stiffness=(1e5,), limit_force=(3.0,)),), max_iterations=2).estimate(
            record(THREE)
        )


def test_thresholds_that_do_not_ascend_are_refused():
    with pytest.raises(ParameterError, match="thresholds: expected values above 0 in ascending order"):
        FrictionIdentification.parse({"thresholds": [2e-6, 1e-6]}, "estimator")


def test_a_channel_without_its_gain_is_refused() -> None:
    y = 1e-4 * np.sin(2 * np.pi * np.arange(4000) / 1000)
    segment = Segment(1e-3, {"u": y.reshape(1, -1), "y": y.reshape(1, -1)}, np.array([4]))
    volts = Signals((segment,), {"u": "V", "y": "m"})
    with pytest.raises(RecordError, match=r"'u' is in V; expected N: give the channel its gain"):
        FrictionIdentification(thrust="u", displacement="y").estimate(volts)
