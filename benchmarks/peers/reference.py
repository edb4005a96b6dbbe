"""The reference: Runge-Kutta of order 4 in small steps, compiled, with friction evaluated at each stage.

Within a step the elements' deflections follow from those at its begin, which is exact unless the motion reverses
within the step; then the error is that of the way back, below 1e-11 m.
"""

import numpy as np
from numba import njit

from peers.problem import Peer, Problem, Run


def peers() -> list[Peer]:
    """Return the same program as a peer, in long steps."""
    return [Peer("Runge-Kutta 4 by hand, numba", "Ts/2", 1e-4, lambda problem: reference(problem, 2))]


def reference(problem: Problem, substeps: int = 50) -> Run:
    """Return the simulation in steps of Ts/substeps."""
    p = problem
    constants = (p.a, p.b, p.c, p.stiffness, p.limit, p.numerator, p.denominator, p.sample_time, p.delay)

    def run() -> tuple[np.ndarray, np.ndarray]:
        u, y = np.zeros(p.excitation.shape), np.zeros(p.excitation.shape)
        for lane in range(u.shape[0]):
            simulate(constants, substeps, p.excitation[lane], u[lane], y[lane])
        return u, y

    return run


@njit(cache=True)
def simulate(constants, substeps, excitation, u, y):  # type: ignore[no-untyped-def]
    """Fill u and y of one lane."""
    a, b, c, stiffness, limit, numerator, denominator, sample_time, delay = constants
    n, h = b.size, sample_time / substeps
    x, z, w = np.zeros(n), np.zeros(limit.size), np.zeros(numerator.size)
    slopes, trial = np.zeros((4, n)), np.zeros(n)
    for k in range(excitation.size):
        y[k] = product(c, x)
        control = w[0] - numerator[0] * y[k]
        for i in range(1, w.size):
            w[i - 1] = (w[i] if i < w.size - 1 else 0.0) - numerator[i] * y[k] - denominator[i] * control
        u[k] = control + excitation[k]
        thrust = u[k - delay] if k >= delay else 0.0
        for _ in range(substeps):
            start = product(c, x)
            for stage in range(4):
                share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                for i in range(n):
                    trial[i] = x[i] + share * h * slopes[max(stage - 1, 0), i]
                force = thrust
                moved = product(c, trial) - start
                for i in range(z.size):
                    force -= stiffness[i] * min(max(z[i] + moved, -limit[i]), limit[i])
                for i in range(n):
                    slopes[stage, i] = b[i] * force
                    for j in range(n):
                        slopes[stage, i] += a[i, j] * trial[j]
            for i in range(n):
                x[i] += h / 6 * (slopes[0, i] + 2 * slopes[1, i] + 2 * slopes[2, i] + slopes[3, i])
            moved = product(c, x) - start
            for i in range(z.size):
                z[i] = min(max(z[i] + moved, -limit[i]), limit[i])


@njit(cache=True)
def product(c, x):  # type: ignore[no-untyped-def]
    """Return c·x; for six numbers a loop is faster than a call of BLAS."""
    total = 0.0
    for i in range(c.size):
        total += c[i] * x[i]
    return total
