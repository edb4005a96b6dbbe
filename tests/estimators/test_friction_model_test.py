"""Is the friction model good enough? The answer without the plant, from a noisy scale and from a record's channels."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fraexp_plugins.estimators.friction_model_test import FrictionModelTest
from fraexp_plugins.excitations.multisine import Multisine

from fraexp.data.results import Outcome
from fraexp.errors import RecordError
from tests.examples import some
from tests.machines import TABLE, excited, guide, simulated

SCALE = {"resolution": 0.1e-6, "noise": 30e-9}
BANDS = ("1-5 Hz", "5-20 Hz", "20-100 Hz")


@cache
def recorded(rms, *, periods=4):
    excitation = Multisine(
        rms=rms,
        min_frequency=1,
        max_frequency=100,
        line_spacing=0.5,
        points=50,
        detection_group_size=0,
        realisations=6,
        recorded_periods=periods,
    )
    return excited(excitation, guide(), **SCALE)


@pytest.fixture(scope="module", params=[12.0, 40.0])
def signals(request):
    return recorded(request.param)


def diagnosed(signals, **given):
    result = FrictionModelTest(**{"friction": guide(), "input_dead_time": 1e-3, **SCALE, **given}).estimate(signals)
    return result, {metric.name: metric.value for metric in result.metrics}


@pytest.mark.parametrize("scale", some(["force_scale", "displacement_scale"], "force_scale"))
@pytest.mark.parametrize("sign", some([1, -1], 1))
def test_the_scatter_orders_the_errors_of_the_model(signals, scale, sign):
    """Least for the right model and greater for 1, 3 and 10 %, on either side, in every band that friction reaches."""
    found = [diagnosed(signals, **{scale: 1 + sign * error})[1] for error in (0.0, 0.01, 0.03, 0.1)]
    for band in BANDS:
        scatter = [metrics[f"scatter {band}"] for metrics in found]
        assert scatter == sorted(scatter), band
        assert scatter[1] > 1.5 * scatter[0], band


def test_the_right_model_scatters_as_much_as_the_scale_explains(signals):
    result, metrics = diagnosed(signals)
    for band in BANDS:
        assert 0.5 < metrics[f"ratio {band}"] < 2
        assert metrics[f"verdict {band}"] == 1
    assert result.outcome is Outcome.OK
    assert result.message == ""


@pytest.mark.parametrize("error", [{"force_scale": 1.1}, {"force_scale": 0.9}])
def test_a_wrong_model_is_found_by_band(error):
    result, metrics = diagnosed(recorded(12.0), **error)
    assert [metrics[f"verdict {band}"] for band in BANDS] == [0, 0, 0]
    assert (result.findings[0].kind, result.findings[0].place) == ("misfit", "1-5 Hz, 5-20 Hz, 20-100 Hz")


def test_the_scatter_shows_how_large_the_error_is(signals):
    """Of the hysteresis: the true error of P̂ is one to four times the scatter of one realisation."""
    response = diagnosed(signals, force_scale=1.03)[0].response
    error = np.abs(response.response / TABLE.response(2 * np.pi * response.frequency) - 1)
    scatter = np.sqrt(response.nonlinear_variance) / np.abs(response.response)
    inside = (response.frequency > 10) & (response.frequency < 100)
    assert 1 < np.median(error[inside] / scatter[inside]) < 4


def test_the_response_is_the_best_linear_approximation(signals):
    response = diagnosed(signals)[0].response
    assert response.input == "u_e"
    assert np.all(response.freedom == 2 * (6 - 1))
    error = np.abs(response.response - TABLE.response(2 * np.pi * response.frequency))
    assert np.median(error / response.standard_deviation) < 3


def test_a_record_without_the_injected_signal_will_do():
    signals = recorded(12.0)
    bare = {name: unit for name, unit in signals.units.items() if name in ("u", "y")}
    segments = [replace(s, channels={name: s.channels[name] for name in bare}, settling=None) for s in signals.segments]
    measured = replace(signals, segments=tuple(segments), units=bare)
    scatter = [diagnosed(measured, force_scale=scale)[1]["scatter 5-20 Hz"] for scale in (1.0, 1.03)]
    assert scatter[1] > 10 * scatter[0]


def test_amplitudes_will_do_in_place_of_phases():
    """The same sine at several amplitudes: with the right model one response, with a wrong one several."""
    several = [simulated(guide(), (20.0,), amplitude) for amplitude in (8.0, 12.0, 20.0, 40.0)]
    signals = replace(several[0], segments=tuple(each.segments[0] for each in several))
    scatter = []
    for scale in (1.0, 1.01, 1.1):
        estimator = FrictionModelTest(friction=guide(), input_dead_time=1e-3, force_scale=scale, bands=(10, 30))
        scatter.append(float(estimator.estimate(signals).curves[0].columns["scatter"][0]))
    assert scatter[0] < 1e-3 < scatter[1] < scatter[2]


def test_one_realisation_is_refused():
    signals = recorded(12.0)
    with pytest.raises(RecordError, match="one realisation of the lines"):
        diagnosed(replace(signals, segments=signals.segments[:1]))


@pytest.mark.parametrize("viscous", [0.0, 50.0])
def test_a_linear_error_is_not_seen(signals, viscous):
    """A wrong viscous coefficient, in place of 4.69 N s/m, is part of a linear y'/û_e: P̂ is wrong, no line scatters."""
    result, metrics = diagnosed(signals, friction=guide(viscous=viscous))
    response = result.response
    error = np.abs(response.response / TABLE.response(2 * np.pi * response.frequency) - 1)
    assert np.median(error[response.frequency < 5]) > 0.01
    assert [metrics[f"verdict {band}"] for band in BANDS] == [1, 1, 1]


@pytest.mark.parametrize("bands", [(200.0, 300.0), (1.0, 20.0, 100.0, 200.0)])
def test_a_band_without_a_line_is_refused(signals, bands):
    with pytest.raises(RecordError, match=r"no line lies in the band \d+ to \d+ Hz; the lines cover 1.5 to 99.5 Hz"):
        diagnosed(signals, bands=bands)


def test_one_period_leaves_the_verdict_open():
    signals = recorded(12.0, periods=1)
    result, metrics = diagnosed(signals, force_scale=1.1)
    assert np.isnan(metrics["noise floor 1-5 Hz"])
    assert np.isnan([metrics[f"verdict {band}"] for band in BANDS]).all()
    assert "two periods" in result.message
    result, metrics = diagnosed(signals, scatter_tolerance=0.5)  # noise included, the scatter is little enough
    assert [metrics[f"verdict {band}"] for band in BANDS] == [1, 1, 1]
    assert result.message == ""
