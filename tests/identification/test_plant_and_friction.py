"""Plant and friction model from records alone: accuracy, bands, what records cannot tell, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification.plant_and_friction import PlantAndFriction

from fraexp.analysis.confidence import BandReach
from fraexp.components.kinds import FrictionModel, Plant
from fraexp.components.registry import create
from fraexp.data.findings import remarks
from fraexp.data.results import Outcome
from fraexp.data.signals import Settling
from fraexp.errors import RecordError
from tests.identification.plant_responses import MACHINE, SCALE
from tests.responses import judged

PATH = {"input_dead_time": 1e-3}
FORCE_NOISE = 0.05
"""Standard deviation [N] of the noise in the recorded thrust: what the drive does differs from what it says."""


def stepped(*amplitudes, points=30, **more):
    sine = {"name": "stepped_sine", "points": points, "recorded_periods": 4, **more}
    return {"name": "concatenated", "parts": [{**sine, "amplitude": amplitude} for amplitude in amplitudes]}


def multisine(rms, **more):
    lines = {"min_frequency": 1, "max_frequency": 200, "line_spacing": 0.5, "points": 60, "detection_group_size": 0}
    return {"name": "multisine", "rms": rms, "realisations": 4, "recorded_periods": 4, **lines, **more}


@pytest.fixture(scope="module")
def two_amplitudes(recorded):
    return recorded(stepped(12.0, 24.0), force_noise=FORCE_NOISE)


@pytest.fixture(scope="module")
def found(two_amplitudes):
    return identified(two_amplitudes, mass=7.5)


def identified(signals, **given):
    return judged(PlantAndFriction(**{**SCALE, **PATH, **given}), signals)


def numbers(result):
    return {metric.name: metric.value for metric in result.metrics}


def virgin(x):
    """Return the virgin curve [N] of the machine's friction at x [m]."""
    curve = MACHINE["friction"]["curve"]
    knots = np.geomspace(curve["min_knot"], curve["max_knot"], curve["elements"])
    shape = 1 - np.exp(-knots / curve["characteristic_displacement"])
    return np.interp(x, [0.0, *knots], [0.0, *curve["coulomb_force"] * shape / shape[-1]])


def friction_of(registry, result):
    return create(registry, FrictionModel, next(fit.component for fit in result.fits if fit.kind == "friction"))


def check_machine(result):
    """Ten times as near as the method must be with noise of scale and force: 1 %, 0.1 Hz; friction 1 %."""
    metrics = numbers(result)
    assert result.outcome is Outcome.OK
    assert metrics["k0"] == pytest.approx(0.132, rel=1e-3)
    assert metrics["f1"] == pytest.approx(38.8, abs=0.01)
    assert metrics["f2"] == pytest.approx(80.0, abs=0.02)
    assert metrics["Coulomb force"] == pytest.approx(17.9, rel=0.01)
    assert metrics["scatter after"] < 0.01 * metrics["scatter before"]


def check_bands(registry, result):
    """All that is stated with 95 % holds: the bands are allowed to be too wide, not too narrow."""
    truth = create(registry, Plant, MACHINE["plant"])
    response = result.response
    error = 1 / response.response - 1 / truth.response(2 * np.pi * response.frequency)
    noise = np.trace(response.covariance, axis1=1, axis2=2) / np.abs(response.response) ** 4 / 2
    covariance = response.model_covariance + noise[:, None, None] * np.eye(2)
    parts = np.stack([error.real, error.imag], axis=1)
    squared = np.einsum("ni,nij,nj->n", parts, np.linalg.inv(covariance), parts)
    assert np.mean(squared < 5.99) > 0.9
    metrics = numbers(result)
    assert abs(metrics["viscous coefficient"] - 4.69) < metrics["viscous coefficient, 95 %"]
    fit = next(fit for fit in result.fits if fit.kind == "plant")
    true = dict(zip(("rigid_body_gain", "frequencies.0", "frequencies.1"), (0.132, 38.8, 80.0), strict=True))
    for name, value, deviation in zip(fit.parameters, fit.values, fit.standard_deviation, strict=True):
        if name in true:
            assert abs(value - true[name]) < 3 * deviation, name
    columns = next(curve for curve in result.curves if curve.name == "virgin curve").columns
    seen = columns["displacement"] > 2e-6  # twice the motion at 200 Hz
    inside = (columns["lower 95 %"] <= virgin(columns["displacement"])) & (
        virgin(columns["displacement"]) <= columns["upper 95 %"]
    )
    assert np.mean(inside[seen]) > 0.9


@pytest.mark.thorough
def test_two_amplitudes_give_plant_and_friction(registry, recorded):
    found = identified(recorded(stepped(12.0, 24.0, points=60), force_noise=FORCE_NOISE), mass=7.5)
    check_machine(found)
    check_bands(registry, found)


@pytest.mark.thorough
def test_realisations_of_one_level_give_them_as_well(registry, recorded):
    result = identified(recorded(multisine(12.0), force_noise=FORCE_NOISE))
    check_machine(result)
    check_bands(registry, result)


def test_the_virgin_curve_is_that_of_the_guide(found):
    columns = next(curve for curve in found.curves if curve.name == "virgin curve").columns
    x = np.geomspace(5e-6, 200e-6, 20)
    assert np.interp(x, columns["displacement"], columns["force"]) == pytest.approx(virgin(x), rel=0.01)
    width = numbers(found)["width at 63 %"]
    assert virgin(width) == pytest.approx((1 - np.exp(-1)) * 17.9, rel=0.01)


def test_the_friction_model_is_ready_for_the_proposed_method(registry, two_amplitudes, found):
    """With it the proposed method gives the plant at one amplitude, viscous friction taken off."""
    single = replace(two_amplitudes, segments=two_amplitudes.segments[30:])
    response = EffectiveInput(friction=friction_of(registry, found), **SCALE, **PATH).estimate(single).response
    fast = response.frequency > 5
    truth = create(registry, Plant, MACHINE["plant"]).response(2 * np.pi * response.frequency)
    assert response.response[fast] == pytest.approx(truth[fast], rel=0.01)
    fit = next(fit for fit in found.fits if fit.kind == "friction")
    count = len(fit.component["stiffness"])
    assert fit.values[:count] == pytest.approx(fit.component["stiffness"])
    assert fit.covariance.shape == (2 * count + 1, 2 * count + 1)
    variances = np.linalg.eigvalsh(fit.covariance / np.outer(fit.values, fit.values))
    assert variances[0] > -1e-9 * variances[-1]


@pytest.mark.thorough
def test_presliding_identifies_the_plant_and_names_what_it_does_not_identify(recorded, registry):
    """At 3 N rms nothing slips through: elements that never slip are a spring, which a rigid body has not."""
    result = identified(recorded(multisine(3.0)))
    metrics = numbers(result)
    assert metrics["k0"] == pytest.approx(0.132, rel=3e-3)
    assert metrics["f1"] == pytest.approx(38.8, abs=0.02)
    found = next(each for each in result.findings if each.kind == "not identifiable")
    assert (found.place, found.quantities[-1].name) == ("Coulomb force", "stiffness that never slips")
    friction = friction_of(registry, result)
    x = np.array([5e-6, 10e-6, 20e-6])
    curve = np.minimum(x[:, None], friction.limit_deflection) @ friction.element_stiffness
    assert curve == pytest.approx(virgin(x), rel=0.02)


@pytest.mark.parametrize(
    "friction",
    [
        {"name": "dahl", "stiffness": 3.9e5, "coulomb_force": 17.9, "viscous_coefficient": 4.69},
        {"name": "elastoplastic", "preset": "linear_motor_table"},
    ],
    ids=lambda friction: friction["name"],
)
@pytest.mark.thorough
def test_friction_of_another_kind_is_not_explained(recorded, friction):
    result = identified(recorded(stepped(12.0, 24.0), friction))
    assert result.outcome is not Outcome.OK
    (doubt,) = (finding for finding in result.findings if finding.kind == "undetermined")
    assert set(doubt.frequencies) == set(result.response.frequency[result.response.settled])
    assert not BandReach.of(result.response).is_within().any(), "nothing bounds what a wrong law leaves"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("given", "words"), [({"input_dead_time": 1.5e-3}, "check delays"), ({"mass": 30}, "1.99 times")]
)
def test_a_wrong_statement_is_seen(two_amplitudes, given, words):
    """Half of the sample time makes a quarter of the mass, and nothing else contradicts it."""
    result = identified(two_amplitudes, **given)
    assert result.outcome is Outcome.INACCURATE
    assert words in result.message


def test_no_friction_is_an_answer(recorded):
    result = identified(recorded(stepped(12.0, 24.0, points=16), {"name": "none"}, force_noise=FORCE_NOISE))
    assert result.outcome is Outcome.OK
    assert numbers(result)["Coulomb force"] < 1e-3  # N, of 24 N
    assert numbers(result)["k0"] == pytest.approx(0.132, rel=1e-3)


@pytest.mark.parametrize(
    ("excitation", "friction", "reason"),
    [
        (stepped(12.0, points=8), None, "two amplitudes, a factor of 2 apart"),
        (stepped(12.0, 12.0, points=8), None, "use amplitudes a factor of 2 apart"),
        (multisine(12.0, transient=True, recorded_periods=2), None, "transient = false"),
    ],
    ids=["one amplitude", "equal amplitudes", "from rest"],
)
def test_unsuitable_records_are_refused_with_the_remedy(recorded, excitation, friction, reason):
    with pytest.raises(RecordError, match=reason):
        identified(recorded(excitation, friction))


@pytest.mark.thorough
def test_what_has_not_settled_is_left_out(recorded):
    signals = recorded(stepped(12.0, 24.0))
    first, *others = signals.segments
    unsettled = replace(first, settling=Settling(False, 30.0, 0.1), channels=others[3].channels)
    signals = replace(
        signals, segments=(unsettled, *others), outcome=Outcome.NOT_SETTLED, findings=remarks("as a test")
    )
    result = identified(signals)
    assert result.outcome is Outcome.INACCURATE  # at the frequency of which one record is left
    assert "as a test" in result.message and "at 1 of 30 frequencies (1 Hz)" in result.message
    assert numbers(result)["k0"] == pytest.approx(0.132, rel=3e-3)
