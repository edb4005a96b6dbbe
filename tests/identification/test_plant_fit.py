"""Eq (1) with its dead time from frequency responses: accuracy, number of modes, uncertainty, and refusals."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification._modal_solver import whiteness
from fraexp_plugins.identification.modal_fit import ModalFit
from fraexp_plugins.plants.modal import Modal

from fraexp.components.registry import create, discover
from fraexp.data.findings import remarks
from fraexp.data.results import Outcome
from fraexp.errors import ParameterError, RecordError
from tests.examples import some, thorough
from tests.identification.plant_responses import (
    DEAD_TIME,
    FREQUENCY,
    PLANTS,
    TWO,
    fitted,
    measured,
    metric,
    values,
    worst,
)
from tests.machines import TABLE, guide, simulated


def test_a_plant_with_ground_is_the_same_in_both_forms():
    plant = TABLE.model_copy(update={"viscous_coefficient": 500.0, "ground_stiffness": 3e4})
    system, omega = plant.state_space(), 2 * np.pi * np.array([0.5, 5.0, 38.8, 150.0])
    realised = [system.c @ np.linalg.solve(1j * w * np.eye(len(system.a)) - system.a, system.b) for w in omega]
    assert plant.response(omega) == pytest.approx(np.array(realised), rel=1e-12)
    mass = Modal(rigid_body_gain=1 / 7.6, viscous_coefficient=500.0, ground_stiffness=3e4)
    assert mass.response(omega) == pytest.approx(1 / (7.6 * (1j * omega) ** 2 + 500.0 * 1j * omega + 3e4), rel=1e-12)


@pytest.mark.parametrize("name", some(PLANTS, "rigid body", "two modes"))
def test_no_guess_is_needed(name):
    """Number of modes and all parameters are found without a start value; a noise-free response is met exactly."""
    plant = PLANTS[name]
    result = fitted(measured(plant, noise=0.0))
    assert metric(result, "modes") == len(plant.frequencies)
    assert worst(result, plant) < 1e-8
    assert result.fits[0].component["frequencies"] == pytest.approx(plant.frequencies, rel=1e-8)


@pytest.mark.thorough
@pytest.mark.parametrize("known", [thorough(True), False])
def test_one_percent_of_noise(known):
    """The stated accuracy, and errors that the stated standard deviations explain."""
    result = fitted(measured(known=known))
    found, deviation = values(result)
    truth = {"rigid_body_gain": 0.132, "dead_time": DEAD_TIME}
    for i in range(2):
        truth |= {f"frequencies.{i}": TWO.frequencies[i], f"damping_ratios.{i}": TWO.damping_ratios[i]}
        truth |= {f"modal_gain_ratios.{i}": TWO.modal_gain_ratios[i]}
    assert set(found) == set(truth)
    assert found["rigid_body_gain"] == pytest.approx(0.132, rel=1e-3)
    assert found["dead_time"] == pytest.approx(DEAD_TIME, abs=1e-5)
    for i in range(2):
        assert found[f"frequencies.{i}"] == pytest.approx(TWO.frequencies[i], abs=0.02)
        assert found[f"damping_ratios.{i}"] == pytest.approx(TWO.damping_ratios[i], rel=0.01)
    assert all(abs(found[name] - value) < 4 * deviation[name] for name, value in truth.items())
    assert deviation["rigid_body_gain"] / 0.132 == pytest.approx(5.1e-4, rel=0.15)  # that of 500 runs
    assert result.message == ""
    assert metric(result, "residual") == pytest.approx(0.01, rel=0.15)
    assert metric(result, "beyond") == pytest.approx(0.05, abs=0.045)  # of 200 points, three standard deviations
    assert metric(result, "whiteness") > 1e-3
    assert not known or metric(result, "cost") == pytest.approx(1, abs=0.25)


@pytest.mark.parametrize(
    ("name", "noise"), [("rigid body", 0.05), thorough("one mode", 0.05), thorough("two modes", 0.01)]
)
def test_noise_makes_no_modes(name, noise):
    result = fitted(measured(PLANTS[name], noise=noise), max_modes=4)
    assert metric(result, "modes") == len(PLANTS[name].frequencies)


def test_a_dead_time_that_is_given_is_held():
    found, deviation = values(fitted(measured(), modes=2, dead_time=DEAD_TIME))
    assert (found["dead_time"], deviation["dead_time"]) == (DEAD_TIME, 0)
    assert found["rigid_body_gain"] == pytest.approx(0.132, rel=1e-3)


def test_a_negative_dead_time_is_reported():
    result = fitted(measured(dead_time=-0.4e-3), modes=2)
    assert values(result)[0]["dead_time"] == pytest.approx(-0.4e-3, abs=1e-5)
    assert "removes more delay than there is" in result.message


@pytest.mark.parametrize("lag", [0.0, 8e-4])
def test_a_lag_is_found_beside_the_dead_time(lag):
    response = measured(noise=1e-3)
    lagged = replace(response, response=response.response / (1 + 2j * np.pi * response.frequency * lag))
    found = ModalFit(method=Conventional()).solve(lagged, may_lag=True).solution
    assert found.poles[1, 0] == pytest.approx(TWO.frequencies[1], abs=0.01)
    assert [found.model.delay(found.p), found.model.lag(found.p)] == pytest.approx([DEAD_TIME, lag], abs=2e-6)


def test_the_magnitude_alone_knows_no_dead_time():
    result = fitted(measured(), modes=2, quantity="magnitude")
    assert "dead_time" not in values(result)[0]
    assert values(result)[0]["frequencies.1"] == pytest.approx(81.2, abs=0.03)
    assert "phase" not in result.curves[0].columns


@pytest.mark.parametrize("noise", [0.0, thorough(0.01)])
@pytest.mark.parametrize("modes", [0, thorough(2)])
def test_viscous_friction_and_a_spring_to_ground(modes, noise):
    ground = {"viscous_coefficient": 40.0, "ground_stiffness": 3e3}
    plant = (TWO if modes else Modal(rigid_body_gain=0.2)).model_copy(update=ground)
    result = fitted(measured(plant, noise=noise, known=noise > 0), fit_ground=True)
    found, deviation = values(result)
    assert metric(result, "modes") == modes
    for name, value in {**ground, "rigid_body_gain": plant.rigid_body_gain}.items():
        assert abs(found[name] - value) <= max(4 * deviation[name], 1e-8 * value)
    first = next(curve for curve in result.curves if curve.name == "resonances").columns["frequency"][0]
    assert first == pytest.approx(np.sqrt(3e3 * plant.rigid_body_gain) / (2 * np.pi), rel=0.03)


def test_ground_that_is_not_there_is_left_out_and_one_that_is_there_is_found():
    none = fitted(measured(PLANTS["rigid body"], seed=1), modes=0, fit_ground=True)
    assert none.fits[0].component["ground_stiffness"] == 0
    held = measured(PLANTS["rigid body"].model_copy(update={"ground_stiffness": 300.0}), noise=0.0)
    assert fitted(held).fits[0].component["ground_stiffness"] == pytest.approx(300.0, rel=1e-6)
    with pytest.raises(RecordError, match="fit_ground if a spring or viscous friction holds the mass"):
        fitted(held, fit_ground=False)


def test_what_is_noisy_counts_little():
    """A decade in which the noise is a hundred times as large does no harm where its covariance says so."""
    loud = np.where((FREQUENCY > 2) & (FREQUENCY < 10), 100.0, 1.0)
    clean, noisy = measured(known=True, noise=1e-12), measured(known=True, noise=1e-3)
    response = clean.response + loud * (noisy.response - clean.response)
    covariance = noisy.covariance * loud[:, None, None] ** 2
    known = fitted(replace(noisy, response=response, covariance=covariance), modes=2)
    alike = fitted(replace(noisy, response=response, covariance=covariance), modes=2, weighting="relative")
    errors = [abs(values(result)[0]["rigid_body_gain"] / 0.132 - 1) for result in (known, alike)]
    assert errors[0] < 3e-4
    assert errors[1] > 1e-3


@pytest.mark.thorough
def test_weights_of_two_periods_do_not_feign_accuracy():
    """With a variance of two degrees of freedom at each point, the stated deviation is still that of the errors."""
    generator, found = np.random.default_rng(3), []
    plant = PLANTS["one mode"]
    for seed in range(12):
        clean = measured(plant, noise=0.0, seed=seed)
        shape = (2, FREQUENCY.size)
        error = (generator.standard_normal(shape) + 1j * generator.standard_normal(shape)) / np.sqrt(2)
        periods = clean.response * (1 + 0.01 * np.sqrt(2) * error)
        parts = np.stack([(periods[0] - periods[1]).real, (periods[0] - periods[1]).imag]) / 2
        covariance = np.einsum("ik,jk->kij", parts, parts)
        response = replace(
            clean, response=periods.mean(axis=0), covariance=covariance, freedom=np.full(FREQUENCY.size, 2.0)
        )
        fit = fitted(response, modes=1).fits[0]
        found.append((fit.values - [0.132, 38.8, 0.04, 0.342, DEAD_TIME]) / fit.standard_deviation)
    assert np.std(found) == pytest.approx(1.0, abs=0.35)  # of 60 correlated numbers


def test_unsettled_points_are_left_out():
    good = measured()
    at = (FREQUENCY > 30) & (FREQUENCY < 32)
    spoilt = replace(good, response=np.where(at, 5 * good.response, good.response), settled=~at)
    result = fitted(spoilt, modes=2)
    assert metric(result, "points") == 200 - at.sum()
    assert values(result)[0]["rigid_body_gain"] == pytest.approx(0.132, rel=2e-3)


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"min_frequency": 195.0}, "too few even for a rigid body"),
        ({"min_frequency": 170.0, "modes": 3}, "too few for more than 2 modes"),
        ({"min_frequency": 300.0}, "no settled point"),
        ({"modes": 3}, r"supports fewer than 3 modes.*set modes to 2"),
        ({"max_frequency": 5.0, "modes": 1}, "supports fewer than 1 mode:"),
        ({"weighting": "noise"}, "record two periods"),
    ],
)
def test_what_is_not_identifiable_is_refused(given, what):
    with pytest.raises(RecordError, match=what):
        fitted(measured(), **given)


def test_parameters_that_are_not_identifiable_are_named():
    """Below 10 Hz the mode at 38.8 Hz is a stiffness: its frequency and its gain are not both identifiable."""
    with pytest.raises(RecordError, match=r"not identifiable .*\.0"):
        fitted(measured(PLANTS["one mode"], noise=1e-4, dead_time=0.0), max_frequency=10.0, modes=1, dead_time=0.0)


def test_another_response_is_no_plant():
    upside_down = measured()
    with pytest.raises(RecordError, match="change the sign"):
        fitted(replace(upside_down, response=-upside_down.response), modes=2)
    with pytest.raises(RecordError, match="position over force"):
        fitted(replace(upside_down, response=1 / upside_down.response), modes=2)


def test_limits_of_the_band_are_checked():
    with pytest.raises(ParameterError, match="more than min_frequency"):
        ModalFit(method=Conventional(), min_frequency=20.0, max_frequency=10.0)


def test_another_unit_is_kept():
    fit = fitted(replace(measured(), unit="rad/A"), modes=2).fits[0]
    assert fit.units[0] == "(rad/A)/s**2"


@pytest.fixture(scope="module")
def signals():
    return simulated(guide(), tuple(np.geomspace(18, 160, 40)))


def test_the_response_of_another_method_is_fitted(signals):
    """The proposed response gives the plant behind the friction, the conventional one a stiffer machine."""
    path = {"input_dead_time": 1e-3}
    given = {"modes": 2, "quantity": "magnitude", "min_frequency": 20.0, "max_frequency": 150.0}
    true = ModalFit(method=EffectiveInput(friction=guide(), **path), **given).estimate(signals)
    assert true.outcome is Outcome.OK
    assert true.response is not None
    assert true.fits[0].component["rigid_body_gain"] == pytest.approx(TABLE.rigid_body_gain, rel=1e-3)
    assert true.fits[0].component["frequencies"] == pytest.approx(TABLE.frequencies, abs=0.02)
    apparent = ModalFit(method=Conventional(refer_to_plant=True, **path), **given).estimate(signals).fits[0].component
    assert apparent["rigid_body_gain"] > 1.2 * TABLE.rigid_body_gain
    assert apparent["frequencies"][0] > 40.5


def test_the_fit_is_a_plant_of_a_study(signals):
    method = EffectiveInput(friction=guide(), input_dead_time=1e-3)
    fit = ModalFit(method=method, modes=2, dead_time=0.0).estimate(signals).fits[0]
    assert fit.kind == "plant"
    plant = create(discover(), Modal, dict(fit.component))
    assert [eval_name(plant, name) for name in fit.parameters if name != "dead_time"] == list(fit.values[:-1])


def eval_name(plant, name):
    head, _, number = name.partition(".")
    return getattr(plant, head)[int(number)] if number else getattr(plant, head)


def test_what_the_signals_say_is_passed_on(signals):
    few = replace(signals, segments=signals.segments[:2], outcome=Outcome.NOT_SETTLED, findings=remarks("as a test"))
    result = ModalFit(method=Conventional()).estimate(few)
    assert result.outcome is Outcome.NOT_SETTLED
    assert "as a test" in result.message
    assert "too few" in result.message
    assert result.fits == ()
    assert result.response is not None


def test_whiteness():
    generator = np.random.default_rng(4)
    white = [whiteness(generator.standard_normal(400), 2) for _ in range(400)]
    assert np.mean(np.array(white) < 0.05) == pytest.approx(0.05, abs=0.035)
    assert whiteness(np.sin(np.arange(200) / 10), 1) < 1e-6
