"""The moving axis: friction without a reversal is a constant, and its model's errors do not matter."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.estimators.moving_axis import MovingAxis
from fraexp_plugins.excitations.moving_sine import MovingSine

from fraexp.analysis.confidence import circle_factor
from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError
from tests.machines import TABLE, decibel, degrees, excited, guide, simulated
from tests.refusals import refused

DELAYS = {"input_dead_time": 1e-3}
FREQUENCIES = (1.0, 5.0, 12.0, 20.0, 39.0, 80.0)
RUN_IN = 1.0
"""Time until the modes of TABLE have decayed after a reversal [s]."""


def moving(amplitude=4.0, velocity=0.05, viscous=4.69, frequencies=FREQUENCIES, base_period=4.0, **given):
    excitation = MovingSine(
        amplitude=amplitude,
        velocity=velocity,
        frequencies=frequencies,
        reversal_settling_time=RUN_IN,
        base_period=base_period,
        **given,
    )
    return excited(excitation, guide(viscous=viscous))


@pytest.fixture(scope="module")
def signals():
    return moving()


def ratio(result, viscous=0.0):
    """Return what was found over P with viscous friction, which is linear: P/(1 + jω Dv P)."""
    omega = 2 * np.pi * result.response.frequency
    plant = TABLE.response(omega)
    return result.response.response * (1 / plant + 1j * omega * viscous)


def test_what_remains_of_friction_is_its_viscous_part(signals):
    found = MovingAxis(refer_to_plant=True, reversal_settling_time=RUN_IN, **DELAYS).estimate(signals)
    assert np.max(np.abs(decibel(ratio(found, viscous=4.69)))) < 0.003
    assert np.max(np.abs(degrees(ratio(found, viscous=4.69)))) < 0.02
    bare = decibel(ratio(found))
    assert bare[0] == pytest.approx(-0.04, abs=0.005)  # at 1 Hz
    conventional = Conventional(refer_to_plant=True, **DELAYS).estimate(simulated(guide(), FREQUENCIES, 4.0))
    assert np.abs(decibel(ratio(conventional)))[0] > 20


@pytest.mark.parametrize("given", [{"amplitude": 10.0}, {"velocity": 0.1}])
def test_neither_amplitude_nor_velocity_matter(signals, given):
    estimator = MovingAxis(reversal_settling_time=RUN_IN)
    found = [estimator.estimate(each).response.response for each in (signals, moving(**given))]
    assert np.max(np.abs(decibel(found[0] / found[1]))) < 0.003


@pytest.mark.parametrize("error", [{}, {"force_scale": 1.1}, {"force_scale": 0.9}, {"displacement_scale": 1.1}])
def test_with_the_observer_it_is_immune_to_the_errors_of_the_model(signals, error):
    estimator = EffectiveInput(friction=guide(), **DELAYS, method=MovingAxis(reversal_settling_time=RUN_IN), **error)
    found = estimator.estimate(signals)
    assert found.response.input == "u_e"
    assert np.max(np.abs(decibel(ratio(found)))) < 0.003
    assert np.max(np.abs(degrees(ratio(found)))) < 0.02


def test_the_velocity_that_is_left_is_reported(signals):
    metrics = {metric.name: metric for metric in MovingAxis(reversal_settling_time=RUN_IN).estimate(signals).metrics}
    assert 0.03 < metrics["minimum velocity"].value < 0.05
    assert metrics["minimum velocity"].unit == "m/s"
    assert metrics["stretches per frequency"].value == 2
    assert metrics["residual over amplitude"].value < 0.01


def test_a_record_without_its_reference_will_do():
    """Where the base brakes is then not known, and as much is left out before a reversal as after it."""
    signals = moving(base_period=8.0)
    bare = {name: unit for name, unit in signals.units.items() if name in ("u", "y")}
    segments = [replace(s, channels={name: s.channels[name] for name in bare}) for s in signals.segments]
    found = MovingAxis(refer_to_plant=True, reversal_settling_time=RUN_IN, **DELAYS).estimate(
        replace(signals, segments=tuple(segments), units=bare)
    )
    assert np.max(np.abs(decibel(ratio(found, viscous=4.69)))) < 0.003


def ramps(noise, generator, turns=6):
    """Return a base motion of constant velocity to and fro with a sine on it, and the sine that causes it."""
    samples, line = 1000, 40
    time = np.arange(turns * samples)
    base = np.abs((time / samples + 0.3) % 1 - 0.5) * 0.2
    phase = 2 * np.pi * line * time / samples
    u = (3.0 * np.cos(phase)).reshape(turns, samples)
    y = (base + 1e-5 * np.cos(phase - 2.0) + noise * generator.normal(size=time.size)).reshape(turns, samples)
    return Signals((Segment(5e-4, {"u": u, "y": y}, np.array([line])),), {"u": "N", "y": "m"})


@pytest.mark.thorough
def test_the_band_covers_95_percent():
    generator, truth = np.random.default_rng(3), 1e-5 / 3 * np.exp(-2j)
    estimator, runs, inside = MovingAxis(reversal_settling_time=0.02), 1000, 0
    for _ in range(runs):
        found = estimator.estimate(ramps(1e-6, generator)).response
        assert found.freedom[0] == 2 * (11 - 1)  # of twelve stretches the record's ends cut one
        inside += int(abs(found.response[0] - truth) <= found.standard_deviation[0] * circle_factor(found.freedom)[0])
    assert inside / runs == pytest.approx(0.95, abs=0.02)


def test_a_constant_velocity_is_fitted_exactly():
    found = MovingAxis(reversal_settling_time=0.02).estimate(ramps(0.0, np.random.default_rng(0))).response
    assert abs(found.response[0] / (1e-5 / 3 * np.exp(-2j)) - 1) < 1e-9


def test_no_stretch_without_a_reversal_is_refused():
    with refused(RecordError, "moving_axis", "5 Hz", "0.5 s"):
        MovingAxis().estimate(simulated(guide(), (5.0,), 12.0))


def test_a_slow_sine_as_base_is_refused_or_remarked_upon():
    """An offset and a slope do not describe it: with its reference that is known, without it the residual tells."""
    signals = moving(base="sine", frequencies=(80.0,))
    with refused(RecordError, "80 Hz", "1 s"):
        MovingAxis(reversal_settling_time=RUN_IN).estimate(signals)
    found = MovingAxis(reversal_settling_time=0.5, reference_channel="").estimate(signals)
    assert "constant velocity" in found.message
