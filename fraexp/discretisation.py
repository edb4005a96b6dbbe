"""The loop's linear part over one sample, exactly: any dead time, first-order lags, friction linear in the step."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from fraexp.components import FrictionModel, StateSpace
from fraexp.errors import ParameterError

if TYPE_CHECKING:
    from fraexp.kernels.loop import Feedback, Sample, State

Path = tuple[float, tuple[float, ...]]
"""Dead time [s] and time constants of first-order lags [s]."""


def discretise(
    plant: StateSpace,
    friction: FrictionModel,
    controller: tuple[np.ndarray, np.ndarray],
    *,
    sample_time: float,
    steps: int,
    input_path: Path,
    output_path: Path,
    resolution: float,
    stroke: float,
) -> "tuple[Sample, Feedback, Callable[[], State]]":
    """Return the constants of the loop, and a function that makes its state at rest."""
    from fraexp.kernels.loop import Feedback, Sample, State

    a, drive, force, displacement, measured = _with_lags(plant, friction.viscous, input_path[1], output_path[1])
    n, step = a.shape[0], sample_time / steps
    whole_in, late_in = _split(input_path[0], sample_time)
    whole_out, late_out = _split(output_path[0], sample_time)

    def columns(time: float) -> np.ndarray:
        """State after `time` in the sample, from its begin's state, two inputs and all forces, (n, n + 3 + steps)."""
        effect = np.zeros((n, n + 3 + steps))
        transition, held, _ = _integrals(a, drive, time)
        later = _integrals(a, drive, max(time - late_in, 0.0))[1]
        effect[:, :n], effect[:, n], effect[:, n + 1] = transition, held - later, later
        for j in range(steps):  # the force goes from one bound's value to the next one's, then has no effect of its own
            begin, end = (max(time - bound * step, 0.0) for bound in (j, j + 1))
            _, held_begin, ramp_begin = _integrals(a, force, begin)
            _, held_end, ramp_end = _integrals(a, force, end)
            rising = (ramp_begin - ramp_end) / step - held_end
            effect[:, n + 2 + j] -= held_begin - held_end - rising
            effect[:, n + 3 + j] -= rising
        return effect

    ends = np.array([displacement @ columns((j + 1) * step) for j in range(steps)])
    sample = Sample(
        displacement=np.ascontiguousarray(ends[:, : n + 2]),
        compliance=np.ascontiguousarray(-ends[:, n + 2 :]),
        measured=measured @ columns(sample_time - late_out),  # the instant whose position is sampled next
        transition=np.ascontiguousarray(columns(sample_time).T),
        step=step,
    )
    size = max(controller[0].size, controller[1].size)
    padded = [np.concatenate([c, np.zeros(size - c.size)]) for c in controller]

    def at_rest() -> State:
        return State(
            x=np.zeros(a.shape[0]),
            z=np.zeros((2, max(friction.state_size, 1))),
            w=np.zeros(size),
            inputs=np.zeros(whole_in + 2),
            outputs=np.zeros(whole_out + 1),
            contact=np.zeros(5),
        )

    return sample, Feedback(padded[0], padded[1], float(resolution), float(stroke)), at_rest


def _split(dead_time: float, sample_time: float) -> tuple[int, float]:
    """Return the whole samples of a dead time, and the rest [s]."""
    whole = int(np.floor(dead_time / sample_time + 1e-9))
    return whole, max(dead_time - whole * sample_time, 0.0)


def _with_lags(
    plant: StateSpace, viscous: float, lags_in: tuple[float, ...], lags_out: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a, the columns of control input and friction force, the rows of displacement and measured position.

    Viscous friction is linear and therefore part of a; the velocity is c·a·x, as c·b = 0 for any P of relative
    degree 2.
    """
    if abs(plant.c @ plant.b) > 1e-9 * np.linalg.norm(plant.c) * np.linalg.norm(plant.b):
        raise ParameterError(
            "the plant's displacement jumps in velocity with the thrust; expected a relative degree of 2"
        )
    n, p, q = plant.b.size, len(lags_in), len(lags_out)
    a = np.zeros((n + p + q, n + p + q))
    a[:n, :n] = plant.a - viscous * np.outer(plant.b, plant.c @ plant.a)
    drive, force = np.zeros(n + p + q), np.zeros(n + p + q)
    displacement = np.zeros(n + p + q)
    displacement[:n] = plant.c
    force[:n] = plant.b
    for i, constant in enumerate(lags_in):
        a[n + i, n + i] = -1 / constant
        if i:
            a[n + i, n + i - 1] = 1 / constant
    if p:
        a[:n, n + p - 1] = plant.b
        drive[n] = 1 / lags_in[0]
    else:
        drive[:n] = plant.b
    for i, constant in enumerate(lags_out):
        a[n + p + i, n + p + i] = -1 / constant
        source = displacement if i == 0 else np.eye(n + p + q)[n + p + i - 1]
        a[n + p + i] += source / constant
    measured = np.eye(n + p + q)[-1] if q else displacement
    return a, drive, force, displacement, measured


def _integrals(a: np.ndarray, b: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return e^(at), and the responses at `time` [s] to a unit step and a unit ramp of the input (Van Loan, 1978)."""
    from scipy.linalg import expm  # slow to import, needed only where a loop is run

    n = b.size
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n], block[n, n + 1] = a, b, 1.0
    result = expm(block * time)
    return result[:n, :n], result[:n, n], result[:n, n + 1]
