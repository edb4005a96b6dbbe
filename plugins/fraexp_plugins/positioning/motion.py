"""Planning a motion: feedforward thrust, friction compensation and reference that belong together."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fraexp.api import FrictionModel, ParameterError
from fraexp_plugins.positioning.deadbeat import MOST_BOUND
from fraexp_plugins.positioning.design_model import DesignModel, Trajectory

POINTS = 10
"""Points per sample at which the friction model is driven."""
ROUNDS = 10
"""Times that friction and the thrust that leaves room for it are computed, at most."""
KEPT = 1e-3
"""Share of the force limit that is kept back: friction differs a little from one round to the next."""
MOST = 100_000
"""Samples of a move at most."""
MOST_ACCELERATION = 1000.0
"""Acceleration [m/s²] up to which a move without a force limit is believed: about 100 g, which the fastest axes on
guides reach, those of wire bonders. Far beyond it no axis follows, and a linear model with any thrust it likes says
nothing of one."""


@dataclass(frozen=True)
class Plan:
    """A motion that is known in advance, sample by sample."""

    thrust: np.ndarray
    """What moves the design model [N], shape (n,)."""
    friction: np.ndarray
    """What the friction model asks for on top of it [N], shape (n,)."""
    reference: np.ndarray
    """What the position is to be measured as meanwhile [m], shape (n,)."""
    acceleration: float
    """Greatest acceleration of the design model [m/s²]."""


@dataclass(frozen=True)
class Move(ABC):
    """What a motion shall do; how the design model is moved is told by the profile, a subclass."""

    model: DesignModel
    friction: FrictionModel | None
    distances: Sequence[float]
    """From one target to the next [m]."""
    moving: int
    """Samples of each move."""
    resting: int
    """Samples after each move."""
    limit: float | None
    """Greatest thrust, friction included [N]."""

    @property
    @abstractmethod
    def least(self) -> int:
        """Samples that a move needs whatever the thrust."""

    @abstractmethod
    def thrust(self, friction: np.ndarray) -> np.ndarray | None:
        """Return the thrust that moves the model [N], with room for friction [N]; None if it cannot keep the limit."""

    @abstractmethod
    def trajectory(self, thrust: np.ndarray) -> Trajectory:
        """Return where the thrust [N] takes the model, at `POINTS` per sample."""

    def plan(self) -> Plan | None:
        """Return the motion, or None if the limit cannot be kept in so many samples."""
        friction = np.zeros(len(self.distances) * (self.moving + self.resting))
        for _ in range(ROUNDS):
            thrust = self.thrust(friction)
            if thrust is None:
                return None
            trajectory = self.trajectory(thrust)
            friction = self._friction(trajectory.displacement)
            if self.limit is None or np.abs(thrust + friction).max() <= self.limit:
                return Plan(thrust, friction, trajectory.measured, self._acceleration(trajectory.displacement))
        return None

    def _acceleration(self, displacement: np.ndarray) -> float:
        """Return the greatest acceleration of a displacement [m/s²]."""
        return float(np.abs(np.diff(displacement, 2)).max()) / (self.model.sample_time / POINTS) ** 2

    def _friction(self, displacement: np.ndarray) -> np.ndarray:
        """Return the model's friction force in each sample [N], averaged: the thrust is held meanwhile."""
        samples = (displacement.size - 1) // POINTS
        if self.friction is None:
            return np.zeros(samples)
        sample_time = self.model.sample_time
        force = self.friction.force(displacement, sample_time / POINTS)
        between = (force[1:] + force[:-1]) / 2
        velocity = np.diff(displacement[::POINTS]) / sample_time
        return between.reshape(samples, POINTS).mean(axis=1) + self.friction.viscous * velocity


def planned(task: Move) -> Plan:
    """Return the motion of a task; ParameterError tells the least number of samples if it is not feasible."""
    if task.moving < task.least:
        reason = f"{task.model.driven} states do not come to rest in fewer than {task.least}"
        raise ParameterError(_too_short(task, reason, task.least))
    if task.moving > MOST:
        raise ParameterError(
            f"a move of {task.moving:,} samples is too long to be planned; expected {MOST:,} at most: shorten "
            "'duration', or make several moves"
        )
    found = task.plan()
    if found is not None:
        _check_sane(task, found)
        return found
    holding = _holding(task)
    if task.limit is not None and holding > task.limit * (1 - KEPT):
        raise ParameterError(
            f"force_limit {task.limit:g} N is not above the {holding:.4g} N that rest at the targets needs; raise it"
        )
    enough = _least_samples(task)
    if enough is None:
        raise ParameterError(
            f"force_limit {task.limit:g} N is too low for a move of {max(MOST_BOUND, task.moving):,} samples; raise it"
        )
    raise ParameterError(_too_short(task, f"the thrust would exceed force_limit {task.limit:g} N", enough))


def _check_sane(task: Move, plan: Plan) -> None:
    """Raise ParameterError for a thrust that no machine has, unless the user states which thrust it has."""
    if task.limit is None and plan.acceleration > MOST_ACCELERATION:
        greatest = float(np.abs(plan.thrust + plan.friction).max())
        raise ParameterError(
            f"a move of {task.moving} samples ({task.moving * task.model.sample_time:g} s) needs {greatest:.3g} N and "
            f"{plan.acceleration:.3g} m/s²; beyond {MOST_ACCELERATION:g} m/s², about 100 g, no linear model of an axis "
            "is to be believed: lengthen 'duration', or give force_limit, the greatest thrust of the machine"
        )


def _holding(task: Move) -> float:
    """Return the greatest thrust that rest at a target needs [N]: that of springs, and of friction left behind."""
    plan = replace(task, limit=None).plan()
    if plan is None:
        return 0.0
    moves = (plan.thrust + plan.friction).reshape(len(task.distances), task.moving + task.resting)
    return float(np.abs(moves[:, task.moving :]).max())


def _least_samples(task: Move) -> int | None:
    """Return the least number of samples in which the limit can be kept, or None if `MOST_BOUND` is not enough."""
    low = high = task.moving
    while replace(task, moving=high).plan() is None:
        if high >= MOST_BOUND:
            return None
        low, high = high, min(2 * high, MOST_BOUND)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if replace(task, moving=middle).plan() is None else (low, middle)
    return high


def _too_short(task: Move, reason: str, least: int) -> str:
    sample_time = task.model.sample_time
    return (
        f"a move of {task.moving} samples ({task.moving * sample_time:g} s) is too short: {reason}; expected "
        f"{least} samples ({least * sample_time:g} s) at least"
    )
