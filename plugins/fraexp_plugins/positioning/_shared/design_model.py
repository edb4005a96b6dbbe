"""The model that a feedforward is designed on: lags, plant and delays, exact at the samples and between them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, StateSpace

RELATIVE_TOLERANCE = 1e-9
"""Relative error up to which a state is an equilibrium, and two instants are the same."""
INTEGRATOR_TOLERANCE = 1e-5
"""Real part, relative to the greatest magnitude of a pole, up to which rounding explains it."""


@dataclass(frozen=True)
class DesignModel:
    """A thrust held over each sample, the displacement that it causes, and the position measured later.

    The state holds the lags before the thrust, the plant and the lags of the measurement, in this order.
    """

    a: NDArray[np.float64]
    """Continuous-time system matrix, shape (n, n)."""
    b: NDArray[np.float64]
    """Shape (n,)."""
    displacement: NDArray[np.float64]
    """Row of the displacement, shape (n,)."""
    measured: NDArray[np.float64]
    """Row of the measured position, but for its dead time, shape (n,)."""
    driven_states: int
    """Number of states that the displacement depends on: the first ones."""
    sample_time: float
    """Sample time [s]."""
    dead_time: float
    """Dead time between control input and measured position [s]."""
    delay: float
    """Dead time and the lags' time constants [s]: how late a slow motion is measured."""
    transitions: dict[float, tuple[NDArray[np.float64], NDArray[np.float64]]] = field(
        default_factory=dict, repr=False, compare=False
    )
    """Cache of `transition`, by time: planning asks for the same few times again and again."""

    @classmethod
    def from_plant(
        cls,
        plant: StateSpace,
        sample_time: float,
        dead_time: float,
        input_time_constants: tuple[float, ...] = (),
        output_time_constants: tuple[float, ...] = (),
    ) -> "DesignModel":
        """Return the model of a plant with first-order lags [s] before and behind it, and dead time [s]."""
        n, p, q = plant.b.size, len(input_time_constants), len(output_time_constants)
        size = p + n + q
        a, b = np.zeros((size, size)), np.zeros(size)
        displacement = np.zeros(size)
        a[p : p + n, p : p + n], displacement[p : p + n] = plant.a, plant.c
        source, identity = np.zeros(size), np.eye(size)
        for i, constant in enumerate(input_time_constants):
            a[i] = (source - identity[i]) / constant
            b[i] = 0.0 if i else 1 / constant
            source = identity[i]
        a[p : p + n] += np.outer(plant.b, source)
        if not p:
            b[:n] = plant.b
        measured = displacement
        for i, constant in enumerate(output_time_constants, start=p + n):
            a[i] = (measured - identity[i]) / constant
            measured = identity[i]
        delay = dead_time + sum(input_time_constants) + sum(output_time_constants)
        _check_stable(a[: p + n, : p + n])
        return cls(a, b, displacement, measured, p + n, sample_time, dead_time, delay)

    def transition(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what state and held thrust contribute to the state a time [s] later: shapes (n, n) and (n,)."""
        if time not in self.transitions:
            self.transitions[time] = _exponential(self.a, self.b, time)
        return self.transitions[time]

    def at_rest(self, position: float) -> tuple[NDArray[np.float64], float]:
        """Return the state, shape (n,), and the thrust [N] at which the displacement rests at a position [m].

        ParameterError if the plant cannot rest there.
        """
        n = self.b.size
        system = np.zeros((n + 1, n + 1))
        system[:n, :n], system[:n, n], system[n, :n] = self.a, self.b, self.displacement
        # rows and columns differ in unit and size: least squares needs them scaled alike
        columns = 1 / np.maximum(np.abs(system).max(axis=0), np.finfo(float).tiny)
        rows = 1 / np.maximum(np.abs(system * columns).max(axis=1), np.finfo(float).tiny)
        scaled, goal = rows[:, None] * system * columns, rows * np.append(np.zeros(n), position)
        solution = np.linalg.lstsq(scaled, goal, rcond=None)[0]
        if np.abs(scaled @ solution - goal).max() > RELATIVE_TOLERANCE * np.abs(goal).max():
            raise ParameterError("the design model cannot rest away from its origin: it needs a rigid body or a spring")
        equilibrium = columns * solution
        return equilibrium[:n], float(equilibrium[n])

    def simulate(self, thrust: NDArray[np.float64], state: NDArray[np.float64], points: int) -> "Trajectory":
        """Return the trajectory of a thrust [N] held over each sample, shape (samples,), at `points` per sample."""
        state_part, thrust_part = self.transition(self.sample_time)
        states = np.empty((thrust.size + 1, state.size))
        states[0] = state
        for k in range(thrust.size):
            states[k + 1] = state_part @ states[k] + thrust_part * thrust[k]
        instants = [self.transition(j * self.sample_time / points) for j in range(points)]
        between = [states[:-1] @ (self.displacement @ a) + thrust * (self.displacement @ b) for a, b in instants]
        displacement = np.append(np.stack(between, axis=1).ravel(), self.displacement @ states[-1])
        return Trajectory(displacement, self._measured_position(states, thrust))

    def _measured_position(self, states: NDArray[np.float64], thrust: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the position that is measured at each sample [m], shape (samples,): from rest before the first."""
        delay_samples = int(np.ceil(self.dead_time / self.sample_time - RELATIVE_TOLERANCE))
        state_part, thrust_part = self.transition(max(delay_samples * self.sample_time - self.dead_time, 0.0))
        position = states[:-1] @ (self.measured @ state_part) + thrust * (self.measured @ thrust_part)
        before = np.full(min(delay_samples, position.size), self.measured @ states[0])
        return np.concatenate([before, position[: position.size - before.size]])


def _exponential(
    a: NDArray[np.float64], b: NDArray[np.float64], time: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    from scipy.linalg import expm  # scipy: imported only where something is designed

    n = b.size
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = a, b
    exponential = expm(block * time)
    return exponential[:n, :n], exponential[:n, n]


def _check_stable(a: NDArray[np.float64]) -> None:
    """Raise ParameterError if a state grows by itself: one of an integrator does not."""
    poles = np.linalg.eigvals(a)
    worst = poles[np.argmax(poles.real)]
    if worst.real > INTEGRATOR_TOLERANCE * np.abs(poles).max():
        raise ParameterError(
            f"the design model is unstable, with a pole at {worst.real:+.4g} rad/s: a feedforward cannot hold it; "
            "expected a stable one apart from its rigid body"
        )


@dataclass(frozen=True)
class Trajectory:
    """The motion of a design model."""

    displacement: NDArray[np.float64]
    """Displacement [m] at the points of all samples and after the last one, shape (samples * points + 1,)."""
    measured: NDArray[np.float64]
    """Measured position at each sample [m], shape (samples,)."""
