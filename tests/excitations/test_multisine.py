"""Random-phase multisines: lines, detection lines, realisations, shape, crest factor."""

import numpy as np
import pytest
from fraexp_plugins.excitations.multisine import Multisine
from fraexp_plugins.friction.rolling import Rolling

from fraexp.errors import ParameterError
from tests.excitations.spectra import TS, amplitudes, crest_factor, others
from tests.refusals import refused

FLAT = {"rms": 12.0, "detection_group_size": 0}
ROUNDING = 1e-13


def only(**parameters: object) -> tuple[np.ndarray, np.ndarray, object]:
    (period,) = Multisine.parse({**FLAT, **parameters}, "multisine").periods(TS)
    return period.lines, amplitudes(period)[period.lines], period


@pytest.mark.parametrize(
    ("harmonics", "expected"),
    [("odd", np.arange(3, 400, 2)), ("even", np.arange(2, 401, 2)), ("full", np.arange(2, 401))],
)
def test_exactly_the_lines_of_the_band_are_excited_equally(harmonics, expected):
    lines, found, period = only(harmonics=harmonics)
    np.testing.assert_array_equal(lines, expected)
    np.testing.assert_allclose(found, 12 * np.sqrt(2 / lines.size), rtol=1e-12)
    assert others(period).max() < 1e-12
    assert period.waveform.std() == pytest.approx(12, rel=1e-12)


@pytest.mark.parametrize("changes", [{}, {"crest_iterations": 50}, {"points": 40}, {"detection_group_size": 4}])
def test_even_lines_are_exactly_empty(changes):
    _, _, period = only(**changes)
    half = period.waveform.size // 2
    np.testing.assert_array_equal(period.waveform[half:], -period.waveform[:half])  # to the last bit


def test_an_odd_friction_law_leaves_the_even_lines_of_its_force_empty():
    _, _, period = only(detection_group_size=4)
    friction = Rolling(stiffness=(2e5, 1e5), limit_force=(2.0, 4.0))
    force = friction.force(2e-6 * period.waveform, TS, periodic=True)
    spectrum = np.abs(np.fft.rfft(force)) * 2 / force.size
    odd, even = spectrum[1::2], spectrum[0::2]
    omitted = np.setdiff1d(np.arange(3, 400, 2), period.lines)
    assert even.max() < ROUNDING * odd.max()
    assert spectrum[omitted].min() > 1e-3 * odd.max()  # there the nonlinearity shows


@pytest.mark.parametrize("k", [2, 3, 4, 7])
def test_of_every_k_neighbours_one_is_left_out_at_random(k):
    everything = np.arange(3, 400, 2)
    lines, _, _ = only(detection_group_size=k)
    whole = everything[: everything.size // k * k].reshape(-1, k)
    assert (np.isin(whole, lines).sum(axis=1) == k - 1).all()
    assert np.isin(everything[whole.size :], lines).all()
    places = np.argmin(np.isin(whole, lines), axis=1)
    assert np.unique(places).size == k  # each place of a group is drawn


def test_a_logarithmic_grid_is_as_dense_in_each_octave():
    lines, _, _ = only(points=60, line_spacing=0.1, min_frequency=2)
    assert (lines % 2 == 1).all()
    ratios = lines[1:] / lines[:-1]
    np.testing.assert_allclose(ratios[lines[:-1] > 100], 100 ** (1 / 59), rtol=0.02)  # rounding to a grid of 0.2 Hz


def test_a_seed_reproduces_and_realisations_differ_in_their_phases_alone():
    first, again = (Multisine(rms=12, realisations=3, seed=4).periods(TS) for _ in range(2))
    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.waveform, two.waveform)
    fewer = Multisine(rms=12, realisations=2, seed=4).periods(TS)
    np.testing.assert_array_equal(fewer[1].waveform, first[1].waveform)
    other = Multisine(rms=12, seed=5).periods(TS)[0]
    assert not np.array_equal(other.lines, first[0].lines)
    for one in first[1:]:
        np.testing.assert_array_equal(one.lines, first[0].lines)
        np.testing.assert_allclose(amplitudes(one), amplitudes(first[0]), atol=1e-12)
        assert abs(np.corrcoef(one.waveform, first[0].waveform)[0, 1]) < 0.3  # 4/√lines


def test_phases_are_uniform_and_independent_over_realisations():
    periods = Multisine(rms=12, realisations=200, detection_group_size=0).periods(TS)
    phasors = np.array([np.fft.rfft(period.waveform)[period.lines] for period in periods])
    turns = phasors / np.abs(phasors)
    assert np.abs(turns.mean(axis=0)).max() < 4 / np.sqrt(200)
    assert abs(np.mean(turns[:, 1:] * turns[:, :-1].conj())) < 4 / np.sqrt(turns[:, 1:].size)


def test_the_shape_is_interpolated_on_logarithmic_axes_and_keeps_the_total():
    lines, found, period = only(amplitude_profile=((10.0, 1.0), (100.0, 5.0)))
    frequency = lines / (period.waveform.size * TS)
    expected = 5 ** np.clip(np.log10(frequency / 10), 0, 1)
    np.testing.assert_allclose(found / found[0], expected, rtol=1e-9)
    assert period.waveform.std() == pytest.approx(12, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "least", "most"),
    [({}, 1.35, 1.45), ({"detection_group_size": 4}, 1.45, 1.6), ({"points": 60}, 1.6, 1.9)],
)
def test_a_lower_crest_factor_at_the_same_amplitudes(changes, least, most):
    _, random, before = only(**changes)
    _, found, after = only(**changes, crest_iterations=1000)
    np.testing.assert_allclose(found, random, rtol=1e-9)
    assert others(after).max() < 1e-12
    assert crest_factor(before) > 2.5
    assert least < crest_factor(after) < most


@pytest.mark.parametrize("sample_time", [500e-6, 400e-6, 125e-6, 3.337e-4])
def test_periods_are_even_numbers_of_samples_with_small_prime_factors(sample_time):
    (period,) = Multisine(rms=1).periods(sample_time)
    samples = period.waveform.size
    assert samples * sample_time == pytest.approx(2.0, rel=0.01)
    assert samples % 2 == 0
    for prime in (2, 3, 5, 7, 11, 13):
        while samples % prime == 0:
            samples //= prime
    assert samples == 1


@pytest.mark.parametrize(
    ("parameters", "names"),
    [
        ({"min_frequency": 20, "max_frequency": 10}, ["min_frequency", "20 Hz", "max_frequency", "10 Hz"]),
        ({"max_frequency": 1000}, ["1000 Hz", "0.0005 s", "Nyquist"]),
        ({"realisations": 1000, "recorded_periods": 100}, ["400,000,000 samples"]),
        ({"detection_group_size": 1}, ["detection_group_size", 1]),
        ({"amplitude_profile": ((10, 1), (5, 1))}, ["amplitude_profile"]),
    ],
)
def test_impossible_grids_are_refused_in_one_line(parameters, names):
    with refused(ParameterError, "multisine", *names):
        Multisine.parse({"rms": 1, **parameters}, "multisine").check(TS)
