"""scipy: solve_ivp from instant to instant, the thrust held between them; the right-hand side is compiled."""

import numpy as np

from peers.problem import Peer, Problem, Run
from peers.table import Lane, all_lanes, right_hand_side


def peers() -> list[Peer]:
    """Return the methods, from Ts to Ts or from Ts/2 to Ts/2."""
    settings = [
        ("RK45", 1e-3, 1, 5e-4),
        ("RK45", 1e-3, 2, 1e-4),
        ("LSODA", 1e-4, 1, 5e-3),
        ("LSODA", 1e-6, 2, 1e-4),
        ("Radau", 1e-3, 1, 5e-4),
    ]
    return [
        Peer(
            f"scipy solve_ivp {method}",
            f"rtol {rtol:g}, from Ts/{steps} to Ts/{steps}",
            error,
            lambda problem, method=method, rtol=rtol, steps=steps: prepare(problem, method, rtol, steps),
        )
        for method, rtol, steps, error in settings
    ]


def prepare(problem: Problem, method: str, rtol: float, steps: int) -> Run:
    """Return the simulation; the absolute tolerance is the relative one times 1 µm."""
    from scipy.integrate import solve_ivp

    derivative, step = right_hand_side(problem), problem.sample_time / steps
    options = {"method": method, "rtol": rtol, "atol": rtol * 1e-6, "first_step": step}

    def lane(number: int) -> Lane:
        one, x = Lane(problem, number, steps), np.zeros(problem.b.size)
        for _ in range(problem.excitation.shape[1] * steps):
            one.latch(x)
            x = solve_ivp(lambda _, x, held=one.held: derivative(x, held), (0.0, step), x, **options).y[:, -1]
        return one

    return all_lanes(problem, lane)
