"""Driving friction models directly: by studies' excitations, by a measured displacement, and by a holding force."""

import numpy as np
import pytest
from fraexp_plugins.estimators.hysteresis import Hysteresis
from fraexp_plugins.excitations.biased_sine import BiasedSine
from fraexp_plugins.excitations.displacement_sine import DisplacementSine
from fraexp_plugins.excitations.displacement_triangle import DisplacementTriangle
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.rolling import Rolling

from fraexp.components.periods import Period
from fraexp.data.signals import Segment, Signals
from fraexp.errors import ParameterError
from fraexp.simulation.loop import drive_friction, simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.machines import LEAD, TABLE, guide
from tests.refusals import refused

SAMPLE = 5e-4


def metrics(result):
    return {metric.name: metric.value for metric in result.metrics}


@pytest.mark.parametrize("excitation", [DisplacementSine(amplitude=2.0), DisplacementTriangle(amplitude=2.0)])
def test_a_driven_element_shows_its_energy_and_peak(excitation):
    element = Rolling(stiffness=(1.0,), limit_force=(1.0,))
    found = metrics(Hysteresis().estimate(drive_friction(element, excitation, SAMPLE)))
    assert found["energy per cycle"] == pytest.approx(4 * 1.0 * (2.0 - 1.0), rel=1e-4)
    assert found["peak force"] == pytest.approx(1.0, rel=1e-12)
    assert found["displacement amplitude"] == pytest.approx(2.0, rel=1e-9)


def test_viscous_friction_is_part_of_the_loop():
    period: Period = DisplacementTriangle(amplitude=1.0, frequency=1.0).periods(SAMPLE)[0]
    signals = drive_friction(
        Coulomb(coulomb_force=3.0, viscous_coefficient=2.0), DisplacementTriangle(amplitude=1.0), SAMPLE
    )
    force = signals.segments[0].channels["friction"][0]
    assert np.max(np.abs(period.waveform)) == 1.0
    assert np.median(np.abs(force)) == pytest.approx(3.0 + 2.0 * 4.0, rel=1e-2)  # the velocity is 4 A f


def test_a_measured_displacement_is_answered_with_the_models_force():
    y = 30e-6 * np.sin(2 * np.pi * np.arange(1000) / 1000)
    record = Signals((Segment(SAMPLE, {"y": np.tile(y, (2, 1))}, np.array([1])),), {"y": "m"})
    result = Hysteresis(displacement="y", friction=guide()).estimate(record)
    curve = result.curves[0]
    expected = guide().force(y, SAMPLE, periodic=True) + 4.69 * curve.columns["velocity"]
    assert np.allclose(curve.columns["force"], expected, atol=1e-12)
    assert curve.units == {"displacement": "m", "force": "N", "velocity": "m/s"}


def test_too_coarse_sampling_is_refused_with_the_remedy():
    for excitation in (
        DisplacementSine(amplitude=1.0, frequency=500.0),
        BiasedSine(bias=1, amplitude=1, frequency=500),
    ):
        with refused(ParameterError, excitation.name, 4, 16, "500 Hz", "'frequency'", "loop.sample_time"):
            excitation.check(SAMPLE)


def test_a_stiffness_that_no_number_of_steps_follows_is_refused_with_the_remedy():
    absurd = Rolling(stiffness=(1e14,), limit_force=(10.0,))
    machine = Machine(TABLE, absurd, LEAD, ControlLoop(sample_time=SAMPLE), Numerics())
    with refused(ParameterError, "1e+14 N/m", 1000, "max_stiffness", "loop.sample_time"):
        simulate_loop(machine, BiasedSine(bias=1, amplitude=1, frequency=5), lambda _: None)


def test_a_step_that_is_too_long_for_the_friction_is_refused_with_the_number_needed():
    stiff = Rolling(stiffness=(1e9,), limit_force=(10.0,))
    machine = Machine(TABLE, stiff, LEAD, ControlLoop(sample_time=SAMPLE), Numerics(steps_per_sample=2))
    with refused(ParameterError, "numerics.steps_per_sample", 2, "2343 Hz", 8):
        simulate_loop(machine, BiasedSine(bias=1, amplitude=1, frequency=5), lambda _: None)
