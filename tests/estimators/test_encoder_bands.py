"""Bands of both methods under noise and rounding of the encoder, with friction: they cover what they should."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators._shared.measured_motion import repeated_share
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput

from fraexp.analysis.confidence import circle_factor, confidence_limits, degrees_of_freedom
from fraexp.data.signals import Segment, Signals
from tests.examples import some
from tests.machines import FRICTIONLESS, guide, simulated

DELAYS = {"input_dead_time": 1e-3}
STEP = 0.1e-6
"""Of the encoder [m]."""
NOISE = 30e-9
LIMITS_OF_100 = (0.88, 1.0)
"""Coverage that 100 experiments may show of a band of 95 ± 2 %: two binomial standard deviations more."""


def rounded(position):
    return np.round(position / STEP) * STEP


def measured(signals, generator, *, noise=NOISE, periods=8, rounding=rounded):
    """Return the record of several periods through an encoder; the loop itself does not see it."""
    segments = []
    for segment in signals.segments:
        channels = {name: np.repeat(segment.channels[name], periods, axis=0) for name in ("u", "y")}
        channels["y"] = rounding(channels["y"] + generator.normal(0, noise, channels["y"].shape))
        segments.append(replace(segment, channels=channels))
    return replace(signals, segments=tuple(segments))


def is_covered(response, truth):
    """Return whether the limits of magnitude, and those of phase, cover the truth, shape (2, n)."""
    ratio = truth / response.response
    magnitude, phase = confidence_limits(response)
    return np.array([
        (magnitude[0] <= np.abs(ratio)) & (np.abs(ratio) <= magnitude[1]),
        (phase[0] <= np.angle(ratio)) & (np.angle(ratio) <= phase[1]),
    ])  # fmt: skip


@pytest.mark.parametrize("noise", [0.0, 10e-9, 30e-9, 60e-9])
def test_noise_leaves_of_the_rounding_error_what_many_measurements_show(noise):
    generator = np.random.default_rng(3)
    position = generator.uniform(0, 10 * STEP, 400)
    noisy = position + generator.normal(0, noise, (4000, 400))
    shown = np.mean(rounded(noisy) - noisy, axis=0)
    assert np.var(shown) * 12 / STEP**2 == pytest.approx(repeated_share(STEP, noise), rel=0.15, abs=1.2e-3)


@pytest.mark.parametrize("frequency", some([5.0, 20.0, 40.0], 20.0))
def test_the_proposed_band_holds_with_noise_and_rounding(frequency):
    """The scatter over periods alone covered 30 to 88 %: terms that noise hides are missing in all periods alike."""
    signals, generator = simulated(guide(), (frequency,), 12.0), np.random.default_rng(1)
    given = {"friction": guide(), **DELAYS}
    truth = EffectiveInput(**given, oversampling=32).estimate(signals).response.response
    method = EffectiveInput(**given, noise=NOISE, resolution=STEP)
    covered = [is_covered(method.estimate(measured(signals, generator)).response, truth)[:, 0] for _ in range(100)]
    low, high = LIMITS_OF_100
    assert np.all((low <= np.mean(covered, axis=0)) & (np.mean(covered, axis=0) <= high))


def test_rounding_that_repeats_in_every_period_is_in_the_band():
    """Without noise all periods are alike: their scatter is zero, and the error of rounding is not."""
    signals = simulated(guide(), (8.0, 13.0, 21.0, 34.0, 55.0), 12.0, tolerance=1e-8)
    given = {"friction": guide(), **DELAYS}
    record = measured(signals, np.random.default_rng(0), noise=0.0, periods=3)
    for method, coarse in (
        (EffectiveInput(**given, oversampling=32), EffectiveInput(**given, resolution=STEP)),
        (Conventional(), Conventional(resolution=STEP)),
    ):
        truth, found = method.estimate(signals).response.response, coarse.estimate(record).response
        deviation = found.standard_deviation / np.abs(found.response)
        relative = np.abs(found.response / truth - 1)
        assert np.all(relative < 3 * deviation)
        assert np.all(deviation < 0.03)


@pytest.mark.parametrize("noise", some([0.0, 10e-9, 30e-9], 10e-9))
def test_the_conventional_band_covers_rounded_sines(noise):
    """Sines of any amplitude, phase and place, 25 samples a period: the truth is known exactly."""
    generator, inside = np.random.default_rng(4), []
    phase = 2 * np.pi * np.arange(25) / 25
    for _ in range(400):
        phasor = generator.uniform(2e-6, 30e-6) * np.exp(2j * np.pi * generator.random())
        motion = np.real(phasor * np.exp(1j * phase)) + generator.uniform(0, 1e-6)
        y = rounded(motion + generator.normal(0, noise, (8, 25)))
        u = np.tile(np.cos(phase), (8, 1))
        signals = Signals((Segment(1e-3, {"u": u, "y": y}, np.array([1])),), {"u": "N", "y": "m"})
        found = Conventional(resolution=STEP).estimate(signals).response
        inside.append(np.abs(found.response - phasor) <= found.standard_deviation * circle_factor(found.freedom))
    assert 0.91 <= np.mean(inside) <= 0.99


def test_without_noise_and_rounding_the_band_is_that_of_the_scatter():
    signals = simulated(guide(), (20.0,), 12.0)
    record = measured(signals, np.random.default_rng(2), rounding=lambda y: y)
    for friction in (guide(), FRICTIONLESS):
        response = EffectiveInput(friction=friction, **DELAYS).estimate(record).response
        assert response.freedom.tolist() == [14.0]
        assert response.covariance[0, 0, 0] == response.covariance[0, 1, 1]
    stated = EffectiveInput(friction=FRICTIONLESS, **DELAYS, noise=NOISE).estimate(record).response
    assert np.array_equal(stated.covariance, response.covariance), "without friction the scatter is exact"


def test_scatter_that_noise_does_not_explain_widens_the_band():
    signals = simulated(guide(), (20.0,), 12.0)
    record = measured(signals, np.random.default_rng(2), noise=10 * NOISE)
    method = EffectiveInput(friction=guide(), **DELAYS, resolution=STEP)
    honest, unaware = (method.model_copy(update={"noise": size}).estimate(record).response for size in (10 * NOISE, 0))
    assert unaware.standard_deviation[0] > honest.standard_deviation[0] / 2
    assert degrees_of_freedom(unaware)[0] < 60


def test_the_same_record_gives_the_same_band():
    record = measured(simulated(guide(), (20.0,), 12.0), np.random.default_rng(2))
    method = EffectiveInput(friction=guide(), **DELAYS, noise=NOISE, resolution=STEP)
    first, second = (method.estimate(record).response for _ in range(2))
    assert np.array_equal(first.response, second.response)
    assert np.array_equal(first.covariance, second.covariance)


def test_the_band_does_not_depend_on_the_points_per_sample():
    record = measured(simulated(guide(), (20.0,), 12.0), np.random.default_rng(2))
    given = {"friction": guide(), **DELAYS, "noise": NOISE, "resolution": STEP}
    few, many = (EffectiveInput(**given, oversampling=n).estimate(record).response for n in (4, 16))
    assert np.abs(few.response - many.response)[0] < 0.1 * many.standard_deviation[0]
    assert few.standard_deviation == pytest.approx(many.standard_deviation, rel=0.1)


@pytest.mark.thorough
@pytest.mark.parametrize("modulation", [0.006, 0.006j])
def test_the_conventional_band_holds_where_friction_gathers_noise_at_the_line(modulation):
    """Noise that the motion modulates lies along one direction, and its spectrum peaks where the motion's does."""
    generator = np.random.default_rng(5)
    periods, samples, seeds = 8, 100, 1200
    turns = np.exp(2j * np.pi * np.arange(periods * samples) / samples)
    hits = []
    for _ in range(seeds):
        slow = coloured(generator, turns.size, cutoff=1 / samples)
        y = np.real((1 + modulation * slow) * turns) + generator.normal(0, 0.01, turns.size)
        channels = {"u": turns.real.reshape(periods, -1), "y": y.reshape(periods, -1)}
        signals = Signals((Segment(1e-3, channels, np.array([1])),), {"u": "N", "y": "m"})
        hits.append(is_covered(Conventional().estimate(signals).response, 1.0)[:, 0])
    assert np.mean(hits, axis=0).min() > 0.917, "less 2 %, and two binomial standard deviations"


def coloured(generator, size, cutoff):
    """Return periodic noise of unit variance with a first-order spectrum; `cutoff` in cycles per sample."""
    shape = 1 / np.abs(1 + 1j * np.fft.rfftfreq(4 * size) / cutoff)
    values = np.fft.irfft(shape * np.fft.rfft(generator.normal(size=4 * size)))[:size]
    return values / np.sqrt(np.mean(shape**2))
