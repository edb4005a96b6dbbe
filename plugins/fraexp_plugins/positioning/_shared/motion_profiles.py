"""Profiles: how the design model is moved from one target to the next."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, Plant
from fraexp_plugins.positioning._shared.deadbeat_program import DeadbeatProgram
from fraexp_plugins.positioning._shared.design_model import Trajectory
from fraexp_plugins.positioning._shared.motion_plan import FORCE_RESERVE, POINTS_PER_SAMPLE, MotionTask

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
