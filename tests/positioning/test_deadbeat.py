"""The deadbeat program and the design model: finite settling, optimality, bounds, and timing between samples."""

import itertools

import control
import numpy as np
import pytest
from fraexp_plugins.plants.modal import Modal
from fraexp_plugins.positioning._shared.design_model import DesignModel
from fraexp_plugins.positioning._shared.motion_profiles import DeadbeatProgram
from scipy.optimize import minimize

from fraexp.components.ports import StateSpace
from fraexp.errors import ParameterError
from tests.machines import TABLE
from tests.refusals import refused

SAMPLE_TIME_S, STEP = 500e-6, 1.5e-3
BODY = Modal(rigid_body_gain=0.132)


def model_of(plant, dead_time=0.0, input_time_constants=(), output_time_constants=(), sample_time=SAMPLE_TIME_S):
    return DesignModel.from_plant(
        plant.state_space(), sample_time, dead_time, input_time_constants, output_time_constants
    )


def program_of(plant, samples, order=1, input_time_constants=()):
    model = model_of(plant, input_time_constants=input_time_constants)
    state_part, thrust_part = model.transition(SAMPLE_TIME_S)
    state, rest = model.at_rest(STEP)
    return DeadbeatProgram.from_model(state_part, thrust_part, state, rest, samples, order)


@pytest.mark.parametrize(("samples", "order"), list(itertools.product((8, 40, 80, 400), (0, 1, 2))))
def test_the_model_is_at_rest_at_the_target_after_the_last_sample(samples, order):
    thrust = np.append(program_of(TABLE, samples, order).solve(), np.zeros(200))
    found = model_of(TABLE).simulate(thrust, np.zeros(6), 4)
    assert np.abs(found.displacement[4 * samples :] - STEP).max() < 1e-12


def test_thrust_and_trajectory_are_denominator_and_numerator_times_one_finite_sequence():
    """u = D v and y = N v: the thrust is divisible by D(z), and the quotient times N(z) is the trajectory."""
    samples = 40
    thrust = program_of(TABLE, samples).solve()
    model = TABLE.state_space()
    sampled = control.sample_system(control.ss(model.a, model.b[:, None], model.c, 0), SAMPLE_TIME_S, "zoh")
    factors = control.tf(sampled)
    numerator = np.concatenate([np.zeros(7 - factors.num[0][0].size), factors.num[0][0]])
    v = np.zeros(samples + 60)
    for k in range(v.size):  # v = u / D
        past = sum(d * v[k - i] for i, d in enumerate(factors.den[0][0]) if 0 < i <= k)
        v[k] = (thrust[k] if k < samples else 0.0) - past
    end = v[samples - 6]
    assert np.abs(v[samples - 6 :] / end - 1).max() < 1e-4  # constant: the increments of v are finite in number
    trajectory = model_of(TABLE).simulate(np.append(thrust, np.zeros(60)), np.zeros(6), 1).displacement[:-1]
    assert np.abs(np.convolve(numerator, v)[: v.size] - trajectory).max() < 1e-3 * STEP  # D in binary: six poles near 1


@pytest.mark.parametrize("order", [0, 1])
def test_the_smoothest_thrust_of_a_rigid_body_is_that_of_the_calculus_of_variations(order):
    """Least energy: a straight line; least jerk: a parabola of third degree (of a continuous time)."""
    samples = 400
    thrust = program_of(BODY, samples, order).solve()
    time = (np.arange(samples) + 0.5) / samples
    duration = samples * SAMPLE_TIME_S
    shape = 6 * (1 - 2 * time) if order == 0 else 60 * time * (1 - time) * (1 - 2 * time)
    expected = STEP / duration**2 / BODY.rigid_body_gain * shape
    assert np.abs(thrust - expected).max() < 0.02 * np.abs(expected).max()


def test_a_bounded_thrust_is_the_least_one_within_its_bounds():
    samples, bound = 24, 360.0
    program = program_of(BODY, samples)
    free, found = program.solve(), program.solve(np.full(samples, -bound), np.full(samples, bound))
    assert np.abs(free).max() > 1.15 * bound
    assert np.abs(found).max() <= bound * (1 + 1e-9)
    columns = np.array([np.eye(samples)[k] for k in range(samples)])
    state_part, thrust_part = model_of(BODY).transition(SAMPLE_TIME_S)
    reach = np.array([np.linalg.matrix_power(state_part, samples - 1 - k) @ thrust_part for k in range(samples)]).T
    goal = model_of(BODY).at_rest(STEP)[0]
    scale = 1 / np.abs(reach).max(axis=1)
    other = minimize(
        lambda u: np.sum(np.diff(u, prepend=0.0, append=0.0) ** 2) / bound**2,
        np.clip(free, -bound, bound),
        jac=lambda u: -2 * np.diff(np.diff(u, prepend=0.0, append=0.0)) / bound**2,
        bounds=[(-bound, bound)] * samples,
        constraints={
            "type": "eq",
            "fun": lambda u: scale * (reach @ u - goal),
            "jac": lambda u: scale[:, None] * reach,
        },
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-14},
    )
    assert np.abs(columns @ other.x - found).max() < 1e-3 * bound


def test_bounds_that_cannot_be_kept_are_found_out():
    program = program_of(BODY, 24)
    least = 4 * STEP / (24 * SAMPLE_TIME_S) ** 2 / BODY.rigid_body_gain  # bang-bang
    assert program.solve(np.full(24, -0.999 * least), np.full(24, 0.999 * least)) is None
    assert program.solve(np.full(24, -1.001 * least), np.full(24, 1.001 * least)) is not None


def test_modes_that_one_thrust_cannot_tell_apart_are_refused():
    twins = Modal(
        rigid_body_gain=0.1, frequencies=(40.0, 40.0), damping_ratios=(0.05, 0.05), modal_gain_ratios=(0.3, 0.3)
    )
    with pytest.raises(ParameterError):
        program_of(twins, 80)


@pytest.mark.parametrize("dead_time", [0.0, 1e-3, 1.17e-3, 0.2e-3])
def test_the_reference_is_the_displacement_a_dead_time_ago_at_any_fraction(dead_time):
    thrust = program_of(TABLE, 80).solve()
    found = model_of(TABLE, dead_time).simulate(thrust, np.zeros(6), 100)
    times = np.arange(thrust.size) * SAMPLE_TIME_S - dead_time
    fine = np.arange(found.displacement.size) * SAMPLE_TIME_S / 100
    assert np.abs(found.measured - np.interp(times, fine, found.displacement)).max() < 1e-9
    assert not found.measured[times <= 1e-12].any()


def test_lags_before_the_thrust_come_to_rest_too_and_those_of_the_measurement_follow():
    input_time_constants, output_time_constants = (1e-3, 0.4e-3), (0.7e-3,)
    model = model_of(TABLE, 0.3e-3, input_time_constants, output_time_constants)
    state_part, thrust_part = model.transition(SAMPLE_TIME_S)
    driven = model.driven_states
    state, rest = model.at_rest(STEP)
    thrust = DeadbeatProgram.from_model(
        state_part[:driven, :driven], thrust_part[:driven], state[:driven], rest, 80, 1
    ).solve()
    found = model.simulate(np.append(thrust, np.zeros(100)), np.zeros(9), 1)
    assert np.abs(found.displacement[80:] - STEP).max() < 1e-11
    assert abs(found.measured[82] - STEP) > 1e-12
    assert abs(found.measured[-1] - STEP) < 1e-11
    slow = control.tf([1], [output_time_constants[0], 1])
    time = np.arange(found.displacement.size) * SAMPLE_TIME_S
    dense = model.simulate(np.append(thrust, np.zeros(100)), np.zeros(9), 50).displacement
    answer = control.forced_response(slow, np.arange(dense.size) * SAMPLE_TIME_S / 50, dense).outputs
    late = np.interp(time[:-1] - 0.3e-3, np.arange(dense.size) * SAMPLE_TIME_S / 50, answer, left=0.0)
    assert np.abs(found.measured - late).max() < 1e-8


def test_a_spring_holds_the_target_by_a_thrust():
    mass, damping, stiffness = 5.0, 40.0, 2e4
    spring = StateSpace(np.array([[0, 1], [-stiffness / mass, -damping / mass]]), np.array([0, 1 / mass]), np.eye(2)[0])
    model = DesignModel.from_plant(spring, SAMPLE_TIME_S, 0.0)
    state, rest = model.at_rest(STEP)
    assert rest == pytest.approx(stiffness * STEP)
    state_part, thrust_part = model.transition(SAMPLE_TIME_S)
    for order in (0, 1, 2):
        thrust = DeadbeatProgram.from_model(state_part, thrust_part, state, rest, 60, order).solve()
        found = model.simulate(np.append(thrust, np.full(50, rest)), np.zeros(2), 1)
        assert np.abs(found.displacement[60:] - STEP).max() < 1e-12
    assert abs(thrust[-1] - rest) < 0.1 * rest  # where differences are made small, it ends as it goes on


def test_a_model_that_cannot_rest_or_is_unstable_is_refused():
    differentiator = StateSpace(np.array([[-1.0, 0], [0, -2.0]]), np.array([1.0, 1.0]), np.array([1.0, -2.0]))
    with refused(ParameterError, "rest"):
        DesignModel.from_plant(differentiator, SAMPLE_TIME_S, 0.0).at_rest(STEP)
    unstable = StateSpace(np.array([[0, 1.0], [400.0, 0]]), np.array([0, 1.0]), np.array([1.0, 0]))
    with refused(ParameterError, "+20 rad/s"):
        DesignModel.from_plant(unstable, SAMPLE_TIME_S, 0.0)
