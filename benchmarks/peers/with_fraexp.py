"""fraexp itself, by its public way: the loop from rest, its whole record kept, no waiting for a periodic state."""

from typing import Any

import numpy as np
from paper_machine import FRICTION, PAPER, PLANT, REGISTRY

from fraexp.components.kinds import Controller, Excitation
from fraexp.components.periods import Period, Schedule
from fraexp.components.registry import create
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from peers.problem import Peer, Problem, Run


def peers() -> list[Peer]:
    """Return fraexp at several numbers of steps per sample."""
    return [
        Peer("fraexp", f"{steps} steps per sample", error, lambda p, steps=steps: prepare(p, steps), batch=True)
        for steps, error in ((1, 3e-3), (2, 1e-3), (5, 2e-4), (10, 5e-5))
    ]


class Given(Excitation):
    """Excitations that are given as they are, each recorded from rest."""

    waveforms: Any

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        return tuple(Period(row, np.array([1])) for row in self.waveforms)

    @property
    def schedule(self) -> Schedule:
        return Schedule(settling_timeout=0.0)


def prepare(problem: Problem, steps: int) -> Run:
    """Return the simulation; discretising the machine is part of each run."""
    controller = create(REGISTRY, Controller, PAPER["controller"])
    loop = ControlLoop.parse({**PAPER["loop"], "resolution": 0.0}, "loop")
    machine = Machine(PLANT, FRICTION, controller, loop, Numerics(steps_per_sample=steps))
    excitation = Given(waveforms=problem.excitation)

    def run() -> tuple[np.ndarray, np.ndarray]:
        segments = simulate_loop(machine, excitation, lambda _: None).segments
        u, y = (np.array([segment.channels[name][0] for segment in segments]) for name in ("u", "y"))
        return u, y

    return run
