"""Friction, mass and viscous friction from thrust and scale of a simulated machine."""

import numpy as np
import pytest
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.excitations.constant_velocities import ConstantVelocities
from fraexp_plugins.excitations.slow_triangle import SlowTriangle
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.identification.friction_identification import FrictionIdentification
from fraexp_plugins.plants.modal import Modal

from fraexp.components.periods import Period
from fraexp.data.signals import Segment, Signals
from fraexp.errors import ParameterError, RecordError
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.examples import thorough
from tests.identification.friction_records import sliding, values
from tests.machines import LEAD, TABLE, guide
from tests.responses import judged

STIFF = Pid(proportional=60e3, derivative_time=0.02, filter_time=0.002)
DEAD_TIME = 1e-3


def recorded(excitation, friction, plant=TABLE, controller=LEAD, **loop):
    settings = {"sample_time": 500e-6, "input_dead_time": DEAD_TIME, "resolution": 0.1e-6, **loop}
    machine = Machine(plant, friction, controller, ControlLoop.parse(settings, "loop"), Numerics())
    return simulate_loop(machine, excitation, lambda _: None)


@pytest.fixture(scope="module")
def triangle():
    excitation = SlowTriangle(amplitude=6e-3, velocities=(10e-3, 30e-3), inner_amplitude_ratios=(0.5, 0.2, 0.1, 0.05))
    return recorded(excitation, guide(), noise=30e-9)


def test_thrust_and_scale_give_friction_and_mass(triangle):
    """The mass is 0.6 % too high by the modes at 38.8 and 80 Hz, as the docstring says."""
    estimator = FrictionIdentification(thrust="u", displacement="y", input_dead_time=DEAD_TIME)
    found = values(estimator.estimate(triangle))
    assert found["Coulomb force"] == pytest.approx(17.9, rel=2e-3)
    assert found["mass"] == pytest.approx(1 / 0.132, rel=0.012)
    assert found["viscous coefficient"] == pytest.approx(4.69, abs=2 * found["viscous coefficient, 95 %"])
    assert found["rms error, held-out cycles, over the Coulomb force"] < 1e-3


def test_a_rigid_mass_is_found_with_any_fraction_of_a_dead_time():
    excitation = SlowTriangle(
        amplitude=2e-3, velocities=(20e-3, 40e-3), acceleration=5.0, inner_amplitude_ratios=(0.1,), cycles=2
    )
    rigid = Modal(rigid_body_gain=0.132)
    signals = recorded(excitation, guide(), rigid, STIFF, resolution=0.0, input_dead_time=0.3e-3)
    estimator = FrictionIdentification(thrust="u", displacement="y", input_dead_time=0.3e-3, max_frequency=20.0)
    found = values(estimator.estimate(signals))
    assert found["mass"] == pytest.approx(1 / 0.132, rel=1e-3)
    assert found["Coulomb force"] == pytest.approx(17.9, rel=1e-3)


def measured(signals, every):
    """Return every so manieth sample as a record of which nothing else is known."""
    segments = []
    for segment in signals.segments:
        channels = {name: samples.ravel()[None, ::every].copy() for name, samples in segment.channels.items()}
        segments.append(Segment(every * segment.sample_time, channels, np.array([1])))
    return Signals(tuple(segments), signals.units)


@pytest.mark.parametrize("held", [thorough(True), False])
@pytest.mark.thorough
def test_whether_a_measured_thrust_is_held_is_found(held):
    """A sensor's thrust goes on between samples, as that of a controller eight times as fast does: 3 % of the mass."""
    sample_time, every = (1e-3, 1) if held else (125e-6, 8)
    ideal = {"sample_time": sample_time, "input_dead_time": 0.0}
    rigid, pid = Modal(rigid_body_gain=0.132), Pid(proportional=15e3, derivative_time=0.03, filter_time=0.003)
    excitation = SlowTriangle(
        amplitude=4e-3, velocities=(20e-3, 60e-3), acceleration=5.0, inner_amplitude_ratios=(0.5, 0.1), cycles=3
    )
    record = measured(recorded(excitation, guide(), rigid, pid, **ideal), every)
    result = FrictionIdentification(thrust="u", displacement="y", max_frequency=20.0).estimate(record)
    assert values(result)["mass"] == pytest.approx(1 / 0.132, rel=5e-3)
    assert ("acts at another time" in result.message) is not held
    wrong = FrictionIdentification(thrust="u", displacement="y", max_frequency=20.0, zero_order_hold=not held).estimate(
        record
    )
    assert abs(values(wrong)["mass"] * 0.132 - 1) > 0.015
    assert "held" not in wrong.message

    pid = Pid(proportional=6e3, derivative_time=0.04, filter_time=0.004)
    wide = SlowTriangle(
        amplitude=20e-3, velocities=(50e-3, 150e-3), acceleration=3.0, inner_amplitude_ratios=(0.3,), cycles=4
    )
    slides = recorded(
        wide, Coulomb(coulomb_force=5.0, viscous_coefficient=8.0), Modal(rigid_body_gain=1 / 1.7), pid, **ideal
    )
    assert judged(sliding(), slides).message == ""  # of a simulation it is known
    found = sliding().estimate(measured(slides, every))
    assert values(found)["mass"] == pytest.approx(1.7, rel=2e-3)
    assert ("acts at another time" in found.message) is not held


def test_the_mass_at_one_speed_is_as_uncertain_as_the_reversals():
    """The loop stands still at each reversal, by ways that the scale's noise hides."""
    pid = Pid(proportional=70e3, derivative_time=0.015, filter_time=1e-3)
    excitation = SlowTriangle(
        amplitude=20e-3, velocities=(40e-3,), acceleration=40.0, inner_amplitude_ratios=(), cycles=3
    )
    ideal = {"sample_time": 1e-3, "input_dead_time": 0.0, "resolution": 0.0, "noise": 1e-7}
    signals = recorded(
        excitation, Coulomb(coulomb_force=15.0, viscous_coefficient=30.0), Modal(rigid_body_gain=1 / 8), pid, **ideal
    )
    result = FrictionIdentification(thrust="u", displacement="y").estimate(measured(signals, 1))
    found = values(result)
    assert abs(found["mass"] - 8) < found["mass, 95 %"] < 0.5 * 8
    assert "the mass is identifiable at reversals only" in result.message
    assert "acts at another time" not in result.message


def test_coulomb_friction_mass_viscous_friction_and_offset_come_from_one_record_of_brisk_motion():
    """A mass of 1.7 kg on Coulomb friction of 5 N, with a scale of 1 µm and a thrust that is off by 2 N."""
    rigid, pid = Modal(rigid_body_gain=1 / 1.7), Pid(proportional=6e3, derivative_time=0.04, filter_time=0.004)
    excitation = SlowTriangle(
        amplitude=30e-3, velocities=(0.1, 0.3), acceleration=10.0, inner_amplitude_ratios=(0.3,), cycles=4
    )
    friction = Coulomb(coulomb_force=5.0, viscous_coefficient=20.0)
    loop = {"sample_time": 1e-3, "resolution": 1e-6, "noise": 1e-7, "input_dead_time": 0.0}
    (segment,) = measured(recorded(excitation, friction, rigid, pid, **loop), 1).segments
    channels = {"u": segment.channels["u"] + 2.0, "y": segment.channels["y"]}
    signals = Signals((Segment(segment.sample_time, channels, segment.lines),), {"u": "N", "y": "m"})
    found = values(FrictionIdentification(thrust="u", displacement="y", max_frequency=20.0).estimate(signals))
    assert found["Coulomb force"] == pytest.approx(5.0, rel=0.01)
    assert found["mass"] == pytest.approx(1.7, rel=0.02)
    assert found["viscous coefficient"] == pytest.approx(20.0, rel=0.02)
    assert found["offset"] == pytest.approx(2.0, rel=0.01)


def test_runs_at_constant_velocity_give_the_viscous_coefficient():
    excitation = ConstantVelocities(velocities=(5e-3, 10e-3, 20e-3), travel=20e-3, cycles=2)
    result = judged(sliding(constant_velocity=True), recorded(excitation, guide(), noise=30e-9))
    found = values(result)
    assert not result.message
    assert found["viscous coefficient"] == pytest.approx(4.69, rel=5e-3)
    assert found["Coulomb force"] == pytest.approx(17.9, rel=1e-3)
    assert found["offset"] == pytest.approx(0, abs=0.01)
    assert result.fits[0].component["name"] == "coulomb"


@pytest.mark.thorough
def test_a_stribeck_effect_is_remarked_on():
    friction = Coulomb(coulomb_force=15.0, static_force=18.0, stribeck_velocity=12e-3, viscous_coefficient=400.0)
    excitation = ConstantVelocities(velocities=(5e-3, 10e-3, 20e-3, 30e-3), travel=20e-3, cycles=2)
    message = sliding(constant_velocity=True).estimate(recorded(excitation, friction, resolution=0.0)).message
    assert "friction is not linear in the velocity" in message


def test_one_velocity_alone_is_refused():
    excitation = ConstantVelocities(velocities=(10e-3,), travel=20e-3, cycles=2)
    with pytest.raises(RecordError, match=r"all sliding is at one speed, 0.0\d+ m/s; expected several speeds"):
        sliding(constant_velocity=True).estimate(recorded(excitation, guide()))


@pytest.mark.parametrize(
    "excitation",
    [SlowTriangle(amplitude=1e-3, velocities=(2e-3,)), ConstantVelocities(velocities=(5e-3,))],
    ids=lambda one: one.name,
)
def test_the_reference_keeps_to_velocity_and_acceleration_and_closes(excitation):
    (period,) = excitation.periods(1e-3)
    assert isinstance(period, Period)
    assert not period.waveform.any()
    way = np.tile(period.reference, 2)
    velocity = np.diff(way) / 1e-3
    asked = excitation.velocities[0]
    assert np.abs(velocity).max() == pytest.approx(asked, rel=5e-3)
    assert np.mean(np.abs(np.abs(velocity) / asked - 1) < 1e-2) > 0.9
    assert np.abs(np.diff(velocity)).max() / 1e-3 <= 1.6 * excitation.acceleration


def test_motions_that_cannot_be_made_are_refused():
    with pytest.raises(ParameterError, match=r"travel is 1 mm; at 0.04 m/s"):
        ConstantVelocities.parse({"travel": 1e-3}, "excitation")
    with pytest.raises(ParameterError, match="inner_amplitude_ratios must lie between 0 and 1"):
        SlowTriangle.parse({"amplitude": 1e-3, "inner_amplitude_ratios": [1.5]}, "excitation")
    with pytest.raises(ParameterError, match="raise the velocity, or shorten the travel"):
        SlowTriangle(amplitude=1.0, velocities=(1e-4,)).check(500e-6)
    with pytest.raises(ParameterError, match=r"lower the velocity, or shorten loop.sample_time"):
        SlowTriangle(amplitude=1e-6, velocities=(1.0,)).check(500e-6)
