"""Swept sines and binary sequences: band, closure, flatness."""

import numpy as np
import pytest
from fraexp_plugins.excitations.chirp import Chirp
from fraexp_plugins.excitations.prbs import Prbs

from fraexp.errors import ParameterError
from tests.excitations.spectra import TS, amplitudes, crest_factor
from tests.refusals import refused


@pytest.mark.parametrize("sweep", ["logarithmic", "linear"])
def test_a_chirp_closes_and_stays_in_its_band(sweep):
    (period,) = Chirp(amplitude=10, min_frequency=2, max_frequency=200, period=10, spacing=sweep).periods(TS)
    frequency = period.lines / 10
    assert (frequency[0], frequency[-1]) == (2, 200)
    assert period.lines.size == 1981
    energy = amplitudes(period) ** 2
    assert energy[period.lines].sum() > 0.96 * energy.sum()
    assert np.abs(period.waveform).max() <= 10
    assert crest_factor(period) < 1.45
    assert period.waveform[0] == 0
    step = np.abs(np.diff(np.append(period.waveform, period.waveform[0])))
    assert step[-1] < 0.01 * step.max()


@pytest.mark.parametrize(("sweep", "slope"), [("logarithmic", -0.5), ("linear", 0.0)])
def test_a_chirp_has_as_much_energy_per_octave_or_per_hertz(sweep, slope):
    (period,) = Chirp(amplitude=10, min_frequency=2, max_frequency=200, period=20, spacing=sweep).periods(TS)
    frequency, found = period.lines / 20, amplitudes(period)[period.lines]
    inside = (frequency > 5) & (frequency < 150)
    assert np.polyfit(np.log(frequency[inside]), np.log(found[inside]), 1)[0] == pytest.approx(slope, abs=0.02)


def test_the_shape_of_a_chirp_bounds_its_peaks():
    shaped = (
        Chirp(amplitude=10, min_frequency=2, max_frequency=200, amplitude_profile=((2.0, 0.1), (200.0, 1.0)))
        .periods(TS)[0]
        .waveform
    )
    assert np.abs(shaped[: shaped.size // 2]).max() == pytest.approx(10 * 10**-0.5, rel=0.02)  # half way: 20 Hz
    assert np.abs(shaped).max() == pytest.approx(10, rel=0.02)


@pytest.mark.parametrize("order", range(3, 14))
def test_the_lines_of_a_maximum_length_sequence_are_flat(order):
    (period,) = Prbs(amplitude=3, order=order, inverse_repeat=False, min_frequency=1e-3, max_frequency=999.9).periods(
        TS
    )
    bits = 2**order - 1
    assert period.waveform.size == bits
    np.testing.assert_array_equal(period.lines, np.arange(1, bits // 2 + 1))
    np.testing.assert_allclose(amplitudes(period)[period.lines], 6 * np.sqrt(bits + 1) / bits, rtol=1e-9)
    assert abs(period.waveform.mean()) == pytest.approx(3 / bits)
    assert crest_factor(period) == 1


def test_an_inverse_repeat_sequence_has_odd_lines_alone():
    (period,) = Prbs(amplitude=3, order=11, samples_per_bit=2, min_frequency=1, max_frequency=200).periods(TS)
    half = period.waveform.size // 2
    assert half == 2 * (2**11 - 1)
    np.testing.assert_array_equal(period.waveform[half:], -period.waveform[:half])
    assert (period.lines % 2 == 1).all()
    frequency = period.lines / (2 * half * TS)
    assert frequency[0] == pytest.approx(1, abs=0.5)
    assert frequency[-1] == pytest.approx(200, abs=0.5)
    bits = 2**11 - 1
    held = np.sinc(period.lines / (2 * bits)) / np.sinc(period.lines / (2 * half))
    np.testing.assert_allclose(amplitudes(period)[period.lines], 6 * np.sqrt(bits + 1) / bits * held, rtol=1e-9)


@pytest.mark.parametrize("inverse_repeat", [True, False])
def test_harmonics_without_power_are_no_lines(inverse_repeat):
    sequence = Prbs(
        amplitude=1, order=6, samples_per_bit=8, inverse_repeat=inverse_repeat, min_frequency=1, max_frequency=900
    )
    (period,) = sequence.periods(TS)
    found, bits = amplitudes(period), period.waveform.size // 8
    assert found[bits::bits].max() < 1e-12  # multiples of the clock
    assert not np.isin(np.arange(bits, 4 * bits, bits), period.lines).any()
    assert found[period.lines].min() > 1e-4


@pytest.mark.parametrize(
    ("excitation", "names"),
    [
        (Chirp(amplitude=1, max_frequency=1000), ["chirp", "1000 Hz"]),
        (Chirp(amplitude=1, period=0.1, min_frequency=1, max_frequency=5), ["line", "5 Hz"]),
        (Prbs(amplitude=1, order=3, max_frequency=10), ["10 Hz"]),
    ],
)
def test_impossible_bands_are_refused_in_one_line(excitation, names):
    with refused(ParameterError, *names):
        excitation.check(TS)
