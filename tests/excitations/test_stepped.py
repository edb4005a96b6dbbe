"""Stepped excitations: shaped amplitude, held response, moving axis."""

import re
from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.excitations.moving_sine import MovingSine
from fraexp_plugins.excitations.response_controlled import ForceTrial, ResponseControlled, next_force
from fraexp_plugins.excitations.stepped_sine import SteppedSine

from fraexp.analysis.delays import hold_response, image_factor, path_response
from fraexp.components.kinds import Excitation
from fraexp.data.results import Outcome
from fraexp.data.signals import Segment, Signals
from fraexp.errors import ParameterError
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.excitations.spectra import TS, amplitudes, others
from tests.machines import LEAD, TABLE, decibel, guide
from tests.refusals import refused

FREQUENCIES = (1.0, 5.0, 12.0, 20.0, 39.0, 80.0, 150.0)


def signals_of(excitation: Excitation, **loop: object) -> Signals:
    settings = {"sample_time": TS, "input_dead_time": 2 * TS, "resolution": 1e-7, **loop}
    machine = Machine(TABLE, guide(), LEAD, ControlLoop.parse(settings, "loop"), Numerics())
    return simulate_loop(machine, excitation, lambda _: None)


def amplitude(segment: Segment, channel: str) -> float:
    return float(np.abs(np.fft.rfft(segment.channels[channel].mean(axis=0))[segment.lines[0]]) * 2 / segment.samples)


def test_the_amplitude_of_a_stepped_sine_follows_its_shape():
    shape = ((10.0, 1.0), (100.0, 5.0))
    periods = SteppedSine(amplitude=12, frequencies=(1, 10, 31.6228, 100, 200), amplitude_profile=shape).periods(TS)
    found = [amplitudes(period)[period.lines[0]] for period in periods]
    np.testing.assert_allclose(found, 12 * np.array([1, 1, 5**0.5, 5, 5]), rtol=1e-5)
    assert max(others(period).max() for period in periods) < 1e-12


@pytest.mark.parametrize(("displacement", "noise"), [(5e-6, 30e-9), (50e-6, 0.0)])
def test_the_response_amplitude_is_reached_on_the_table_with_friction_in_few_rounds(displacement, noise, monkeypatch):
    asked: dict[float, int] = {}
    revise = ResponseControlled.revise

    def counted(self, period, segment):
        asked[segment.frequency[0]] = asked.get(segment.frequency[0], 0) + 1
        return revise(self, period, segment)

    monkeypatch.setattr(ResponseControlled, "revise", counted)
    excitation = ResponseControlled(displacement=displacement, max_force=200, frequencies=FREQUENCIES)
    signals = signals_of(excitation, noise=noise)
    assert len(signals.segments) == len(FREQUENCIES)
    for segment in signals.segments:
        assert amplitude(segment, "y") == pytest.approx(displacement, rel=0.01)
    assert max(asked.values()) <= 7


def test_the_highest_force_is_never_exceeded_and_what_was_reached_is_taken():
    excitation = ResponseControlled(displacement=50e-6, max_force=20, frequencies=FREQUENCIES)
    segments = signals_of(excitation).segments
    forces = np.array([amplitude(segment, "excitation") for segment in segments])
    responses = np.array([amplitude(segment, "y") for segment in segments])
    assert forces.max() <= 20 * (1 + 1e-12)
    reached = np.abs(responses / 50e-6 - 1) <= 0.01
    np.testing.assert_allclose(forces[~reached], 20, rtol=1e-12)
    assert (responses[~reached] < 50e-6).all()
    assert 0 < reached.sum() < reached.size


def searched(response, target, max_force=100.0, accuracy=0.01):
    """Return the forces that were tried, with their responses."""
    tried = (ForceTrial(10.0, response(10.0)),)
    for _ in range(11):
        force = next_force(tried, target, max_force, accuracy)
        if force is None:
            break
        tried = (*tried, ForceTrial(force, response(force)))
    return tried


@pytest.mark.parametrize(
    "response",
    [
        lambda force: 3e-6 * force,
        lambda force: 1e-8 * force if force < 20 else 1e-8 * force + 1e-4 * (force - 20),  # breaks away
        lambda force: 1e-9 * force**3,
        lambda force: 1e-4 * force**0.4,
        lambda force: 0.0 if force < 30 else 2e-5 * (force - 29),  # below the encoder's resolution at first
    ],
)
@pytest.mark.parametrize("target", [1e-4, 2e-4])
def test_false_position_finds_the_force_of_any_rising_response(response, target):
    tried = searched(response, target)
    assert tried[-1].response == pytest.approx(target, rel=0.01)
    assert len(tried) <= 10
    assert max(force for force, _ in tried) <= 100


def test_a_response_that_jumps_over_the_amplitude_ends_the_search_at_the_jump():
    tried = searched(lambda force: 1e-6 if force < 40 else 1e-3, target=1e-4)
    assert tried[-1].force == pytest.approx(40, rel=0.01)


def test_a_channel_that_is_no_response_is_refused():
    given = {"displacement": 5e-6, "max_force": 20, "channel": "u"}
    with refused(ParameterError, "response_controlled.channel", "'u'", "'y'", "'displacement'"):
        ResponseControlled.parse(given, "response_controlled")


def test_frequencies_that_miss_the_amplitude_are_told():
    def remark(max_force):
        excitation = ResponseControlled(displacement=50e-6, max_force=max_force, frequencies=(5, 39, 150, 200))
        signals = signals_of(excitation)
        assert signals.outcome is Outcome.OK
        reached = [amplitude(segment, "y") * 1e6 for segment in signals.segments]
        return signals.findings, [one for one in reached if abs(one / 50 - 1) > 0.01]

    (found,), missed = remark(20)
    assert 1 < len(missed) < 4
    assert found.place == f"amplitude at {len(missed)} of 4 frequencies"
    assert [1e6 * each.value for each in found.quantities] == pytest.approx([50, min(missed), max(missed)])
    assert remark(1000) == ((), [])


def test_a_jump_over_the_amplitude_is_told_as_such():
    excitation = ResponseControlled(displacement=50e-6, max_force=1000, frequencies=(39,))
    (segment,) = signals_of(excitation).segments
    jumped = replace(segment, channels={**segment.channels, "y": 1.1 * segment.channels["y"]})
    assert excitation.findings([segment]) == ()
    assert "the response jumps over it" in excitation.findings([segment, jumped])[0].text


def test_limits_are_told_the_highest_force_and_the_stroke_of_the_amplitude():
    assert ResponseControlled(displacement=50e-6, max_force=20).max_force_and_stroke() == (20.0, 100e-6)


@pytest.mark.parametrize("kind", [SteppedSine, MovingSine])
def test_a_frequency_that_is_given_twice_is_refused(kind):
    with refused(ParameterError, f"{kind.name}.frequencies", "20 Hz"):
        kind.parse({"amplitude": 1, "frequencies": [10, 20, 30, "0.02 kHz"]}, kind.name)


@pytest.mark.parametrize(
    ("excitation", "names"),
    [
        (SteppedSine(amplitude=1, frequencies=(5, 100, 100.01)), ["100.01 Hz", "100 Hz", "0.0005 s", "0.2%"]),
        (SteppedSine(amplitude=1, min_frequency=100, max_frequency=101, points=100), ["'points'"]),
        (ResponseControlled(displacement=1e-6, max_force=1, frequencies=(20.001, 20)), ["20.001 Hz"]),
        (MovingSine(amplitude=1, frequencies=(20, 20.001)), ["20.001 Hz"]),
    ],
)
def test_frequencies_that_become_the_same_one_are_refused(excitation, names):
    """Whole periods in whole samples move a frequency: two that meet would be two realisations of one."""
    with refused(ParameterError, excitation.name, *names):
        excitation.check(TS)


@pytest.mark.parametrize(("lowest", "highest"), [(1, 200), (100, 101), (5, 900)])
def test_the_number_of_points_that_fits_is_named_and_fits(lowest, highest):
    def sines(points: int) -> SteppedSine:
        return SteppedSine(amplitude=1, min_frequency=lowest, max_frequency=highest, points=points, min_record_time=0)

    with refused(ParameterError, "'points'") as caught:
        sines(6000).check(TS)
    fitting = int(re.findall(r"([\d,]+) or fewer", str(caught.value))[0].replace(",", ""))
    sines(fitting).check(TS)
    periods = sines(fitting).periods(TS)
    assert len({period.lines[0] / period.waveform.size for period in periods}) == fitting


def velocity(period) -> np.ndarray:
    """Return the velocity of the base motion between its samples [m/s]."""
    return np.diff(np.append(period.reference, period.reference[0])) / TS


@pytest.mark.parametrize("frequency", [0.5, 7.3, 33.3, 200.0, 640.0])
def test_the_base_moves_at_constant_velocity_for_the_cycles_that_are_asked_for(frequency):
    excitation = MovingSine(
        amplitude=4, frequencies=(frequency,), velocity=0.03, reversal_settling_time=0.3, whole_cycles=5
    )
    (period,) = excitation.periods(TS)
    speed, half = velocity(period), period.waveform.size // 2
    assert np.abs(speed).max() == pytest.approx(0.03, rel=1e-9)
    constant = np.abs(speed[:half] - 0.03) < 1e-9
    assert np.diff(np.flatnonzero(constant)).max() == 1  # one stretch
    assert constant.sum() * TS >= 0.3 + 5 / frequency * 0.999 - 2 * TS
    np.testing.assert_allclose(speed[half:], -speed[:half], atol=1e-12)
    assert np.abs(np.diff(speed)).max() <= 1.0 * TS * (1 + 1e-9)  # the acceleration
    assert period.reference[0] == 0 == period.reference.min()
    assert speed[0] < 0.5 * TS * (1 + 1e-9)  # no kick
    assert period.reference.max() == pytest.approx(0.03 * (half * TS - 0.03), rel=1e-9)


@pytest.mark.parametrize("base", ["triangle", "sine"])
@pytest.mark.parametrize("frequency", [1.0, 33.3, 200.0])
def test_the_sine_is_an_even_harmonic_of_a_base_of_odd_ones(base, frequency):
    (period,) = MovingSine(amplitude=4, frequencies=(frequency,), base=base).periods(TS)
    line, samples = int(period.lines[0]), period.waveform.size
    assert line % 2 == 0
    assert line / (samples * TS) == pytest.approx(frequency, rel=1e-3)
    assert others(period).max() < 1e-12
    moved = np.abs(np.fft.rfft(period.reference)) * 2 / samples
    assert moved[2::2].max() < 1e-12 * moved[1]
    assert np.abs(velocity(period)).max() == pytest.approx(0.05, rel=1e-3)


def test_between_reversals_the_moving_table_shows_its_plant_with_viscous_friction_alone():
    excitation = MovingSine(amplitude=12, frequencies=FREQUENCIES, reversal_settling_time=1.0)
    signals = signals_of(excitation, resolution=0.0)
    found = np.array([response_between_reversals(segment, excitation) for segment in signals.segments])
    omega = 2 * np.pi * np.array([segment.frequency[0] for segment in signals.segments])
    path = path_response(omega, 2 * TS, ()) * hold_response(omega, TS) * image_factor(omega, TS, 2 * TS, (), 2)
    plant = TABLE.response(omega)
    error = decibel(found / path / (plant / (1 + 4.69j * omega * plant)))
    assert np.abs(error).max() < 0.002  # the first mode decays by exp(-9.7) in a second


def response_between_reversals(segment: Segment, excitation: MovingSine) -> complex:
    """Return y/u over whole cycles between settling and reversal; both halves of a period added."""
    half = segment.samples // 2
    begin = int(np.argmin(segment.channels["reference"][0]))
    corner = excitation.velocity / excitation.acceleration
    first, last = int((corner + excitation.reversal_settling_time) / TS) + 1, half - int(corner / TS) - 1
    turn = 2 * np.pi * segment.lines[0] * np.arange(half) / segment.samples
    columns = np.stack([np.cos(turn), np.sin(turn), np.ones(half)], axis=1)[first:last]
    phasors = []
    for channel in ("y", "u"):
        wave = np.roll(segment.channels[channel].mean(axis=0), -begin)
        cosine, sine, _ = np.linalg.lstsq(columns, (wave[:half] + wave[half:])[first:last])[0]
        phasors.append(cosine - 1j * sine)
    return phasors[0] / phasors[1]


@pytest.mark.parametrize(
    ("excitation", "names"),
    [
        (SteppedSine(amplitude=1, min_frequency=1e-4), ["2e+07 samples", "0.0001 Hz"]),
        (MovingSine(amplitude=1, min_frequency=2e-3), ["2e+03 s", "0.0005 s"]),
    ],
)
def test_impossible_grids_are_refused_in_one_line(excitation, names):
    with refused(ParameterError, excitation.name, *names):
        excitation.check(TS)
