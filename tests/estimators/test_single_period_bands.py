"""Bands of a record of one period: nothing repeats in it, but what the encoder does is known."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput

from fraexp.analysis.confidence import BandReach, circle_factor, confidence_limits
from fraexp.components.kinds import Plant
from fraexp.components.registry import Registry, create
from fraexp.data.results import FrequencyResponse, Outcome
from fraexp.data.signals import Encoder, Segment, Signals
from fraexp.execution.job import run_job
from fraexp.execution.sent_jobs import Job
from fraexp.study.study_file import load
from tests.examples import thorough
from tests.machines import guide, simulated

STEP = 0.1e-6
"""Of the encoder [m]."""
METHOD = {"friction": guide(), "input_dead_time": 1e-3}
ROOT = Path(__file__).parents[2]


def results_of(study: str, registry: Registry, amplitude: float, *overrides: str) -> tuple[list[Any], dict]:
    """Return the last result of a study at an amplitude with each of several changes, and its experiment."""
    file, changes = ROOT / "studies" / f"{study}.toml", overrides or ("",)
    found = [load(study, file, ROOT, registry, [change] if change else []).sweeps for change in changes]
    sweeps = [[each for each in of if each.experiment["excitation"]["amplitude"] == amplitude][-1] for of in found]
    experiment = sweeps[0].experiment
    return run_job(Job(experiment, tuple(each.estimator for each in sweeps)), lambda _: None), experiment


def is_within_circle(response: FrequencyResponse, truth: np.ndarray) -> np.ndarray:
    return np.abs(response.response - truth) <= circle_factor(response.freedom) * response.standard_deviation


@pytest.mark.parametrize("noise", [0.0, thorough(30e-9)])
def test_the_bands_cover_the_truth_at_nine_of_ten_places_of_the_scale(noise: float) -> None:
    """Rounding of one period is no chance: it covers over places of the encoder and frequencies together."""
    ideal = simulated(guide(), tuple(np.geomspace(3, 150, 14)), 12.0, tolerance=1e-7)
    generator, covered = np.random.default_rng(5), []
    estimators = (
        (EffectiveInput(**METHOD, resolution=STEP, noise=noise), EffectiveInput(**METHOD, oversampling=32)),
        (Conventional(resolution=STEP), Conventional()),
    )
    cases = [(coarse, exact.estimate(ideal).response.response) for coarse, exact in estimators]
    for _ in range(15):
        segments = []
        for segment in ideal.segments:
            y = segment.channels["y"] + generator.uniform(0, STEP)
            y = np.round((y + generator.normal(0, noise, y.shape)) / STEP) * STEP
            segments.append(replace(segment, channels={**segment.channels, "y": y}))
        record = replace(ideal, segments=tuple(segments), encoder=Encoder(noise, STEP))
        covered.append([is_within_circle(coarse.estimate(record).response, truth) for coarse, truth in cases])
    shares = np.mean(covered, axis=(0, 2))
    assert np.all(shares > 0.9), shares


def test_what_the_encoder_hides_is_not_ok(registry: Registry) -> None:
    """At 12 N and 1 Hz the encoder of 0.1 µm makes the plant of Fig 12 more than 1.5 dB wrong."""
    (result,), experiment = results_of("paper/fig12", registry, 12.0)
    response = result.response
    truth = create(registry, Plant, experiment["plant"]).response(2 * np.pi * response.frequency)
    error = np.abs(response.response / truth - 1)
    assert result.outcome is Outcome.INACCURATE
    wrong = response.frequency[~BandReach.of(response).is_within()]
    (found,) = [each for each in result.findings if each.kind == "band by noise"]
    assert set(found.frequencies) <= set(wrong)
    assert error.max() > 0.2
    assert error[BandReach.of(response).is_within()].max() < 0.06
    assert np.mean(is_within_circle(response, truth)) > 0.95
    assert np.all(error[response.frequency > 4] < 0.02)


def test_what_the_encoder_shows_is_ok(registry: Registry) -> None:
    (result,), _ = results_of("paper/fig12", registry, 75.0)
    assert (result.outcome, result.message) == (Outcome.OK, "")
    assert np.all(result.response.standard_deviation < 0.01 * np.abs(result.response.response))


def test_a_fit_is_ok_if_the_response_is_so_within_its_range(registry: Registry) -> None:
    (result, wide), _ = results_of("paper/fig12_fit", registry, 12.0, "", "estimator.min_frequency=1")
    assert result.outcome is Outcome.OK
    assert not result.findings
    assert wide.outcome is Outcome.INACCURATE


def test_the_band_of_an_ideal_encoder_is_the_numerical_error(registry: Registry) -> None:
    (result,), _ = results_of("paper/fig12", registry, 75.0, "loop.resolution=0")
    response = result.response
    assert not response.covariance.any()
    magnitude, phase = confidence_limits(response)
    np.testing.assert_allclose(magnitude[1] - 1, response.numerical_error)
    np.testing.assert_allclose(-phase[0], response.numerical_error)


def test_of_a_measured_period_only_stated_noise_is_known() -> None:
    time = np.arange(100) / 100
    channels = {"u": np.sin(2 * np.pi * time)[None], "y": 1e-5 * np.cos(2 * np.pi * time)[None]}
    record = Signals((Segment(1e-3, channels, np.array([1])),), {"u": "N", "y": "m"})
    assert np.isnan(Conventional(resolution=STEP).estimate(record).response.covariance).all()
    method = EffectiveInput(**METHOD, resolution=STEP)
    assert np.isnan(method.estimate(record).response.covariance).all()
    stated = method.model_copy(update={"noise": 30e-9}).estimate(record).response
    assert np.all(stated.covariance[:, 0, 0] > 0)
