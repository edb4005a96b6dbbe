"""Fits that doubt: errors that are no noise, modes that are none, residuals that are alike."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.identification.log_response import log_response

from fraexp.errors import RecordError
from tests.identification.plant_responses import DEAD_TIME, FREQUENCY, PLANTS, TWO, fitted, measured, metric, values


def test_a_model_that_errs_says_so():
    """One mode for two: more is left than noise explains, and the standard deviations grow with it."""
    result = fitted(measured(known=True), modes=1)
    assert "times what noise and 'floor' explain" in result.message
    assert "a mode at 38.84 Hz (its damping ζ = 0.031 ± 0.03 cannot be told from 0)" in result.message
    assert metric(result, "cost") > 100
    assert values(result)[1]["gain"] > 20 * values(fitted(measured(known=True), modes=2))[1]["gain"]
    assert "how much of that is noise is not known" in fitted(measured(), modes=1).message
    assert "not white" in fitted(measured(noise=3e-3), modes=2, dead_time=DEAD_TIME + 2e-5).message


def test_intervals_know_of_errors_that_are_no_noise():
    """What friction leaves scatters by 2 % where the periods tell 0.4 %, and is 1.4 % on the average."""
    rough = measured(PLANTS["rigid body"], noise=0.02, dead_time=0.0)
    quiet = measured(PLANTS["rigid body"], noise=0.004, dead_time=0.0, known=True)
    result = fitted(replace(quiet, response=rough.response * (1 - 0.014)), modes=0)
    found, deviation = values(result)
    assert found["gain"] == pytest.approx(2.0 * (1 - 0.014), rel=5e-3)
    assert abs(found["gain"] - 2.0) < 1.96 * deviation["gain"] < 0.2
    assert "the intervals are widened" in result.message


def test_a_large_residual_of_few_points_is_told():
    """Thirteen points are too few to show that residuals are not white."""
    few = measured(noise=0.1, frequency=np.geomspace(20, 200, 13), dead_time=0.0)
    result = fitted(few, modes=2)
    assert "how much of that is noise is not known: the intervals are widened" in result.message
    assert metric(result, "whiteness") > 1e-3


@pytest.mark.thorough
def test_many_points_are_searched_as_few():
    """Of 568 evenly spaced points no more than 300 take part in the search, and no peak is lost."""
    response = measured(PLANTS["six modes"], noise=1e-4, frequency=np.linspace(1, 200, 568))
    data = log_response(response, (0.0, np.inf), "automatic", 1e-3, 2)
    thin = data.thinned(150)
    assert 150 < thin.frequency.size <= 300
    accelerance = np.abs(data.response) * data.frequency**2
    peaks = 1 + np.flatnonzero((accelerance[1:-1] > accelerance[:-2]) & (accelerance[1:-1] > accelerance[2:]))
    assert np.isin(data.frequency[peaks[accelerance[peaks] > 2 * np.median(accelerance)]], thin.frequency).all()
    assert data.at(np.arange(200)).thinned(150).frequency.size == 200
    assert fitted(response).fits[0].component["frequencies"] == pytest.approx(PLANTS["six modes"].frequencies, rel=1e-4)


@pytest.mark.parametrize("seed", [4, 6, 7])
@pytest.mark.thorough
def test_scatter_at_a_few_points_makes_no_mode(seed):
    """What the scale leaves of a small response near 1 Hz: a light mode would be fitted to one or two points."""
    clean, loud = measured(noise=1e-4), measured(noise=0.3, seed=seed)
    result = fitted(replace(clean, response=np.where(FREQUENCY < 1.2, loud.response, clean.response)))
    assert result.fits[0].component["frequencies"] == pytest.approx(TWO.frequencies, abs=0.1)
    assert values(result)[0]["gain"] == pytest.approx(0.132, rel=1e-2)
    assert "dropped, for the data do not carry it: a mode at 1." in result.message


@pytest.mark.thorough
def test_a_spring_of_friction_is_no_mode():
    """Where friction holds the mass like a spring a heavily damped mode stands for the rigid body, which is none."""
    omega = 2 * np.pi * FREQUENCY
    modes = TWO.response(omega) + 0.132 / omega**2  # without the rigid body
    sprung = 0.132 / (-(omega**2) + 2j * 0.9 * 13 * omega + 13**2) + modes
    with pytest.raises(RecordError, match=r"no number of modes.*a rigid body .* may be 0.*'lowest'"):
        fitted(replace(measured(noise=0.0), response=sprung * measured().response / measured(noise=0.0).response))


def test_a_mode_outside_of_the_band_is_dropped_or_told():
    given = {"highest": 60.0, "dead_time": DEAD_TIME}
    alone = fitted(measured(noise=1e-3), **given)
    assert len(alone.fits[0].component["frequencies"]) == 1
    assert "a mode at 81.13 Hz (outside of the band, 1 to 58.77 Hz)" in alone.message
    both = fitted(measured(noise=1e-3), modes=2, **given)
    assert both.fits[0].component["frequencies"][1] == pytest.approx(81.2, abs=1.0)
    assert "the data do not carry a mode at 81" in both.message


def test_residuals_that_are_alike_count_as_fewer():
    """Of two modes one is fitted: what is left is smooth, and says less than as many numbers that scatter."""
    solution, white = (fitted(measured(known=False), modes=modes) for modes in (1, 2))
    left = metric(solution, "residual") / metric(white, "residual")
    assert values(solution)[1]["gain"] > 1.5 * left * values(white)[1]["gain"]
