"""Profiles: how the design model is moved from one target to the next."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fraexp.api import ParameterError, Plant
from fraexp_plugins.positioning.deadbeat import Program
from fraexp_plugins.positioning.design_model import Trajectory
from fraexp_plugins.positioning.motion import KEPT, POINTS, Move

Shape = Callable[[np.ndarray], np.ndarray]
SLOW = 1e-3
"""Angular frequency [rad/s] at which a plant is a rigid body, if it has one."""
RIGID = 1e-3
"""Relative change of the rigid-body gain from SLOW to twice of it, up to which it is one."""


@dataclass(frozen=True)
class Deadbeat(Move):
    """All states of the design model come to rest with the move: see `deadbeat.Program`."""

    order: int
    """Of the differences of the thrust that are made small."""

    @property
    def least(self) -> int:
        return self.model.driven

    def thrust(self, friction: np.ndarray) -> np.ndarray | None:
        begin, parts = 0.0, []
        for number, distance in enumerate(self.distances):
            first = number * (self.moving + self.resting)
            held = self.model.at_rest(begin)[1] + friction[first : first + self.moving]
            limit = None if self.limit is None else self.limit * (1 - KEPT)
            bounds = () if limit is None else (-limit - held, limit - held)
            found = self._programs[distance].solve(*bounds)
            if found is None:
                return None
            parts.append(self.model.at_rest(begin)[1] + found)
            begin += distance
            parts.append(np.full(self.resting, self.model.at_rest(begin)[1]))
        return np.concatenate(parts)

    @cached_property
    def _programs(self) -> dict[float, Program]:
        """By the distance to be moved; whence does not matter, as the model is linear."""
        driven = self.model.driven
        transition, held = self.model.after(self.model.sample_time)
        found = {}
        for distance in set(self.distances):
            state, rest = self.model.at_rest(distance)
            found[distance] = Program.of(
                transition[:driven, :driven], held[:driven], state[:driven], rest, self.moving, self.order
            )
        return found

    def trajectory(self, thrust: np.ndarray) -> Trajectory:
        return self.model.moved(thrust, self.model.at_rest(0.0)[0], POINTS)


@dataclass(frozen=True)
class JerkLimited(Move):
    """Constant jerk in quarters of the move, +, -, -, +, and the thrust of the rigid body alone.

    The acceleration feedforward of most drives (P. Lambrechts, M. Boerlage and M. Steinbuch, Control Engineering
    Practice 13(2), 2005, doi:10.1016/j.conengprac.2004.02.010): the modes are left to ring. Lags count as dead time.
    """

    gain: float
    """Of the rigid body [m/(N s²)]."""

    @property
    def least(self) -> int:
        return 4

    def thrust(self, friction: np.ndarray) -> np.ndarray | None:
        sample_time = self.model.sample_time
        samples = len(self.distances) * (self.moving + self.resting)
        velocity = self._sum(s_curve_velocity, np.arange(samples + 1.0)) / (self.moving * sample_time)
        return np.diff(velocity) / (self.gain * sample_time)

    def trajectory(self, thrust: np.ndarray) -> Trajectory:
        fine = np.arange(thrust.size * POINTS + 1) / POINTS
        late = np.arange(thrust.size) - self.model.delay / self.model.sample_time
        return Trajectory(self._sum(s_curve, fine), self._sum(s_curve, late))

    def _sum(self, shape: Shape, times: np.ndarray) -> np.ndarray:
        """Return the shapes of all moves, each times its distance [m], at times [samples]."""
        every = self.moving + self.resting
        moves = [d * shape((times - number * every) / self.moving) for number, d in enumerate(self.distances)]
        return np.sum(moves, axis=0)


def s_curve(time: np.ndarray) -> np.ndarray:
    """Return the way from 0 to 1 in the time from 0 to 1, with a jerk of 32, -32, -32 and 32 in its quarters."""
    t = np.clip(time, 0.0, 1.0)
    return 16 / 3 * (t**3 - 2 * np.maximum(t - 0.25, 0) ** 3 + 2 * np.maximum(t - 0.75, 0) ** 3)


def s_curve_velocity(time: np.ndarray) -> np.ndarray:
    """Return the derivative of `s_curve`."""
    t = np.clip(time, 0.0, 1.0)
    return 16 * (t**2 - 2 * np.maximum(t - 0.25, 0) ** 2 + 2 * np.maximum(t - 0.75, 0) ** 2)


def rigid_body_gain(plant: Plant) -> float:
    """Return lim s² P(s) [m/(N s²)]; ParameterError if the plant is no free rigid body at low frequencies."""
    omega = SLOW * np.array([1.0, 2.0])
    gains = np.real(-(omega**2) * plant.response(omega))
    if not gains[0] > 0 or abs(gains[1] / gains[0] - 1) > RIGID:
        raise ParameterError("the profile jerk_limited needs a design model that is a free rigid body; take deadbeat")
    return float(gains[0])
