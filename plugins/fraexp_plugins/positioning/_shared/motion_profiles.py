"""Profiles: how the design model is moved from one target to the next."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, ParameterError, Plant
from fraexp_plugins.positioning._shared.design_model import DesignModel, Trajectory

MAX_BOUNDED_SAMPLES = 2000
"""Samples of a move whose bounds bind: that program is dense."""
MAX_CONDITION = 1e13
"""Condition number of the states' equations up to which one thrust controls all of them."""
INFEASIBLE_RESIDUAL = 1e-7
"""Residual of the dual problem, relative to 1, below which no thrust keeps its bounds."""
BOUND_TOLERANCE = 1e-9
"""Relative distance at which a bound counts as kept."""


@dataclass(frozen=True)
class DeadbeatProgram:
    """The least |Δ^order u|² of u over N samples with W u = goal, u = 0 before and `rest` after it.

    W holds the columns A^(N-1) b … b of the n states that must come to rest. All such u, and they alone, are D(z) v of
    the coprime factors N(z)/D(z) of the model: u = D v and y = N v for one finite v, whose increments sum to
    (distance)/N(1).
    """

    directions: NDArray[np.float64]
    """Orthonormal directions in which u changes the final state, shape (N, n)."""
    goal: NDArray[np.float64]
    """Component of u along each of them [N], shape (n,)."""
    order: int
    """Order of the differences."""
    difference_targets: NDArray[np.float64]
    """Target of the differences of u, so that u begins at 0 and continues as `rest` [N], shape (N + order,)."""

    @classmethod
    def from_model(
        cls,
        transition: NDArray[np.float64],
        hold_response: NDArray[np.float64],
        goal: NDArray[np.float64],
        rest: float,
        samples: int,
        order: int,
    ) -> "DeadbeatProgram":
        """Return the program of a sampled model x' = A x + b u.

        Args:
            transition: A, shape (n, n).
            hold_response: b, the response to a thrust held over one sample, shape (n,).
            goal: State to be reached, shape (n,).
            rest: Thrust that follows the move [N].
            samples: Samples N of the move.
            order: Order of the differences of u that are made small.

        Raises
        ------
            ParameterError: If one thrust cannot bring all states to rest.
        """
        reach = np.empty((goal.size, samples))
        column = hold_response
        for k in range(samples - 1, -1, -1):
            reach[:, k] = column
            column = transition @ column
        scale = 1 / np.maximum(np.abs(reach).max(axis=1), np.finfo(float).tiny)
        directions, triangle = np.linalg.qr((scale[:, None] * reach).T)
        if np.linalg.cond(triangle) > MAX_CONDITION:
            raise ParameterError(
                f"the design model's {goal.size} states cannot be brought to rest by one thrust in {samples} samples: "
                "expected modes of different frequencies, or a longer duration"
            )
        return cls(
            directions, np.linalg.solve(triangle.T, scale * goal), order, _target_differences(rest, samples, order)
        )

    def solve(
        self, lower: NDArray[np.float64] | None = None, upper: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64] | None:
        """Return the best u [N], shape (N,), within its bounds [N], each of shape (N,); None if there is none."""
        u = self._smoothest
        if lower is None or upper is None or _keeps_bounds(u, lower, upper):
            return u
        if u.size == self.goal.size:
            return None
        if u.size > MAX_BOUNDED_SAMPLES:
            raise ParameterError(
                f"a move of {u.size:,} samples cannot be planned for a force_limit that binds; expected "
                f"{MAX_BOUNDED_SAMPLES:,} or fewer: raise force_limit, or make several moves"
            )
        both_bounds = np.concatenate([lower - u, u - upper])
        step = _solve_least_distance(np.vstack([self._free_directions, -self._free_directions]), both_bounds)
        return None if step is None else self._projected(u + self._free_directions @ step)

    @cached_property
    def _smoothest(self) -> NDArray[np.float64]:
        """The best u without bounds [N], shape (N,): by its multipliers, as the matrix of the cost is a narrow band."""
        from scipy.linalg import solveh_banded  # scipy: imported only where something is designed

        binomials = _binomials(self.order)
        band = np.zeros((self.order + 1, self.directions.shape[0]))
        for k in range(self.order + 1):
            band[self.order - k, k:] = np.dot(binomials[: binomials.size - k], binomials[k:])
        linear = np.correlate(self.difference_targets, binomials, "valid")
        solutions = solveh_banded(band, np.column_stack([linear, self.directions]))
        free, responses = solutions[:, 0], solutions[:, 1:]
        multipliers = np.linalg.solve(self.directions.T @ responses, self.goal - self.directions.T @ free)
        return self._projected(free + responses @ multipliers)

    @cached_property
    def _free_directions(self) -> NDArray[np.float64]:
        """Directions that keep the final state, shape (N, N - n); along them the cost rises by the distance squared."""
        n = self.goal.size
        null = np.linalg.qr(self.directions, mode="complete")[0][:, n:]
        differences = np.diff(np.pad(null, ((self.order, self.order), (0, 0))), self.order, axis=0)
        triangle = np.linalg.qr(differences).R
        return np.linalg.solve(triangle.T, null.T).T

    def _projected(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the nearest u that leads to the goal: it removes the error of rounding."""
        return u + self.directions @ (self.goal - self.directions.T @ u)


def _binomials(order: int) -> NDArray[np.float64]:
    """Return the coefficients of a difference, from the newest sample on."""
    return np.array([(-1.0) ** shift * comb(order, shift) for shift in range(order + 1)])


def _target_differences(rest: float, samples: int, order: int) -> NDArray[np.float64]:
    """Return what the differences of u are compared with, shape (samples + order,): `rest` follows u."""
    return np.concatenate([np.zeros(samples), -rest * np.cumsum(_binomials(order))[:order]])


def _keeps_bounds(u: NDArray[np.float64], lower: NDArray[np.float64], upper: NDArray[np.float64]) -> bool:
    slack = BOUND_TOLERANCE * float(np.abs(u).max())
    return bool((u >= lower - slack).all() and (u <= upper + slack).all())


def _solve_least_distance(matrix: NDArray[np.float64], bound: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the shortest x with matrix x >= bound, or None if there is none.

    Least distance programming by non-negative least squares (C. L. Lawson and R. J. Hanson, Solving Least Squares
    Problems, 1974, section 23.4).
    """
    from scipy.optimize import nnls  # scipy: imported only where something is designed

    scale = float(np.abs(bound).max())
    system = np.vstack([matrix.T, bound / scale])
    unit = np.zeros(system.shape[0])
    unit[-1] = 1.0
    try:
        multipliers, distance = nnls(system, unit, maxiter=20 * system.shape[1])
    except RuntimeError:  # the solver did not converge: whether an x exists is unknown
        return None
    if distance < INFEASIBLE_RESIDUAL:
        return None
    residual = system @ multipliers - unit
    return -scale * residual[:-1] / residual[-1]


POINTS_PER_SAMPLE = 10
"""Points at which the friction model is driven."""
MAX_ITERATIONS = 10
"""Iterations in which friction and the thrust that leaves room for it are computed."""
FORCE_RESERVE = 1e-3
"""Fraction of the force limit that is kept in reserve: friction differs a little between iterations."""
MAX_MOVE_SAMPLES = 100_000
"""Samples of a move."""
MAX_ACCELERATION_M_S2 = 1000.0
"""Acceleration up to which a move without a force limit is plausible: about 100 g, which the fastest axes on guides
reach, those of wire bonders. No real axis follows far beyond it, so that a linear model would be meaningless."""


@dataclass(frozen=True)
class MotionPlan:
    """A motion planned in advance, sample by sample."""

    thrust: NDArray[np.float64]
    """Thrust that moves the design model [N], shape (n,)."""
    friction: NDArray[np.float64]
    """Additional thrust that compensates friction [N], shape (n,)."""
    reference: NDArray[np.float64]
    """Position that is measured if the model is right [m], shape (n,)."""
    max_acceleration: float
    """Maximum acceleration of the design model [m/s²]."""
    displacement: NDArray[np.float64]
    """Displacement of the design model at the points of all samples and at the end [m]."""


@dataclass(frozen=True)
class MotionTask(ABC):
    """A motion to be planned; a subclass, the profile, says how the design model moves."""

    model: DesignModel
    friction: FrictionModel | None
    distances: Sequence[float]
    """From one target to the next [m]."""
    move_samples: int
    """Samples of each move."""
    rest_samples: int
    """Samples after each move."""
    force_limit: float | None
    """Maximum thrust, friction included [N]; None for no limit."""

    @property
    @abstractmethod
    def min_samples(self) -> int:
        """Minimum number of samples of a move, whatever the thrust."""

    @abstractmethod
    def thrust(self, friction: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the thrust that moves the model [N], shape (n,), with room for friction [N], shape (n,).

        None if it cannot keep the limit.
        """

    @abstractmethod
    def trajectory(self, thrust: NDArray[np.float64]) -> Trajectory:
        """Return where the thrust [N] takes the model, with `POINTS_PER_SAMPLE`."""

    def plan(self) -> MotionPlan | None:
        """Return the plan, or None if the limit cannot be kept in so many samples."""
        friction = np.zeros(len(self.distances) * (self.move_samples + self.rest_samples))
        for _ in range(MAX_ITERATIONS):
            thrust = self.thrust(friction)
            if thrust is None:
                return None
            trajectory = self.trajectory(thrust)
            friction = self._friction_force(trajectory.displacement)
            if self.force_limit is None or np.abs(thrust + friction).max() <= self.force_limit:
                acceleration = self._max_acceleration(trajectory.displacement)
                return MotionPlan(thrust, friction, trajectory.measured, acceleration, trajectory.displacement)
        return None

    def _max_acceleration(self, displacement: NDArray[np.float64]) -> float:
        """Return the maximum acceleration of a displacement [m/s²]."""
        return float(np.abs(np.diff(displacement, 2)).max()) / (self.model.sample_time / POINTS_PER_SAMPLE) ** 2

    def _friction_force(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the model's friction force in each sample [N], averaged: the thrust is held meanwhile."""
        samples = (displacement.size - 1) // POINTS_PER_SAMPLE
        if self.friction is None:
            return np.zeros(samples)
        sample_time = self.model.sample_time
        force = self.friction.force(displacement, sample_time / POINTS_PER_SAMPLE)
        between = (force[1:] + force[:-1]) / 2
        velocity = np.diff(displacement[::POINTS_PER_SAMPLE]) / sample_time
        return between.reshape(samples, POINTS_PER_SAMPLE).mean(axis=1) + self.friction.viscous * velocity


def plan_motion(task: MotionTask) -> MotionPlan:
    """Return the plan of a motion; ParameterError states the minimum number of samples if it is not feasible."""
    if task.move_samples < task.min_samples:
        reason = f"{task.model.driven_states} states do not come to rest in fewer than {task.min_samples}"
        raise ParameterError(_too_short_text(task, reason, task.min_samples))
    if task.move_samples > MAX_MOVE_SAMPLES:
        raise ParameterError(
            f"a move of {task.move_samples:,} samples is too long to be planned; expected {MAX_MOVE_SAMPLES:,} or "
            "fewer: shorten 'duration', or make several moves"
        )
    plan = task.plan()
    if plan is not None:
        _check_plausible(task, plan)
        return plan
    holding = _holding_force(task)
    if task.force_limit is not None and holding > task.force_limit * (1 - FORCE_RESERVE):
        raise ParameterError(
            f"force_limit {task.force_limit:g} N is not above the {holding:.4g} N that rest at the targets needs; "
            "raise it"
        )
    needed = _min_feasible_samples(task)
    if needed is None:
        raise ParameterError(
            f"force_limit {task.force_limit:g} N is too low for a move of "
            f"{max(MAX_BOUNDED_SAMPLES, task.move_samples):,} samples; raise it"
        )
    raise ParameterError(_too_short_text(task, f"the thrust would exceed force_limit {task.force_limit:g} N", needed))


def _check_plausible(task: MotionTask, plan: MotionPlan) -> None:
    """Raise ParameterError for a thrust that no machine has, unless the user gives a force limit."""
    if task.force_limit is None and plan.max_acceleration > MAX_ACCELERATION_M_S2:
        peak = float(np.abs(plan.thrust + plan.friction).max())
        duration = task.move_samples * task.model.sample_time
        raise ParameterError(
            f"a move of {task.move_samples} samples ({duration:g} s) needs {peak:.3g} N and "
            f"{plan.max_acceleration:.3g} m/s²; beyond {MAX_ACCELERATION_M_S2:g} m/s² the linear model of "
            "an axis is not plausible: lengthen 'duration', or give force_limit, the maximum thrust of the machine"
        )


def _holding_force(task: MotionTask) -> float:
    """Return the maximum thrust that rest at a target needs [N]: that of springs, and of friction after the move."""
    plan = replace(task, force_limit=None).plan()
    if plan is None:
        return 0.0
    moves = (plan.thrust + plan.friction).reshape(len(task.distances), task.move_samples + task.rest_samples)
    return float(np.abs(moves[:, task.move_samples :]).max())


def _min_feasible_samples(task: MotionTask) -> int | None:
    """Return the minimum number of samples that keeps the limit, or None if `MAX_BOUNDED_SAMPLES` are not enough."""
    low = high = task.move_samples
    while replace(task, move_samples=high).plan() is None:
        if high >= MAX_BOUNDED_SAMPLES:
            return None
        low, high = high, min(2 * high, MAX_BOUNDED_SAMPLES)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if replace(task, move_samples=middle).plan() is None else (low, middle)
    return high


def _too_short_text(task: MotionTask, reason: str, needed: int) -> str:
    sample_time = task.model.sample_time
    return (
        f"a move of {task.move_samples} samples ({task.move_samples * sample_time:g} s) is too short: {reason}; "
        f"expected {needed} samples ({needed * sample_time:g} s) or more"
    )


Profile = Callable[[NDArray[np.float64]], NDArray[np.float64]]
LOW_OMEGA_RAD_S = 1e-3
"""Angular frequency at which a plant with a free rigid body behaves like that body alone."""
RIGID_BODY_TOLERANCE = 1e-3
"""Relative change of ω² P from that frequency to twice as much, up to which the plant is a rigid body there."""


@dataclass(frozen=True)
class DeadbeatTask(MotionTask):
    """All states of the design model come to rest with the move: see `DeadbeatProgram`."""

    order: int
    """Order of the differences of the thrust that are made small."""

    @property
    def min_samples(self) -> int:
        return self.model.driven_states

    def thrust(self, friction: NDArray[np.float64]) -> NDArray[np.float64] | None:
        begin, parts = 0.0, []
        for number, distance in enumerate(self.distances):
            first = number * (self.move_samples + self.rest_samples)
            held = self.model.at_rest(begin)[1] + friction[first : first + self.move_samples]
            limit = None if self.force_limit is None else self.force_limit * (1 - FORCE_RESERVE)
            bounds = () if limit is None else (-limit - held, limit - held)
            solution = self._programs[distance].solve(*bounds)
            if solution is None:
                return None
            parts.append(self.model.at_rest(begin)[1] + solution)
            begin += distance
            parts.append(np.full(self.rest_samples, self.model.at_rest(begin)[1]))
        return np.concatenate(parts)

    @cached_property
    def _programs(self) -> dict[float, DeadbeatProgram]:
        """Program of each distance [m]; the start does not matter, as the model is linear."""
        driven = self.model.driven_states
        state_part, thrust_part = self.model.transition(self.model.sample_time)
        programs = {}
        for distance in set(self.distances):
            state, rest = self.model.at_rest(distance)
            programs[distance] = DeadbeatProgram.from_model(
                state_part[:driven, :driven], thrust_part[:driven], state[:driven], rest, self.move_samples, self.order
            )
        return programs

    def trajectory(self, thrust: NDArray[np.float64]) -> Trajectory:
        return self.model.simulate(thrust, self.model.at_rest(0.0)[0], POINTS_PER_SAMPLE)


@dataclass(frozen=True)
class JerkLimitedTask(MotionTask):
    """Constant jerk in quarters of the move, +, -, -, +, with the thrust of the rigid body alone.

    The acceleration feedforward of most drives (P. Lambrechts, M. Boerlage and M. Steinbuch, Control Engineering
    Practice 13(2), 2005, doi:10.1016/j.conengprac.2004.02.010): the modes are left to ring. Lags count as dead time.
    """

    rigid_body_gain: float
    """Gain of the rigid body [m/(N s²)]."""

    @property
    def min_samples(self) -> int:
        return 4

    def thrust(self, friction: NDArray[np.float64]) -> NDArray[np.float64] | None:
        sample_time = self.model.sample_time
        samples = len(self.distances) * (self.move_samples + self.rest_samples)
        velocity = self._superposition(s_curve_velocity, np.arange(samples + 1.0)) / (self.move_samples * sample_time)
        return np.diff(velocity) / (self.rigid_body_gain * sample_time)

    def trajectory(self, thrust: NDArray[np.float64]) -> Trajectory:
        fine = np.arange(thrust.size * POINTS_PER_SAMPLE + 1, dtype=np.float64) / POINTS_PER_SAMPLE
        delayed = np.arange(thrust.size, dtype=np.float64) - self.model.delay / self.model.sample_time
        return Trajectory(self._superposition(s_curve, fine), self._superposition(s_curve, delayed))

    def _superposition(self, profile: Profile, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sum of the moves' profiles, each times its distance [m], at times [samples]."""
        spacing = self.move_samples + self.rest_samples
        moves = [d * profile((times - number * spacing) / self.move_samples) for number, d in enumerate(self.distances)]
        return np.sum(moves, axis=0)


def s_curve(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a motion from 0 to 1 in the time from 0 to 1, with a jerk of 32, -32, -32 and 32 in its quarters."""
    t = np.clip(time, 0.0, 1.0)
    return 16 / 3 * (t**3 - 2 * np.maximum(t - 0.25, 0) ** 3 + 2 * np.maximum(t - 0.75, 0) ** 3)


def s_curve_velocity(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivative of `s_curve`."""
    t = np.clip(time, 0.0, 1.0)
    return 16 * (t**2 - 2 * np.maximum(t - 0.25, 0) ** 2 + 2 * np.maximum(t - 0.75, 0) ** 2)


def rigid_body_gain(plant: Plant) -> float:
    """Return lim s² P(s) [m/(N s²)]; ParameterError if the plant is not a free rigid body at low frequencies."""
    omega = LOW_OMEGA_RAD_S * np.array([1.0, 2.0])
    gains = np.real(-(omega**2) * plant.response(omega))
    if not gains[0] > 0 or abs(gains[1] / gains[0] - 1) > RIGID_BODY_TOLERANCE:
        raise ParameterError("the profile jerk_limited needs a design model with a free rigid body; take deadbeat")
    return float(gains[0])
