"""Motions from target to target: what the feedforward does alone, with friction, limits and wrong models."""

import tomllib

import numpy as np
import pytest
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.plants.modal import Modal
from fraexp_plugins.positioning._shared.motion_profiles import s_curve, s_curve_velocity
from fraexp_plugins.positioning.point_to_point import PointToPoint
from fraexp_plugins.positioning.positioning_metrics import PositioningMetrics
from pytest import approx

from fraexp.components.kinds import Plant
from fraexp.components.ports import StateSpace
from fraexp.components.registry import discover
from fraexp.data.results import Outcome
from fraexp.errors import ParameterError
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from fraexp.study.study_file import packaged_studies
from tests.machines import FRICTIONLESS, LEAD, TABLE, guide
from tests.refusals import refused

SAMPLE_TIME_S, STEP = 500e-6, 1.5e-3
BODY = Modal(rigid_body_gain=0.132)
GUIDE = guide()


def moved(plant=TABLE, friction=GUIDE, loop=None, design=None, compensated=None, **given):
    """Return the signals of a machine; the feedforward is designed on it, or on other models."""
    path = {"input_dead_time": 1e-3} if loop is None else loop
    machine = Machine(plant, friction, LEAD, ControlLoop(sample_time=SAMPLE_TIME_S, **path), Numerics())
    delays = {name: value for name, value in path.items() if name not in ("resolution", "divergence_limit")}
    excitation = PointToPoint(plant=design or plant, friction=compensated or friction, **delays, **given)
    return simulate_loop(machine, excitation, lambda _: None)


def channel(signals, name):
    return signals.segments[0].channels[name].ravel()


def metrics(signals, **given):
    return {metric.name: metric.value for metric in PositioningMetrics(**given).estimate(signals).metrics}


PATHS = [
    {},
    {"input_dead_time": 1e-3},
    {"input_dead_time": 0.83e-3, "output_dead_time": 0.31e-3},
    {"input_time_constants": (1e-3,), "output_dead_time": 0.2e-3, "output_time_constants": (0.6e-3, 0.3e-3)},
]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("cost", ["energy", "jerk", "snap"])
def test_without_friction_the_feedback_has_nothing_to_do(path, cost):
    signals = moved(friction=FRICTIONLESS, loop=path, cost=cost)
    assert np.abs(channel(signals, "y") - channel(signals, "reference")).max() < 1e-12
    assert np.abs(channel(signals, "u") - channel(signals, "excitation")).max() < 1e-6  # N


def test_viscous_friction_is_compensated_too():
    """What is left is its change within a sample, of which the thrust is the average."""
    friction = Frictionless(viscous_coefficient=4.69)
    error = [
        np.abs(channel(signals, "y") - channel(signals, "reference")).max()
        for signals in (moved(friction=friction), moved(friction=friction, compensated=FRICTIONLESS))
    ]
    assert error[0] < 5e-8
    assert error[1] > 100 * error[0]


def test_with_the_right_models_rolling_friction_is_not_noticed():
    signals = moved(dwell_time=0.3)
    assert np.abs(channel(signals, "y") - channel(signals, "reference")).max() < 0.2e-6
    found = metrics(signals)
    assert found["overshoot"] < 0.2e-6
    assert found["departures"] == 0
    assert found["settling time"] == found["first entry"] < 0.04
    assert channel(signals, "excitation")[-1] == pytest.approx(17.9, abs=0.01)  # the guide pushes back


def test_to_and_fro():
    signals = moved(targets=(STEP, 0.0, 0.5e-3, -1e-3), dwell_time=0.1)
    reference = channel(signals, "reference")
    ends = reference[np.cumsum([280] * 4) - 1]
    assert np.abs(ends - [STEP, 0.0, 0.5e-3, -1e-3]).max() < 1e-12
    assert np.abs(channel(signals, "y") - reference).max() < 0.3e-6
    found = metrics(signals)
    assert found["departures"] == 0
    assert found["settling time"] < 0.042


@pytest.mark.parametrize("limit", [60.0, 45.0])
def test_the_force_limit_holds_for_thrust_and_friction_together(limit):
    signals = moved(force_limit=limit)
    assert np.abs(channel(moved(), "excitation")).max() > limit
    assert np.abs(channel(signals, "excitation")).max() <= limit
    assert np.abs(channel(signals, "y") - channel(signals, "reference")).max() < 0.2e-6


def test_what_a_study_does_not_give_is_that_of_its_machine():
    sections = tomllib.loads((packaged_studies() / "machines" / "linear_motor_table.toml").read_text())
    motion = discover().create("excitation", {"name": "point_to_point"}, sections)
    assert motion.input_dead_time == 1e-3
    assert motion.plant.rigid_body_gain == 0.132
    assert motion.friction.viscous == 4.69


def test_a_move_that_is_too_short_for_the_limit_is_refused_with_the_least_number_of_samples():
    given = {"plant": TABLE, "friction": GUIDE, "force_limit": 35.0, "input_dead_time": 1e-3}
    with refused(ParameterError, "80 samples", "force_limit 35 N") as error:
        PointToPoint(**given).check(SAMPLE_TIME_S)
    least = int(str(error.value).split("expected ")[1].split()[0])
    PointToPoint(duration=least * SAMPLE_TIME_S, **given).check(SAMPLE_TIME_S)
    with refused(ParameterError, f"expected {least} samples"):
        PointToPoint(duration=(least - 1) * SAMPLE_TIME_S, **given).check(SAMPLE_TIME_S)


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ({"duration": 1e-3}, ["2 samples", "6 states", "6 samples"]),
        ({"force_limit": 10.0}, ["force_limit 10 N", "17.9 N"]),
        ({"duration": 2.0, "force_limit": 17.91, "targets": (0.5,)}, ["4,000 samples", "force_limit"]),
        ({"dwell_time": 1000.0, "targets": (1e-3, 2e-3)}, ["4,000,160 samples", "250,000", "'dwell_time'"]),
        ({"targets": (1e-3, 1e-3)}, ["targets"]),
        ({"duration": 4e-3}, ["8 samples", "0.004 s", "4.14e+07 N", "9e+06 m/s²", "force_limit"]),
    ],
)
def test_what_cannot_be_planned_is_refused_in_one_line(given, names):
    with refused(ParameterError, *names):
        PointToPoint(**{"plant": TABLE, "friction": GUIDE, **given}).check(SAMPLE_TIME_S)


def test_a_thrust_that_the_user_states_is_believed_and_so_is_an_axis_at_40_g():
    with refused(ParameterError, "1000 m/s²"):
        PointToPoint(plant=TABLE, duration=6e-3).check(SAMPLE_TIME_S)
    PointToPoint(plant=TABLE, duration=6e-3, force_limit=1e8).check(SAMPLE_TIME_S)
    fast = PointToPoint(plant=BODY, duration=6e-3, targets=(3e-3,)).plan(SAMPLE_TIME_S)
    assert fast.max_acceleration == pytest.approx(0.132 * np.abs(fast.thrust).max(), rel=1e-6)
    assert 400 < fast.max_acceleration < 440


@pytest.mark.parametrize(
    ("targets", "named", "remedy"),
    [((0.15,), "end of the move", "shorten the move"), ((0.09,), "length of the move", "correct the design model")],
)
def test_a_move_that_leaves_the_stroke_says_so_in_words_of_moves(targets, named, remedy):
    wrong = TABLE.model_copy(update={"rigid_body_gain": 0.066})  # twice the thrust
    signals = moved(loop={"divergence_limit": 0.1}, design=wrong, friction=FRICTIONLESS, targets=targets, duration=0.05)
    assert signals.outcome is Outcome.DIVERGED
    (found,) = signals.findings
    assert (found.kind, found.quantities[1].name, found.quantities[1].value) == ("diverged", named, approx(targets[0]))
    assert remedy in found.remedy
    assert "the amplitude, or the distance" in signals.outcome.value


class Unstable(Plant):
    """A pendulum that stands on its head."""

    def state_space(self):
        return StateSpace(np.array([[0, 1.0], [30.0, 0]]), np.array([0, 0.1]), np.array([1.0, 0]))

    def response(self, omega):
        return 0.1 / (-(omega**2) - 30.0)


def test_an_unstable_design_model_is_refused():
    with refused(ParameterError, "point_to_point", "unstable"):
        PointToPoint(plant=Unstable()).check(SAMPLE_TIME_S)


def test_a_wrong_design_model_overshoots_and_more_so_the_more_it_is_wrong():
    scale = {"input_dead_time": 1e-3, "resolution": 1e-7}
    overshoots = []
    for gain, frequency in ((0.132, 38.8), (0.135, 38.8), (0.177, 38.8), (0.177, 41.9)):
        wrong = TABLE.model_copy(update={"rigid_body_gain": gain, "frequencies": (frequency, 80.0)})
        overshoots.append(metrics(moved(loop=scale, design=wrong, dwell_time=0.3))["overshoot"])
    assert overshoots[0] < 0.3e-6
    assert overshoots == sorted(overshoots)
    assert overshoots[-1] > 50e-6


def test_the_rigid_body_profile_leaves_the_modes_to_ring():
    quiet, ringing = (moved(friction=FRICTIONLESS, profile=name) for name in ("deadbeat", "jerk_limited"))
    assert metrics(quiet)["residual vibration"] < 1e-9
    assert metrics(ringing)["residual vibration"] > 20e-6
    assert metrics(ringing)["departures"] > 1
    assert 30 < metrics(ringing)["vibration frequency"] < 45
    exact = moved(plant=BODY, friction=FRICTIONLESS, profile="jerk_limited")
    # held over a sample the thrust's mean is right, its course is not: jerk Ts³/12 each sample, in each quarter
    error = 32 * STEP / 0.04**3 * SAMPLE_TIME_S**3 / 12 * 20
    assert np.abs(channel(exact, "y") - channel(exact, "reference")).max() < 1.5 * error


def test_the_rigid_body_profile_wants_a_rigid_body_and_keeps_the_limit():
    class Spring(Unstable):
        def state_space(self):
            return StateSpace(np.array([[0, 1.0], [-30.0, -1.0]]), np.array([0, 0.1]), np.array([1.0, 0]))

        def response(self, omega):
            return 0.1 / (30.0 - omega**2 + 1j * omega)

    with refused(ParameterError, "deadbeat"):
        PointToPoint(plant=Spring(), profile="jerk_limited").check(SAMPLE_TIME_S)
    with refused(ParameterError, "force_limit 40 N"):
        PointToPoint(plant=BODY, profile="jerk_limited", force_limit=40.0).check(SAMPLE_TIME_S)


def test_the_s_curve_goes_from_0_to_1_with_a_jerk_of_constant_magnitude():
    time = np.linspace(0, 1, 1001)
    assert s_curve(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])) == pytest.approx([0, 0, 0.5, 1, 1])
    assert np.abs(np.gradient(s_curve(time), time)[1:-1] - s_curve_velocity(time)[1:-1]).max() < 1e-4
    jerk = np.diff(s_curve(time), 3) / 1e-9  # over three intervals from its index on
    for begin, end, expected in ((0, 247, 32), (250, 747, -32), (750, 998, 32)):
        assert jerk[begin:end] == pytest.approx(expected, rel=1e-3)


def test_its_lines_carry_its_energy():
    (period,) = PointToPoint(plant=TABLE, friction=GUIDE).periods(SAMPLE_TIME_S)
    energy = np.abs(np.fft.rfft(period.waveform)) ** 2
    assert energy[period.lines].sum() / energy[1:].sum() >= 0.99
    assert energy[period.lines].min() > 0
