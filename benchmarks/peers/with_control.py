"""python-control: the loop as one discrete nonlinear system in steps of Ts/m, run by input_output_response.

The update is the step of the NumPy loops, in plain Python or compiled; at every m-th step the controller acts.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from peers.problem import Peer, Problem, Run


def peers() -> list[Peer]:
    """Return the system with a plain and with a compiled update."""
    return [
        Peer(
            "python-control input_output_response",
            f"Ts/2, update in {how}",
            1e-3,
            lambda problem, compiled=compiled: prepare(problem, 2, compiled=compiled),
            "control",
        )
        for how, compiled in (("NumPy", False), ("numba", True))
    ]


def prepare(problem: Problem, steps: int, *, compiled: bool) -> Run:
    """Return the simulation in Ts/steps."""
    import control
    from numba import njit

    lanes, samples = problem.excitation.shape
    n, size, step = problem.b.size, _size(problem), problem.sample_time / steps
    update = _update(problem, steps)
    update = njit(update) if compiled else update
    system = control.NonlinearIOSystem(
        lambda t, state, w, _: update(round(t / step), state, w[0]), inputs=1, states=size, outputs=size, dt=step
    )
    time = np.arange(samples * steps + 1) * step

    def run() -> tuple[np.ndarray, np.ndarray]:
        u, y = np.zeros((lanes, samples)), np.zeros((lanes, samples))
        for lane, excitation in enumerate(problem.excitation):
            held = np.append(np.repeat(excitation, steps), 0.0)
            states = control.input_output_response(system, time, held, np.zeros(size)).outputs
            y[lane] = (problem.c @ states[:n])[:-1:steps]
            u[lane] = states[-1, 1::steps]
        return u, y

    return run


def _size(problem: Problem) -> int:
    return problem.b.size + problem.limit.size + problem.numerator.size + 2 + problem.delay + 1


def _update(problem: Problem, steps: int) -> Callable[[int, np.ndarray, float], Any]:
    """Return the next state: plant, elements, controller, force and predicted displacement, dead time."""
    transition, held, ramp = (np.ascontiguousarray(e) for e in problem.exact_step(problem.sample_time / steps))
    c, stiffness, limit = problem.c, problem.stiffness, problem.limit
    numerator, denominator = problem.numerator, problem.denominator
    n, p = problem.b.size, numerator.size
    elements, contact = slice(n, n + limit.size), n + limit.size + p
    memory, pipe = slice(contact - p, contact), contact + 2

    def update(count, state, excitation):  # type: ignore[no-untyped-def]
        after = state.copy()
        x = state[:n].copy()
        if count % steps == 0:
            y, w = c @ x, after[memory]
            value = w[0] - numerator[0] * y
            w[:-1] = w[1:] - numerator[1:] * y - denominator[1:] * value
            after[pipe:-1] = state[pipe + 1 :]
            after[-1] = value + excitation
        force = state[contact]
        x = transition @ x + held * (after[pipe] - force)
        displacement = c @ x
        z = np.minimum(np.maximum(state[elements] + (displacement - state[contact + 1]), -limit), limit)
        after[contact], after[contact + 1] = stiffness @ z, displacement
        after[:n] = x - ramp * (after[contact] - force)
        after[elements] = z
        return after

    return update
