"""The table as an ordinary differential equation of the plant's states, and the sampled part that drives it.

The elements' deflections follow from those at the last instant `latch` was called and the displacement since then,
which is exact while the motion keeps its direction. As states of their own, with a rate that jumps to zero at the
limit, they would overshoot it: the error of that is a hundred times larger, and the equation three times as long.
"""

from collections.abc import Callable

import numpy as np
from numba import njit

from peers.problem import Problem, Run


class Lane:
    """Controller, dead time and friction memory of one lane: what is constant between two instants, and the record."""

    def __init__(self, problem: Problem, lane: int, steps: int) -> None:
        samples = problem.excitation.shape[1]
        self.held = np.zeros(2 + problem.limit.size)
        """Thrust [N], displacement [m] and the elements' deflections [m] at the last instant."""
        self.c, self.limit, self.steps = problem.c, problem.limit, steps
        self.numerator, self.denominator = problem.numerator.tolist(), problem.denominator.tolist()
        self.excitation, self.delay = problem.excitation[lane].tolist(), problem.delay
        self.memory = [0.0] * len(self.numerator)
        self.u, self.y = [0.0] * samples, [0.0] * samples
        self.count = 0

    def latch(self, x: np.ndarray) -> None:
        """Keep the deflections at this instant, of which there are `steps` per sample; sample at each first one."""
        latched(self.held, x, self.c, self.limit)
        k, rest = divmod(self.count, self.steps)
        self.count += 1
        if rest or k >= len(self.u):
            return
        position, memory = float(self.held[1]), self.memory
        value = memory[0] - self.numerator[0] * position
        for i in range(1, len(memory)):
            after = memory[i] if i < len(memory) - 1 else 0.0
            memory[i - 1] = after - self.numerator[i] * position - self.denominator[i] * value
        self.u[k], self.y[k] = value + self.excitation[k], position
        self.held[0] = self.u[k - self.delay] if k >= self.delay else 0.0


@njit(cache=True)
def latched(held, x, c, limit):  # type: ignore[no-untyped-def]
    """Move displacement and deflections in `held` to the present instant."""
    displacement = 0.0
    for i in range(c.size):
        displacement += c[i] * x[i]
    for i in range(limit.size):
        held[2 + i] = min(max(held[2 + i] + displacement - held[1], -limit[i]), limit[i])
    held[1] = displacement


def right_hand_side(problem: Problem) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the compiled derivative(x, held)."""
    a, b, c, stiffness, limit = problem.a, problem.b, problem.c, problem.stiffness, problem.limit
    n = b.size

    @njit
    def derivative(x, held):  # type: ignore[no-untyped-def]
        force, moved = held[0], -held[1]
        for i in range(n):
            moved += c[i] * x[i]
        for i in range(limit.size):
            force -= stiffness[i] * min(max(held[2 + i] + moved, -limit[i]), limit[i])
        answer = np.empty(n)
        for i in range(n):
            answer[i] = b[i] * force
            for j in range(n):
                answer[i] += a[i, j] * x[j]
        return answer

    return derivative


def all_lanes(problem: Problem, lane: Callable[[int], Lane]) -> Run:
    """Return the simulation of lane after lane."""

    def run() -> tuple[np.ndarray, np.ndarray]:
        lanes = [lane(number) for number in range(problem.excitation.shape[0])]
        return np.array([one.u for one in lanes]), np.array([one.y for one in lanes])

    return run
