"""A friction model that may be wrong: harmonics tell how wrong it is, the band holds the plant, and no ok is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.lugre import LuGre
from scipy import stats

from fraexp.analysis.confidence import USUAL_MAGNITUDE, BandReach, confidence_limits
from fraexp.data.results import Outcome
from tests.examples import thorough
from tests.machines import TABLE, decibel, guide, simulated
from tests.responses import judged

DELAYS = {"input_dead_time": 1e-3}
FREQUENCIES = tuple(np.geomspace(2.0, 100.0, 16))
WRONG = ({"force_scale": 1.05}, {"force_scale": 0.95}, {"displacement_scale": 1.05}, {"friction": guide(18.8)})


@pytest.fixture(scope="module")
def signals():
    """Return a record at 12 N by an encoder of 0.1 µm."""
    return simulated(guide(), FREQUENCIES, 12.0, resolution=1e-7, tolerance=1e-4)


def estimated(signals, **changes):
    given = {"friction": guide(), "resolution": 1e-7, "oversampling": 8, **DELAYS, **changes}
    return judged(EffectiveInput(**given), signals)


def errors(found):
    """Return the errors of a response [dB], and where its band holds the plant."""
    response = found.response
    ratio = TABLE.response(2 * np.pi * response.frequency) / response.response
    low, high = confidence_limits(response).magnitude
    return np.abs(decibel(ratio)), (np.abs(ratio) >= low - 1e-3) & (np.abs(ratio) <= high + 1e-3)


@pytest.mark.parametrize("changes", WRONG)
def test_a_model_five_percent_wrong_is_corrected_by_the_harmonics(signals, changes):
    found = estimated(signals, **changes)
    error, holds = errors(found)
    assert error.max() < 3
    assert holds.mean() > 0.9
    assert "at most 1.5 times apart" not in found.message, "they are closer"
    metrics = {metric.name: metric.value for metric in found.metrics}
    assert metrics["force_scale by harmonics"] * changes.get("friction", guide()).force_bound == pytest.approx(
        guide().force_bound, abs=metrics["force_scale by harmonics, 95 %"] * guide().force_bound
    )


@pytest.mark.parametrize("changes", WRONG[::2])
def test_a_model_that_is_taken_as_it_stands_has_a_band_to_the_plant(signals, changes):
    found = estimated(signals, corrects_friction=False, **changes)
    error, holds = errors(found)
    assert error.max() > 10
    assert holds.mean() > 0.9
    assert found.outcome is Outcome.INACCURATE


def test_a_wrong_model_that_is_stated_as_certain_is_not_ok(signals):
    found = estimated(signals, force_scale=1.05, force_std=0.0, displacement_std=0.0)
    assert found.outcome is Outcome.INACCURATE
    assert "by the friction model" in found.message


@pytest.mark.parametrize("dead_time", [0.0, 1.0e-3, 1.2e-3])
def test_a_dead_time_is_found_from_the_harmonics(signals, dead_time):
    """It turns the input at the harmonics, where the plant's band is narrow, more than at the fundamentals."""
    found = estimated(
        replace(signals, verification=None), input_dead_time=dead_time, force_std=0.0, displacement_std=0.0
    )
    metrics = {metric.name: metric.value for metric in found.metrics}
    off = metrics["input_dead_time by harmonics"] - DELAYS["input_dead_time"]
    assert abs(off) < metrics["input_dead_time by harmonics, 95 %"] < 5e-5
    assert errors(found)[1].mean() > 0.9


def test_a_dead_time_that_nothing_shows_is_in_the_band():
    """Unless it is stated as exact, or the machine's own."""
    record = simulated(guide(), tuple(np.geomspace(5.0, 150.0, 8)), 75.0, tolerance=1e-4)
    given = {"resolution": 0.0, "input_dead_time": 1.2e-3, "force_std": 0.0, "displacement_std": 0.0}
    unsure, sure = (estimated(record, **given, **changes) for changes in ({}, {"dead_time_std": 0.0}))
    phase = np.degrees(np.angle(TABLE.response(2 * np.pi * sure.response.frequency) / sure.response.response))
    assert np.abs(phase).max() > 9
    assert sure.outcome is Outcome.OK
    reach = np.degrees(BandReach.of(unsure.response).phase)
    assert np.all(np.abs(phase) < reach)
    assert reach.max() < 30
    assert unsure.outcome is Outcome.INACCURATE


def test_where_the_machine_stands_no_harmonic_tells_anything(signals):
    first, *others = simulated(guide(), FREQUENCIES, 12.0, tolerance=1e-4).segments
    still = replace(first, channels={name: np.zeros_like(each) for name, each in first.channels.items()})
    found = estimated(replace(signals, segments=(still, *others)), force_scale=1.05, resolution=0.0)
    scale = {metric.name: metric.value for metric in found.metrics}["force_scale by harmonics"]
    assert scale == pytest.approx(1.0, abs=0.01)


def test_a_sine_that_stands_at_times_does_not_silence_the_others(signals):
    """What standstill hides there is in the band of its own harmonics and of its own point of the plant."""
    (coarse,) = simulated(guide(), FREQUENCIES[9:10], 12.0, resolution=1e-5, tolerance=1e-4).segments
    mixed = (*signals.segments[:9], coarse, *signals.segments[10:])
    found = estimated(replace(signals, segments=mixed), force_scale=1.05)
    metrics = {metric.name: metric.value for metric in found.metrics}
    assert metrics["force_scale by harmonics"] == pytest.approx(1.0, abs=metrics["force_scale by harmonics, 95 %"])
    assert metrics["force_scale by harmonics, 95 %"] < 0.01


@pytest.mark.parametrize("spacing", [1.6, 3.0])
def test_frequencies_far_apart_leave_the_prior(spacing):
    """Between them may be a mode: what the harmonics should do is unknown."""
    sparse = tuple(2.0 * spacing ** np.arange(int(np.log(50) / np.log(spacing))))
    record = simulated(guide(), sparse, 40.0, tolerance=1e-4)
    found = estimated(record, resolution=0.0, force_scale=1.05)
    assert not any("by harmonics" in metric.name for metric in found.metrics)
    assert (found.outcome, found.findings[0].kind) == (Outcome.INACCURATE, "no harmonics")
    assert errors(found)[1].all()


@pytest.mark.parametrize("scale", [1.0, 1.05])
def test_a_mode_between_two_frequencies_does_not_mislead(scale):
    """At 75 Hz, below the mode at 80 Hz, the plant between 63 and 84 Hz is far from any interpolation."""
    record = simulated(guide(), tuple(np.geomspace(2.0, 150.0, 16)), 12.0, resolution=1e-7, tolerance=1e-4)
    found = estimated(record, force_scale=scale, force_std=0.1)
    assert errors(found)[1].mean() > 0.9


@pytest.mark.parametrize("scale", [1.05, thorough(1.2), thorough(0.85)])
@pytest.mark.parametrize(
    ("amplitude", "low", "high", "points"),
    [(12.0, 5, 50, 8), (12.0, 1, 10, 5), (40.0, 1, 10, 5), *(thorough(a, 1, 200, 30) for a in (3.0, 5.0, 7.0))],
)
def test_no_ok_is_wrong(scale, amplitude, low, high, points):
    """Whatever the harmonics can tell, the band holds the plant, and where it is narrow the plant is there.

    A model errs alike at all points: what has to hold it is the shadow of the ellipse of 95 %, of both parts at once.
    """
    record = simulated(guide(), tuple(np.geomspace(low, high, points)), amplitude, resolution=1e-7, tolerance=1e-4)
    found = estimated(record, force_scale=scale)
    response, wider = found.response, stats.chi2.ppf(0.95, 2) / stats.norm.ppf(0.975) ** 2
    wide = {name: wider * getattr(response, name) for name in ("covariance", "model_covariance")}
    error, holds = errors(replace(found, response=replace(response, **wide)))
    assert holds.mean() > 0.85
    assert found.outcome is Outcome.INACCURATE or error.max() < 2 * USUAL_MAGNITUDE


@pytest.mark.parametrize("resolution", [0.0, thorough(1e-8)])
def test_a_law_of_another_kind_is_an_error_of_the_law(resolution):
    """Even harmonics, of which neither law has any, must not speak for it."""
    bristle = {"bristle_stiffness": 4e5, "bristle_damping": 0.0, "viscous_coefficient": 4.69}
    machine = LuGre(**bristle, coulomb_force=17.9, static_force=17.9, stribeck_velocity=1e-3)
    record = simulated(machine, tuple(np.geomspace(4.0, 60.0, 8)), 30.0, resolution=resolution, tolerance=1e-4)
    found = estimated(record, resolution=resolution)
    error, holds = errors(found)
    is_ok = BandReach.of(found.response).is_within()
    assert holds.mean() > 0.9
    assert error[is_ok].max(initial=0.0) < USUAL_MAGNITUDE
    assert found.outcome is Outcome.INACCURATE


def test_errors_that_no_prior_allows_contradict_the_model():
    """Dahl's law bends as rolling elements do if its deflections are twice as large."""
    record = simulated(guide(), tuple(np.geomspace(1.0, 200.0, 30)), 30.0, resolution=1e-7, tolerance=1e-4)
    dahl = Dahl(stiffness=17.9 / 30e-6, coulomb_force=17.9)
    for changes, is_far in (({"friction": dahl}, True), ({"force_scale": 1.2}, False), ({"force_scale": 1.5}, True)):
        found = estimated(record, **changes)
        assert any(each.place == "friction model" for each in found.findings) is is_far
        assert not is_far or found.outcome is Outcome.INACCURATE
