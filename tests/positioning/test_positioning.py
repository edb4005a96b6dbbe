"""What the estimator makes of motions whose course is known."""

from pathlib import Path

import numpy as np
import pytest
from fraexp_plugins.positioning.positioning_metrics import PositioningMetrics
from pytest import approx

from fraexp.components.registry import discover
from fraexp.data.findings import remarks
from fraexp.data.results import Outcome
from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError
from fraexp.execution.job import run_job
from fraexp.execution.sent_jobs import Job
from fraexp.study.study_file import load, packaged_studies
from tests.refusals import refused

SAMPLE_TIME_S = 1e-3
BAND = 4e-6


def signals(deviation, target=1e-3, start=0.0, before=50, u=None):
    """Return a step from `start` to `target` [m], after which the position deviates so from the target."""
    reference = np.concatenate([np.full(before, start), np.full(deviation.size, target)])
    y = np.concatenate([np.full(before, start), target + deviation])
    channels = {"y": y[None, :], "reference": reference[None, :]}
    units = {"y": "m", "reference": "m"}
    if u is not None:
        channels["u"], units["u"] = np.full((1, y.size), u), "N"
    return Signals((Segment(SAMPLE_TIME_S, channels, np.array([1])),), units)


def metrics(of, **given):
    result = PositioningMetrics(settling_window=BAND, **given).estimate(of)
    return {metric.name: metric.value for metric in result.metrics}


def ringing(amplitude, frequency=40.0, decay=20.0, samples=400):
    time = np.arange(samples) * SAMPLE_TIME_S
    return -amplitude * np.exp(-decay * time) * np.cos(2 * np.pi * frequency * time)


def test_a_decaying_vibration():
    deviation = ringing(20e-6, frequency=25.0, decay=10.0)  # its extremes are samples, nearly
    found = metrics(signals(deviation, u=-30.0))
    assert found["overshoot"] == approx(20e-6 * np.exp(-0.2), rel=0.01)
    assert found["vibration frequency"] == approx(25.0, rel=0.02)
    extremes = 20e-6 * np.exp(-10 * np.array([0.02, 0.04]))
    assert found["residual vibration"] == approx(extremes.sum() / 2, rel=0.01)
    last = np.flatnonzero(np.abs(deviation) > BAND)[-1]
    # the reference moves from sample 49 to sample 50, where the deviation begins
    assert found["settling time"] == approx((last + 2) * SAMPLE_TIME_S)
    assert found["first entry"] == approx((np.flatnonzero(np.abs(deviation) <= BAND)[0] + 1) * SAMPLE_TIME_S)
    assert found["steady-state error"] == approx(0, abs=0.5e-6)
    assert found["peak thrust"] == 30.0


@pytest.mark.parametrize(("target", "start"), [(1e-3, 0.0), (-1e-3, 0.0), (2e-3, 1e-3)])
def test_overshoot_is_what_goes_beyond_the_target_in_the_direction_of_the_move(target, start):
    direction = np.sign(target - start)
    beyond, short = direction * np.linspace(9e-6, 0, 200), -direction * np.linspace(9e-6, 0, 200)
    assert metrics(signals(beyond, target, start))["overshoot"] == approx(9e-6)
    assert metrics(signals(short, target, start))["overshoot"] == approx(0.0, abs=1e-15)


def test_how_often_the_band_is_left_again():
    deviation = np.concatenate([np.full(20, -9e-6), np.zeros(20), np.full(20, 9e-6), np.zeros(20), np.full(5, -5e-6)])
    found = metrics(signals(np.concatenate([deviation, np.zeros(100)])))
    assert found["departures"] == 2
    assert found["first entry"] == approx(21e-3)
    assert found["settling time"] == approx(86e-3)


def named(result) -> dict[str, dict[str, float]]:
    return {of.kind: {each.name: each.value for each in of.quantities} for of in result.findings}


def test_what_stays_outside_has_no_settling_time_and_says_so():
    of = signals(np.full(200, 5e-6))
    result = PositioningMetrics(settling_window=BAND).estimate(of)
    found = metrics(of)
    assert np.isnan(found["settling time"]) and np.isnan(found["first entry"])
    assert found["steady-state error"] == approx(5e-6)
    assert result.outcome is Outcome.OK
    assert named(result) == {"outside its window": {"settling window ±": BAND, "steady-state error": approx(5e-6)}}


def test_what_goes_on_vibrating_is_told_apart_from_what_stays_off():
    result = PositioningMetrics(settling_window=BAND).estimate(signals(ringing(20e-6, frequency=25.0, decay=0.0)))
    assert set(named(result)["outside its window"]) == {"settling window ±", "vibration"}
    assert "vibration 20 µm at 25 Hz" in result.message
    both = PositioningMetrics(settling_window=BAND).estimate(signals(30e-6 + ringing(20e-6, frequency=25.0, decay=0.0)))
    assert named(both)["outside its window"] == {
        "settling window ±": BAND, "steady-state error": approx(30e-6, rel=1e-2), "vibration": approx(20e-6, rel=1e-2),
    }  # fmt: skip


@pytest.mark.parametrize(("band", "target"), [(1.0, 1e-3), (4e-6, 1e-9)])
def test_a_move_within_the_band_tests_nothing_and_says_so(band, target):
    result = PositioningMetrics(settling_window=band).estimate(signals(np.zeros(200), target=target))
    found = {metric.name: metric.value for metric in result.metrics}
    assert np.isnan(found["settling time"]) and np.isnan(found["first entry"])
    assert named(result) == {"no longer than its window": {"settling window ±": band}}


def test_a_small_correction_does_not_hide_the_move_before_it():
    reference = np.concatenate([np.zeros(50), np.full(400, 1e-3), np.full(400, 1.001e-3)])
    y = np.concatenate([np.zeros(50), 1e-3 + ringing(30e-6), np.full(400, 1.001e-3)])
    channels = {"y": y[None], "reference": reference[None]}
    of = Signals((Segment(SAMPLE_TIME_S, channels, np.array([1])),), {"y": "m", "reference": "m"})
    assert metrics(of)["settling time"] == approx(metrics(signals(ringing(30e-6)))["settling time"])
    (found,) = PositioningMetrics(settling_window=BAND).estimate(of).findings
    assert (found.kind, found.place) == ("no longer than its window", "1 of 2 moves")


def test_the_scale_is_no_vibration():
    generator = np.random.default_rng(0)
    deviation = np.round(3e-6 * np.exp(-np.arange(2000) / 200) / 1e-7 + generator.normal(0, 0.5, 2000)) * 1e-7
    found = metrics(signals(deviation), resolution=1e-7, noise=0.05e-6)
    assert found["residual vibration"] == 0.0
    assert np.isnan(found["vibration frequency"])
    assert metrics(signals(deviation))["residual vibration"] > 0


def test_the_curve_holds_what_is_to_be_drawn():
    (curve,) = PositioningMetrics().estimate(signals(ringing(20e-6), u=1.0)).curves
    assert curve.name == "positioning"
    assert list(curve.columns) == ["time", "position", "reference", "error", "target", "band", "thrust"]
    lengths = ("position", "reference", "error", "target", "band")
    assert curve.units == {"time": "s", **dict.fromkeys(lengths, "m"), "thrust": "N"}
    assert np.array_equal(curve.columns["error"], curve.columns["reference"] - curve.columns["position"])
    assert list(PositioningMetrics().estimate(signals(ringing(20e-6))).curves[0].columns)[-1] == "band"


def test_each_sample_has_the_target_of_its_move():
    steps = [(100, 0.0), (150, 1e-3), (200, 3e-3), (80, 1e-3)]
    reference = np.concatenate([np.full(count, place) for count, place in steps])
    channels = {"y": reference[None], "reference": reference[None]}
    of = Signals((Segment(SAMPLE_TIME_S, channels, np.array([1])),), {"y": "m", "reference": "m"})
    (curve,) = PositioningMetrics(settling_window=2e-6).estimate(of).curves
    expected = np.repeat([1e-3, 3e-3, 1e-3], [100 + 150 - 1, 200, 80 + 1])  # a move begins at the sample before
    assert np.array_equal(curve.columns["target"], expected)
    assert np.array_equal(curve.columns["band"], np.full(reference.size, 2e-6))


def test_what_cannot_be_judged_is_refused():
    resting = signals(np.zeros(100), target=0.0)
    with refused(RecordError, "reference"):
        PositioningMetrics().estimate(resting)
    ramp = np.linspace(0, 1e-3, 500)
    going = Signals(
        (Segment(SAMPLE_TIME_S, {"y": ramp[None], "reference": ramp[None]}, np.array([1])),),
        {"y": "m", "reference": "m"},
    )
    with pytest.raises(RecordError):
        PositioningMetrics().estimate(going)
    with refused(RecordError, "'r'", "reference"):
        PositioningMetrics(reference="r").estimate(resting)


def test_a_loop_that_diverged_has_no_metrics_but_its_outcome():
    found = PositioningMetrics().estimate(
        Signals((), {"y": "m", "reference": "m"}, Outcome.DIVERGED, remarks("it left"))
    )
    assert (found.outcome, found.message, found.metrics) == (Outcome.DIVERGED, "it left", ())


@pytest.fixture(scope="module")
def figure_8(tmp_path_factory):
    """Metrics of the paper's Fig 8, by case."""
    folder: Path = tmp_path_factory.mktemp("workspace")
    study = load("paper/fig08", packaged_studies() / "paper" / "fig08.toml", folder, discover())
    answers = {
        sweep.labels["case"]: run_job(Job(sweep.experiment, (sweep.estimator,)), lambda _: None)[0]
        for sweep in study.sweeps
    }
    return {label: {metric.name: metric.value for metric in answer.metrics} for label, answer in answers.items()}


def test_figure_8(figure_8):
    nominal, wrong, proposed = figure_8.values()
    for found in (nominal, proposed):
        assert found["departures"] == 0
        assert found["overshoot"] < 1e-6
        assert found["settling time"] < 0.041
    assert wrong["departures"] >= 1
    assert wrong["overshoot"] > 4e-6
    assert np.isnan(wrong["settling time"])


def test_with_integral_action_the_overshoot_of_figure_8_returns(tmp_path):
    study = load("paper/fig08_integral", packaged_studies() / "paper" / "fig08_integral.toml", tmp_path, discover())
    moves = [sweep for sweep in study.sweeps if sweep.estimator["name"] == "positioning_metrics"]
    answers = [run_job(Job(sweep.experiment, (sweep.estimator,)), lambda _: None)[0] for sweep in moves]
    nominal, wrong = ({metric.name: metric.value for metric in answer.metrics} for answer in answers)
    assert nominal["overshoot"] < 1e-6
    assert nominal["departures"] == 0
    assert wrong["overshoot"] > 50e-6  # 127 µm: far more than the window
    assert wrong["settling time"] < 0.16  # 144 ms; the record ends after 200 ms
    assert abs(wrong["steady-state error"]) < 1e-6
