"""The problem that all peers solve: the paper's closed loop as plain numbers, sample by sample.

At each sample k the controller sees y, and its output plus the excitation, u[k] = C(z)(0 - y)[k] + w[k], reaches the
table `delay` samples later and is held for one sample. Between samples x' = a x + b (u - f), y = c x, with the force f
of parallel elements: each deflection follows y up to its limit. Viscous friction is part of a; the encoder is ideal.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from paper_machine import FRICTION, PAPER, PLANT, REGISTRY

from fraexp.components.kinds import Controller
from fraexp.components.registry import create

LONGEST = 500
"""Maximum number of samples of a block of whole periods."""


@dataclass(frozen=True)
class Problem:
    """The loop's matrices, and one excitation per lane; lanes are independent of each other."""

    a: np.ndarray
    """Plant with viscous friction, shape (n, n)."""
    b: np.ndarray
    """Shape (n,)."""
    c: np.ndarray
    """Shape (n,)."""
    stiffness: np.ndarray
    """Stiffness K_i of the friction elements [N/m], shape (elements,)."""
    limit: np.ndarray
    """Limit Y_mi of their deflections [m], shape (elements,)."""
    numerator: np.ndarray
    """C(z) in ascending powers of 1/z [N/m], shape (p,)."""
    denominator: np.ndarray
    """The same, beginning with 1, shape (p,)."""
    sample_time: float
    """Sample time [s]."""
    delay: int
    """Dead time between u and the thrust [samples]."""
    excitation: np.ndarray
    """Excitation w [N], shape (lanes, samples)."""
    cycles: np.ndarray
    """Whole periods in the last block of each lane, shape (lanes,)."""
    block: np.ndarray
    """Samples of the last block of each lane, shape (lanes,)."""

    @property
    def simulated_time(self) -> float:
        """Time that all lanes simulate together [s]."""
        return self.excitation.size * self.sample_time

    def response(self, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return Y/U_e [m/N] of the last block of each lane, from u [N] and y [m] of shape (lanes, samples).

        U_e is what the thrust leaves after friction, and friction is observed from y, as the proposed method does:
        by the same elements at the sample time.
        """
        force = self.observed_force(y)
        answers = []
        for lane, (cycles, block) in enumerate(zip(self.cycles, self.block, strict=True)):
            line = np.exp(-2j * np.pi * cycles * np.arange(block) / block)
            thrust, friction, position = (np.sum(row[lane, -block:] * line) for row in (u, force, y))
            answers.append(position / (thrust * np.exp(-2j * np.pi * cycles * self.delay / block) - friction))
        return np.array(answers)

    def observed_force(self, y: np.ndarray) -> np.ndarray:
        """Return the elements' force [N] along sampled positions [m], from rest, both of shape (lanes, samples)."""
        z, force = np.zeros((y.shape[0], self.limit.size)), np.zeros(y.shape)
        for k in range(1, y.shape[1]):
            z = np.clip(z + (y[:, k] - y[:, k - 1])[:, None], -self.limit, self.limit)
            force[:, k] = z @ self.stiffness
        return force

    def exact_step(self, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what a time step does to the state: by itself, by a held force, by one that rises from 0 to 1 N."""
        from scipy.linalg import expm

        n = self.b.size
        block = np.zeros((n + 2, n + 2))
        block[:n, :n], block[:n, n], block[n, n + 1] = self.a * step, self.b * step, 1.0
        whole = expm(block)
        return whole[:n, :n], whole[:n, n], whole[:n, n + 1]


Run = Callable[[], tuple[np.ndarray, np.ndarray]]
"""Simulates from rest; returns u [N] and y [m] at the samples, each of shape (lanes, samples)."""


@dataclass(frozen=True)
class Peer:
    """One way to simulate the loop."""

    name: str
    settings: str
    error: float
    """What it claims: greatest relative error of Y/U_e."""
    prepare: Callable[[Problem], Run]
    """Does what is done once per problem, such as making matrices; compiling is left to the first run."""
    package: str = ""
    """Module that must be there; empty for none."""
    batch: bool = False
    """Whether all lanes run side by side."""


def paper_loop(frequencies: np.ndarray, samples: int, amplitude: float = 12.0) -> Problem:
    """Return the paper's machine with an ideal encoder, one lane per frequency [Hz], excited with an amplitude [N]."""
    loop = PAPER["loop"]
    sample_time = loop["sample_time"]
    model = PLANT.state_space()
    controller = create(REGISTRY, Controller, PAPER["controller"])
    numerator, denominator = controller.transfer_function(sample_time)
    cycles, block = np.array([whole_periods(f * sample_time, min(samples, LONGEST)) for f in frequencies]).T
    phase = 2 * np.pi * cycles[:, None] * np.arange(samples) / block[:, None]
    return Problem(
        a=model.a - FRICTION.viscous * np.outer(model.b, model.c @ model.a),
        b=model.b,
        c=model.c,
        stiffness=np.array(FRICTION.element_stiffness),
        limit=np.array(FRICTION.limit_deflection),
        numerator=numerator,
        denominator=denominator,
        sample_time=sample_time,
        delay=round(loop["input_dead_time"] / sample_time),
        excitation=amplitude * np.sin(phase),
        cycles=cycles,
        block=block,
    )


def whole_periods(cycles_per_sample: float, longest: int) -> tuple[int, int]:
    """Return whole periods and whole samples, between half of `longest` and all of it, that meet a frequency best."""
    samples = np.arange(longest, longest // 2, -1)
    cycles = np.maximum(np.rint(cycles_per_sample * samples), 1).astype(int)
    best = int(np.argmin(np.abs(cycles / samples / cycles_per_sample - 1)))
    return int(cycles[best]), int(samples[best])
