"""NumPy by hand: one lane at a time, and all lanes side by side.

Friction is linear within a step. The displacement is predicted with the old force, the elements follow the predicted
displacement, and the state is corrected by the change of their force: one evaluation per step, of second order.
"""

import numpy as np

from peers.problem import Peer, Problem, Run


def peers() -> list[Peer]:
    """Return both loops."""
    return [
        Peer("NumPy loop", "predict-correct, Ts/2", 1e-3, lambda problem: one_by_one(problem, 2)),
        Peer("NumPy, all lanes side by side", "predict-correct, Ts/2", 1e-3, lambda p: side_by_side(p, 2), batch=True),
    ]


def one_by_one(problem: Problem, steps: int) -> Run:
    """Return the simulation of lane after lane."""

    def run() -> tuple[np.ndarray, np.ndarray]:
        answers = [_lane(problem, steps, excitation) for excitation in problem.excitation]
        return np.array([u for u, _ in answers]), np.array([y for _, y in answers])

    return run


def _lane(problem: Problem, steps: int, excitation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    transition, held, ramp = problem.exact_step(problem.sample_time / steps)
    c, stiffness, upper, lower = problem.c, problem.stiffness, problem.limit, -problem.limit
    numerator, denominator = problem.numerator, problem.denominator
    x, z, w = np.zeros(problem.b.size), np.zeros(upper.size), np.zeros(numerator.size)
    force = last = 0.0
    u, y = np.zeros(excitation.size), np.zeros(excitation.size)
    for k in range(excitation.size):
        y[k] = c @ x
        control = w[0] - numerator[0] * y[k]
        w[:-1] = w[1:] - numerator[1:] * y[k] - denominator[1:] * control
        u[k] = control + excitation[k]
        thrust = u[k - problem.delay] if k >= problem.delay else 0.0
        for _ in range(steps):
            x = transition @ x + held * (thrust - force)
            displacement = c @ x
            z = np.minimum(np.maximum(z + (displacement - last), lower), upper)
            before, force, last = force, stiffness @ z, displacement
            x -= ramp * (force - before)
    return u, y


def side_by_side(problem: Problem, steps: int) -> Run:
    """Return the simulation of all lanes at once."""
    transition, held, ramp = (np.ascontiguousarray(e) for e in problem.exact_step(problem.sample_time / steps))
    held, ramp, stiffness = held[:, None], ramp[:, None], problem.stiffness
    upper, lower = problem.limit[:, None], -problem.limit[:, None]
    numerator, denominator = problem.numerator[:, None], problem.denominator[:, None]
    lanes, samples = problem.excitation.shape

    def run() -> tuple[np.ndarray, np.ndarray]:
        excitation = np.ascontiguousarray(problem.excitation.T)
        x, z = np.zeros((problem.b.size, lanes)), np.zeros((problem.limit.size, lanes))
        w, force, last = np.zeros((problem.numerator.size, lanes)), np.zeros(lanes), np.zeros(lanes)
        u, y = np.zeros((samples, lanes)), np.zeros((samples, lanes))
        for k in range(samples):
            y[k] = problem.c @ x
            control = w[0] - numerator[0] * y[k]
            w[:-1] = w[1:] - numerator[1:] * y[k] - denominator[1:] * control
            u[k] = control + excitation[k]
            thrust = u[k - problem.delay] if k >= problem.delay else 0.0
            for _ in range(steps):
                x = transition @ x
                x += held * (thrust - force)
                displacement = problem.c @ x
                z += displacement - last
                np.maximum(z, lower, out=z)
                np.minimum(z, upper, out=z)
                before, force, last = force, stiffness @ z, displacement
                x -= ramp * (force - before)
        return np.ascontiguousarray(u.T), np.ascontiguousarray(y.T)

    return run
