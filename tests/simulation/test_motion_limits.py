"""What an experiment may ask of a machine."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.excitations.moving_sine import MovingSine
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.positioning.point_to_point import PointToPoint

from fraexp.components.kinds import Excitation
from fraexp.components.periods import Schedule
from fraexp.errors import ParameterError
from fraexp.simulation.experiments import Compensation
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from fraexp.simulation.motion_limits import (
    NOISE_RESERVE,
    MotionLimits,
    check_limits,
    encoder_noise_demand,
    predict_demand,
    predict_demand_from_rest,
)
from tests.machines import FRICTIONLESS, LEAD, TABLE, guide
from tests.refusals import refused


def machine(friction=FRICTIONLESS) -> Machine:
    return Machine(TABLE, friction, LEAD, ControlLoop(sample_time=500e-6, input_dead_time=1e-3), Numerics())


def test_the_prediction_is_what_the_loop_without_friction_does() -> None:
    excitation = SteppedSine(amplitude=12.0, frequencies=(3.0, 38.8, 120.0), settling_tolerance=1e-7)
    signals = simulate_loop(machine(), excitation, lambda _: None)
    for period, segment in zip(excitation.periods(500e-6), signals.segments, strict=True):
        demand = predict_demand(machine(), period)
        place = segment.channels["displacement"][0]
        speed = np.gradient(np.concatenate([place, place, place]), 500e-6)[place.size : 2 * place.size]
        assert demand.stroke == pytest.approx(np.ptp(place), rel=0.02)
        assert demand.velocity == pytest.approx(np.abs(speed).max(), rel=0.03)
        assert demand.force == pytest.approx(max(np.abs(segment.channels["u"]).max(), 12.0), rel=0.01)


def test_noise_of_the_encoder_asks_for_what_it_does_in_the_loop_without_friction() -> None:
    loop = ControlLoop(sample_time=500e-6, input_dead_time=1e-3, noise=1e-7)
    noisy = Machine(TABLE, FRICTIONLESS, LEAD, loop, Numerics())
    excitation = FromRest(amplitude=1e-9, frequencies=(0.25,))
    (segment,) = simulate_loop(noisy, excitation, lambda _: None).segments
    place, force = (segment.channels[name].ravel() for name in ("displacement", "u"))
    speed = np.gradient(place, 500e-6)
    parts = (2 * place, speed, np.diff(place, 2) / 500e-6**2, force, np.diff(force) / 500e-6)
    found = [part.std() for part in parts]
    known = np.array(encoder_noise_demand(noisy)) / NOISE_RESERVE
    assert known[[0, 1, 3, 4]] == pytest.approx(np.array(found)[[0, 1, 3, 4]], rel=0.1)
    assert found[2] < known[2] < 1.3 * found[2]  # a difference over samples is less than what is between them
    assert encoder_noise_demand(machine()) == (0, 0, 0, 0, 0)


@pytest.mark.parametrize("name", ["stroke", "velocity", "force"])
def test_what_exceeds_a_limit_is_refused_with_both_numbers(name: str) -> None:
    excitation = SteppedSine(amplitude=12.0, frequencies=(3.0,))
    least = getattr(predict_demand(machine(guide()), excitation.periods(500e-6)[0]), name)
    check_limits(MotionLimits(**{name: 1.01 * least}), machine(guide()), excitation)
    with refused(ParameterError, "2.999 Hz", name, f"limits.{name}"):
        check_limits(MotionLimits(**{name: 0.5 * least}), machine(guide()), excitation)


class FromRest(SteppedSine):
    """Is recorded from rest."""

    @property
    def schedule(self) -> Schedule:
        return Schedule(settling_timeout=0.0, recorded_periods=3)


WRONG = TABLE.model_copy(update={"rigid_body_gain": 0.177, "frequencies": (41.9, 80.0)})
THERE_AND_BACK = (1.5e-3, 0.5e-3, 3e-3, 0.0)


@pytest.mark.parametrize(
    "excitation",
    [
        PointToPoint(plant=TABLE, input_dead_time=1e-3),
        PointToPoint(plant=WRONG, input_dead_time=1e-3, targets=THERE_AND_BACK, dwell_time=0.05),
        FromRest(amplitude=12.0, frequencies=(20.0,)),
        FromRest(amplitude=12.0, frequencies=(3.0,)),
    ],
)
def test_the_prediction_from_rest_is_what_the_loop_without_friction_does(excitation: Excitation) -> None:
    signals = simulate_loop(machine(), excitation, lambda _: None)
    (period,) = excitation.periods(500e-6)
    demand = predict_demand_from_rest(machine(), period, excitation.schedule.recorded_periods)
    place, control = (signals.segments[0].channels[name].ravel() for name in ("displacement", "u"))
    assert demand.stroke == pytest.approx(np.ptp(place), rel=2e-4)
    assert demand.velocity == pytest.approx(np.abs(np.diff(place)).max() / 500e-6, rel=2e-3)
    added = np.abs(period.waveform).max()
    assert demand.force == pytest.approx(max(np.abs(control).max(), added), rel=1e-5)


def test_a_move_that_exceeds_a_limit_is_refused() -> None:
    move = PointToPoint(plant=TABLE, input_dead_time=1e-3)
    check_limits(MotionLimits(stroke=1.51e-3, velocity=0.06, force=46.0), machine(), move)
    with refused(ParameterError, "point_to_point", "45.75 N", "limits.force", "45 N", "time"):
        check_limits(MotionLimits(stroke=1.51e-3, force=45.0), machine(), move)
    with refused(ParameterError, "0.0015 m", "limits.stroke", "0.0014 m"):
        check_limits(MotionLimits(stroke=1.4e-3), machine(), move)


def test_the_excitation_is_a_channel_in_step_with_the_record() -> None:
    signals = simulate_loop(
        machine(), SteppedSine(amplitude=12.0, frequencies=(7.3, 33.0), ramp=0.0333), lambda _: None
    )
    for segment in signals.segments:
        # u = u_c + u_sin, and u_c is C(z) driven by -y: what is left is the excitation
        u, y, sine = (segment.channels[name][0] for name in ("u", "y", "excitation"))
        numerator, denominator = LEAD.transfer_function(500e-6)
        line, size = int(segment.lines[0]), u.size
        delay = np.exp(-2j * np.pi * line / size)
        controller = np.polynomial.polynomial.polyval(delay, numerator)
        controller /= np.polynomial.polynomial.polyval(delay, denominator)
        bins = np.fft.rfft(u)[line] + controller * np.fft.rfft(y)[line]
        assert bins == pytest.approx(np.fft.rfft(sine)[line], rel=1e-4)


def test_stroke_force_and_time_are_told() -> None:
    excitation = SteppedSine(amplitude=12.0, frequencies=(10.0, 40.0))
    signals = simulate_loop(machine(guide()), excitation, lambda _: None)
    found = {metric.name: metric for metric in signals.metrics}
    y = np.concatenate([segment.channels["displacement"].ravel() for segment in signals.segments])
    assert found["stroke"].value == pytest.approx(np.ptp(y), rel=1e-12)
    assert found["peak force"].value == max(np.abs(segment.channels["u"]).max() for segment in signals.segments)
    times = [segment.settling.time + segment.channels["y"].size * 500e-6 for segment in signals.segments]
    assert found["measuring time"].value == pytest.approx(sum(times), rel=1e-12)


def test_the_transient_is_recorded_where_nothing_is_settled() -> None:
    signals = simulate_loop(machine(), FromRest(amplitude=12.0, frequencies=(20.0,)), lambda _: None)
    segment = signals.segments[0]
    assert segment.channels["y"].shape[0] == 3 and segment.channels["y"][0, 0] == 0.0
    assert np.array_equal(segment.channels["excitation"][0], segment.channels["excitation"][2])


class Aiming(SteppedSine):
    """May ask for another force than its periods have."""

    def max_force_and_stroke(self) -> tuple[float | None, float | None]:
        return 200.0, 40e-6


def test_what_revised_periods_may_ask_for_counts_instead_of_the_first_ones() -> None:
    excitation = Aiming(amplitude=1.0, frequencies=(3.0, 50.0))
    check_limits(MotionLimits(stroke=41e-6, force=201.0), machine(), excitation)
    with refused(ParameterError, "200 N", "limits.force", "199 N"):
        check_limits(MotionLimits(force=199.0), machine(), excitation)
    with refused(ParameterError, "50 Hz", "0.006283 m/s", "limits.velocity", "0.005 m/s"):
        check_limits(MotionLimits(velocity=5e-3), machine(), excitation)


def test_friction_counts_where_the_axis_moves_and_where_it_is_compensated() -> None:
    moving = MovingSine(amplitude=2.0, frequencies=(40.0,), velocity=0.05)
    without = max(predict_demand(machine(), period).force for period in moving.periods(500e-6))
    with refused(ParameterError, "limits.force"):
        check_limits(MotionLimits(force=without + 17), machine(guide()), moving)
    check_limits(MotionLimits(force=without + 18), machine(guide()), moving)

    still = SteppedSine(amplitude=12.0, frequencies=(40.0,))
    compensated = replace(machine(guide()), compensation=Compensation(gain=0.5, friction=guide()))
    least = predict_demand(machine(guide()), still.periods(500e-6)[0]).force
    with refused(ParameterError, "limits.force"):
        check_limits(MotionLimits(force=least + 8.9), compensated, still)
    check_limits(MotionLimits(force=least + 9), compensated, still)


def test_a_planned_move_with_friction_compensation_needs_its_own_stroke() -> None:
    move = PointToPoint(plant=TABLE, friction=guide(), input_dead_time=1e-3)
    check_limits(MotionLimits(stroke=1.51e-3), machine(guide()), move)
    with refused(ParameterError, "limits.stroke", "time"):
        check_limits(MotionLimits(stroke=1.4e-3), machine(guide()), move)
