"""Fits that doubt: errors that are no noise, modes that are none, residuals that are alike."""

import re
from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.plants.modal import Modal
from scipy.signal import find_peaks

from fraexp.errors import RecordError
from fraexp.study.accuracy import Accuracy
from tests.identification.plant_responses import DEAD_TIME, FREQUENCY, PLANTS, TWO, fitted, measured, metric, values

PEAK_PROMINENCE_DB = 6.0
"""Height of a peak over its surroundings that a person sees, and that noise of 3 % does not make."""
PEAK_SHIFT = 0.03
"""Relative shift of a damped mode's peak by its neighbours."""


def test_a_model_that_errs_says_so():
    """One mode for two: more is left than noise explains, and the standard deviations grow with it."""
    result = fitted(measured(known=True), modes=1)
    assert "times what noise and model_error explain" in result.message
    assert "a mode at 38.84 Hz (its damping ratio 0.031 ± 0.03 may be 0)" in result.message
    assert metric(result, "cost") > 100
    assert (
        values(result)[1]["rigid_body_gain"] > 20 * values(fitted(measured(known=True), modes=2))[1]["rigid_body_gain"]
    )
    assert "not white, hence no noise" in fitted(measured(), modes=1).message
    assert "not white" in fitted(measured(noise=3e-3), modes=2, dead_time=DEAD_TIME + 2e-5).message


def test_intervals_know_of_errors_that_are_no_noise():
    """What friction leaves scatters by 2 % where the periods tell 0.4 %, and is 1.4 % on the average."""
    rough = measured(PLANTS["rigid body"], noise=0.02, dead_time=0.0)
    quiet = measured(PLANTS["rigid body"], noise=0.004, dead_time=0.0, known=True)
    result = fitted(replace(quiet, response=rough.response * (1 - 0.014)), modes=0)
    found, deviation = values(result)
    assert found["rigid_body_gain"] == pytest.approx(2.0 * (1 - 0.014), rel=5e-3)
    assert abs(found["rigid_body_gain"] - 2.0) < 1.96 * deviation["rigid_body_gain"] < 0.2
    assert "the intervals are widened" in result.message


@pytest.mark.thorough
def test_scatter_at_a_few_points_makes_no_mode():
    """What the scale leaves of a small response near 1 Hz: a light mode would be fitted to one or two points."""
    clean, loud = measured(noise=1e-4), measured(noise=0.3, seed=4)
    result = fitted(replace(clean, response=np.where(FREQUENCY < 1.2, loud.response, clean.response)))
    assert result.fits[0].component["frequencies"] == pytest.approx(TWO.frequencies, abs=0.1)
    assert values(result)[0]["rigid_body_gain"] == pytest.approx(0.132, rel=1e-2)
    assert "dropped, because the data do not support it: a mode at 1." in result.message


@pytest.mark.thorough
def test_a_spring_of_friction_is_no_mode():
    """Where friction holds the mass like a spring a heavily damped mode stands for the rigid body, which is none."""
    omega = 2 * np.pi * FREQUENCY
    modes = TWO.response(omega) + 0.132 / omega**2  # without the rigid body
    sprung = 0.132 / (-(omega**2) + 2j * 0.9 * 13 * omega + 13**2) + modes
    response = replace(measured(noise=0.0), response=sprung * measured().response / measured(noise=0.0).response)
    with pytest.raises(RecordError, match=r"whatever its number of modes.*a rigid body .* may be 0.*min_frequency"):
        fitted(response, fit_ground=False)
    assert "friction looks alike" in fitted(response).message


def test_a_mode_outside_of_the_band_that_is_uncertain_is_dropped_or_reported():
    given = {"max_frequency": 60.0, "dead_time": DEAD_TIME}
    alone = fitted(measured(noise=2e-2), **given)
    assert len(alone.fits[0].component["frequencies"]) == 1
    assert re.search(r"a mode at \d+\.\d+ Hz \(outside of 1 to 58.77 Hz, and uncertain", alone.message)
    both = fitted(measured(noise=2e-2), modes=2, **given)
    assert "the data do not support a mode at" in both.message


@pytest.mark.thorough
def test_a_mode_outside_of_the_band_that_is_well_determined_is_kept():
    """One mode at 400 Hz whose antiresonance at 270 Hz lies within the band; the response is that of eq (1)."""
    plant = Modal(rigid_body_gain=0.132, frequencies=(400.0,), damping_ratios=(0.02,), modal_gain_ratios=(1.2,))
    truth = np.array([0.132, 400.0, 0.02, 1.2])
    inside, doubts = [], []
    for seed in range(12):
        response = measured(plant, known=True, frequency=np.geomspace(5, 300, 100), seed=seed, dead_time=0.0)
        result = fitted(response, dead_time=0.0)
        fit = result.fits[0]
        doubts += [result.message] * bool(result.message)
        assert fit.values[:4] == pytest.approx(truth, rel=0.04)
        assert fit.values[:2] == pytest.approx(truth[:2], rel=4e-3)
        inside.append(np.abs(fit.values[:4] - truth) < 1.96 * fit.standard_deviation[:4])
    assert np.mean(inside) > 0.8
    assert len(doubts) <= 1, "residuals that are not white at 1 %, by chance"


def test_a_fit_that_leaves_much_unexplained_is_not_ok():
    """One mode of two: a person sees a peak without a curve through it."""
    (misfit,) = [each for each in fitted(measured(known=True), modes=1).findings if each.kind == "misfit"]
    assert misfit.error > 0.1
    assert misfit.quantities[0].frequency is not None
    noisy = fitted(measured(PLANTS["two modes"], noise=0.15, known=True), modes=2)
    assert all(each.error < Accuracy().relative_error for each in noisy.findings)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(4))
def test_peaks_that_a_person_sees_are_modes(seed: int) -> None:
    """Plants drawn with one to four modes; peaks of |w^2 G| are counted without a model, on the noisy response."""
    rng = np.random.default_rng(seed)
    count = 1 + seed % 4
    frequencies = np.geomspace(12, 120, count) * rng.uniform(0.85, 1.15, count)
    plant = Modal(
        rigid_body_gain=0.132,
        frequencies=tuple(frequencies),
        damping_ratios=tuple(np.exp(rng.uniform(np.log(1e-3), np.log(0.05), count))),
        modal_gain_ratios=tuple(rng.uniform(0.2, 0.8, count)),
    )
    grid = np.linspace(2, 200, 400) if seed % 2 else np.geomspace(1, 200, 300)
    response = measured(plant, noise=rng.choice([0.003, 0.01, 0.03]), frequency=grid, seed=seed)
    level = 20 * np.log10(np.abs(response.response) * grid**2)
    places, _ = find_peaks(level, prominence=PEAK_PROMINENCE_DB)
    found = np.array(fitted(response).fits[0].component["frequencies"])
    assert places.size
    for place in places:
        spacing = grid[min(place + 2, grid.size - 1)] - grid[place]
        assert np.abs(found - grid[place]).min() < max(spacing, PEAK_SHIFT * grid[place])
