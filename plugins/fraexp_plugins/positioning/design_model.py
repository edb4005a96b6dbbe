"""The model that a feedforward is designed on: lags, plant and delays, exactly at the samples and between them."""

from dataclasses import dataclass, field

import numpy as np

from fraexp.api import ParameterError, StateSpace

EQUAL = 1e-9
"""Relative error up to which an equilibrium is one, and two instants are the same."""
STABLE = 1e-5
"""Real part of a pole, relative to the greatest magnitude, that rounding makes of an integrator."""


@dataclass(frozen=True)
class DesignModel:
    """A thrust held over each sample, the displacement that it causes, and the position measured later.

    The state holds the lags before the thrust, the plant and the lags of the measurement, in this order.
    """

    a: np.ndarray
    """Continuous-time system matrix, shape (n, n)."""
    b: np.ndarray
    """Shape (n,)."""
    displacement: np.ndarray
    """Row of the displacement, shape (n,)."""
    measured: np.ndarray
    """Row of the measured position, but for its dead time, shape (n,)."""
    driven: int
    """States that the displacement depends on: the first ones."""
    sample_time: float
    """Sample time [s]."""
    dead_time: float
    """Dead time between control input and measured position [s]."""
    delay: float
    """The same with the lags' time constants [s]: how late a slow motion is measured."""
    known: dict[float, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, repr=False, compare=False)
    """What `after` has computed, by the time: planning asks again and again."""

    @classmethod
    def of(
        cls,
        plant: StateSpace,
        sample_time: float,
        dead_time: float,
        lags_in: tuple[float, ...] = (),
        lags_out: tuple[float, ...] = (),
    ) -> "DesignModel":
        """Return the model of a plant behind first-order lags [s] and dead time [s]."""
        n, p, q = plant.b.size, len(lags_in), len(lags_out)
        size = p + n + q
        a, b = np.zeros((size, size)), np.zeros(size)
        displacement = np.zeros(size)
        a[p : p + n, p : p + n], displacement[p : p + n] = plant.a, plant.c
        source, identity = np.zeros(size), np.eye(size)
        for i, constant in enumerate(lags_in):
            a[i] = (source - identity[i]) / constant
            b[i] = 0.0 if i else 1 / constant
            source = identity[i]
        a[p : p + n] += np.outer(plant.b, source)
        if not p:
            b[:n] = plant.b
        measured = displacement
        for i, constant in enumerate(lags_out, start=p + n):
            a[i] = (measured - identity[i]) / constant
            measured = identity[i]
        delay = dead_time + sum(lags_in) + sum(lags_out)
        _check_stable(a[: p + n, : p + n])
        return cls(a, b, displacement, measured, p + n, sample_time, dead_time, delay)

    def after(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what state and held thrust become after a time [s] within a sample: shapes (n, n) and (n,)."""
        if time not in self.known:
            self.known[time] = _after(self.a, self.b, time)
        return self.known[time]

    def at_rest(self, position: float) -> tuple[np.ndarray, float]:
        """Return the state, shape (n,), and the thrust [N] at which the displacement rests at a position [m].

        ParameterError if the plant cannot rest there.
        """
        n = self.b.size
        system = np.zeros((n + 1, n + 1))
        system[:n, :n], system[:n, n], system[n, :n] = self.a, self.b, self.displacement
        # rows and columns of unlike units: a solution by least squares needs them alike
        columns = 1 / np.maximum(np.abs(system).max(axis=0), np.finfo(float).tiny)
        rows = 1 / np.maximum(np.abs(system * columns).max(axis=1), np.finfo(float).tiny)
        scaled, goal = rows[:, None] * system * columns, rows * np.append(np.zeros(n), position)
        solution = np.linalg.lstsq(scaled, goal, rcond=None)[0]
        if np.abs(scaled @ solution - goal).max() > EQUAL * np.abs(goal).max():
            raise ParameterError("the design model cannot rest away from its origin: it needs a rigid body or a spring")
        found = columns * solution
        return found[:n], float(found[n])

    def moved(self, thrust: np.ndarray, state: np.ndarray, points: int) -> "Trajectory":
        """Return where a thrust [N] held over each sample, shape (samples,), takes a state, at `points` per sample."""
        transition, held = self.after(self.sample_time)
        states = np.empty((thrust.size + 1, state.size))
        states[0] = state
        for k in range(thrust.size):
            states[k + 1] = transition @ states[k] + held * thrust[k]
        instants = [self.after(j * self.sample_time / points) for j in range(points)]
        between = [states[:-1] @ (self.displacement @ a) + thrust * (self.displacement @ b) for a, b in instants]
        displacement = np.append(np.stack(between, axis=1).ravel(), self.displacement @ states[-1])
        return Trajectory(displacement, self._measured(states, thrust))

    def _measured(self, states: np.ndarray, thrust: np.ndarray) -> np.ndarray:
        """Return the position that is measured at each sample [m], shape (samples,): from rest before the first."""
        whole = int(np.ceil(self.dead_time / self.sample_time - EQUAL))
        transition, held = self.after(max(whole * self.sample_time - self.dead_time, 0.0))
        seen = states[:-1] @ (self.measured @ transition) + thrust * (self.measured @ held)
        before = np.full(min(whole, seen.size), self.measured @ states[0])
        return np.concatenate([before, seen[: seen.size - before.size]])


def _after(a: np.ndarray, b: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    from scipy.linalg import expm  # scipy: imported only where something is designed

    n = b.size
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = a, b
    exponential = expm(block * time)
    return exponential[:n, :n], exponential[:n, n]


def _check_stable(a: np.ndarray) -> None:
    """Raise ParameterError if a state would grow by itself: integrators do not."""
    poles = np.linalg.eigvals(a)
    worst = poles[np.argmax(poles.real)]
    if worst.real > STABLE * np.abs(poles).max():
        raise ParameterError(
            f"the design model is unstable, with a pole at {worst.real:+.4g} rad/s: a feedforward cannot hold it; "
            "expected one that is stable but for its rigid body"
        )


@dataclass(frozen=True)
class Trajectory:
    """Where a design model goes."""

    displacement: np.ndarray
    """Displacement [m] at the points of all samples and after the last one, shape (samples * points + 1,)."""
    measured: np.ndarray
    """Measured position at each sample [m], shape (samples,)."""
