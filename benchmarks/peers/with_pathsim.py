"""pathsim: the plant as a dynamical system with a compiled right-hand side, the sampled part as scheduled event."""

from typing import Any

import numpy as np

from peers.problem import Peer, Problem, Run
from peers.table import Lane, all_lanes, right_hand_side


def peers() -> list[Peer]:
    """Return fixed steps and an adaptive one."""
    adaptive = {"tolerance_lte_rel": 1e-4, "tolerance_lte_abs": 1e-10}
    settings = [
        ("RKBS32", 1, {}, "Ts", 3e-3),
        ("RK4", 2, {}, "Ts/2", 1e-4),
        ("RKDP54", 1, adaptive, "adaptive, rtol 1e-4", 5e-4),
    ]
    return [
        Peer(
            "pathsim",
            f"{solver}, {said}",
            error,
            lambda problem, solver=solver, steps=steps, options=options: prepare(problem, solver, steps, options),
            "pathsim",
        )
        for solver, steps, options, said, error in settings
    ]


def prepare(problem: Problem, solver: str, steps: int, tolerances: dict[str, float]) -> Run:
    """Return the simulation, with `steps` instants per sample; the steps go from one to the next, unless adaptive."""
    from pathsim import Simulation, blocks, events, solvers

    derivative, step = right_hand_side(problem), problem.sample_time / steps
    duration = problem.excitation.shape[1] * problem.sample_time

    def lane(number: int) -> Lane:
        one = Lane(problem, number, steps)
        plant = blocks.ODE(lambda x, u, t: derivative(x, one.held), initial_value=np.zeros(problem.b.size))
        instants = events.Schedule(t_period=step, func_act=lambda t: one.latch(plant.engine.state))
        simulation: Any = Simulation(
            [plant], events=[instants], dt=step, dt_max=step, Solver=getattr(solvers, solver), log=False, **tolerances
        )
        simulation.run(duration, adaptive=bool(tolerances))
        return one

    return all_lanes(problem, lane)
