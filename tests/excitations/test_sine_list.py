"""A list of sines: amplitude and number of periods of each, samples that interleave, and what is refused."""

from math import gcd

import numpy as np
import pytest

from fraexp.components.kinds import Excitation
from fraexp.components.registry import create
from fraexp.errors import ParameterError
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.excitations.spectra import TS, amplitudes, others
from tests.machines import LEAD, TABLE, guide
from tests.refusals import refused

LIST = {"name": "sine_list", "frequencies": [50.0, 5.0, 5.0], "amplitudes": [12.0, 3.0, 24.0]}


@pytest.fixture
def made(registry):
    """Return what builds a list of sines."""
    return lambda **given: create(registry, Excitation, {**LIST, **given})


@pytest.fixture(scope="module")
def machine():
    return Machine(TABLE, guide(), LEAD, ControlLoop.parse({"sample_time": TS}, "loop"), Numerics())


def test_each_sine_has_its_frequency_and_amplitude(made):
    periods = made().periods(TS)
    found = [amplitudes(period)[period.lines[0]] for period in periods]
    np.testing.assert_allclose(found, [12, 3, 24], rtol=1e-12)
    assert max(others(period).max() for period in periods) < 1e-12
    frequency = [float(period.lines[0] / (period.waveform.size * TS)) for period in periods]
    np.testing.assert_allclose(frequency, [50, 5, 5], rtol=1e-3)


def test_one_amplitude_is_that_of_all(made):
    found = [amplitudes(period)[period.lines[0]] for period in made(amplitudes=[7.0]).periods(TS)]
    np.testing.assert_allclose(found, 7, rtol=1e-12)


def test_each_sine_is_recorded_as_often_as_it_says(made, machine):
    signals = simulate_loop(machine, made(period_counts=[3, 1, 2], recorded_periods=9), lambda _: None)
    assert [len(segment.channels["y"]) for segment in signals.segments] == [3, 1, 2]
    assert [segment.samples for segment in signals.segments] == [period.waveform.size for period in made().periods(TS)]
    same = simulate_loop(machine, made(recorded_periods=2), lambda _: None)
    assert [len(segment.channels["y"]) for segment in same.segments] == [2, 2, 2]


@pytest.mark.parametrize("cycles", [2, 7, 10])
@pytest.mark.parametrize("frequency", [0.7, 5.0, 47.3, 180.0])
def test_interleaved_samples_meet_the_sine_at_different_phases(made, cycles, frequency):
    excitation = made(frequencies=[frequency], amplitudes=[1.0], interleaved_cycles=cycles)
    (period,) = excitation.periods(TS)
    samples, line = period.waveform.size, int(period.lines[0])
    assert gcd(samples, line) == 1
    assert cycles <= line <= cycles + 8
    assert line / (samples * TS) == pytest.approx(frequency, rel=2e-3)
    phases = np.unique(np.round((line * np.arange(samples) % samples) / samples, 12))
    assert phases.size == samples
    assert others(period).max() < 1e-12


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ({"frequencies": []}, ["frequencies"]),
        ({"amplitudes": [1.0, 2.0]}, ["3 frequencies", "2 amplitudes"]),
        ({"frequencies": [1.0, -1.0, 2.0]}, ["frequencies", 0]),
    ],
)
def test_lists_that_do_not_fit_are_refused(made, given, names):
    with refused(ParameterError, *names):
        made(**given)


@pytest.mark.parametrize(
    ("given", "names"),
    [({"frequencies": [1200.0, 5.0, 6.0]}, ["Nyquist"]), ({"period_counts": [100_000, 1, 1]}, ["samples"])],
)
def test_what_cannot_be_sampled_is_refused(made, given, names):
    with refused(ParameterError, *names):
        made(**given).check(TS)
