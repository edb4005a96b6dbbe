"""The loop's linear part over one sample, exactly: any dead time, first-order lags, friction linear in the step."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fraexp.components.kinds import FrictionModel, StateSpace
from fraexp.errors import ParameterError

TAYLOR_TERMS = 16
"""Terms of e^M for a norm of a half: the next one is 1e-20."""
TIME_DIGITS = 15
"""Decimals [s] to which two instants of a sample are the same."""
Path = tuple[float, tuple[float, ...]]
"""Dead time [s] and time constants of first-order lags [s]."""


class Discrete(NamedTuple):
    """The loop over one sample of m steps: n states, two input values, m + 1 friction forces."""

    displacement: np.ndarray
    """Rows that give the displacement at each step's end from state and inputs, shape (m, n + 2)."""
    compliance: np.ndarray
    """Displacement at each step's end that the forces at the steps' bounds take away, shape (m, m + 1)."""
    measured: np.ndarray
    """Row that gives the next measured position from state, inputs and forces, shape (n + m + 3,)."""
    transition: np.ndarray
    """Rows that give the next state from state, inputs and forces, shape (n, n + m + 3)."""
    numerator: np.ndarray
    """C(z) in ascending powers of z⁻¹ [N/m], shape (p,)."""
    denominator: np.ndarray
    """Ascending powers of z⁻¹, starting with 1, shape (p,)."""

    @property
    def constants(self) -> tuple[np.ndarray, ...]:
        """What the kernel multiplies with: for each step's displacement, the next measurement and the next state.

        Known before the sample is run are state, inputs and the first force: their rows; then what the forces in the
        sample add to displacements, shape (m, m), and to measurement and state, shape (n + 1, m); then C(z).
        """
        known = self.displacement.shape[1] + 1
        after = np.vstack([self.measured, self.transition])
        before = np.hstack([self.displacement, -self.compliance[:, :1]])
        matrix = np.vstack([before, after[:, :known]])
        return matrix, -self.compliance[:, 1:], after[:, known:], self.numerator, self.denominator

    @property
    def gain(self) -> float:
        """Displacement at a step's end that the force there takes away [m/N]."""
        return float(self.compliance[0, 1])


def discretise(
    plant: StateSpace,
    friction: FrictionModel,
    controller: tuple[np.ndarray, np.ndarray],
    *,
    sample_time: float,
    steps: int,
    input_path: Path,
    output_path: Path,
) -> Discrete:
    """Return the constants of the loop."""
    a, drive, force, displacement, measured = _with_lags(plant, friction.viscous, input_path[1], output_path[1])
    n, step = a.shape[0], sample_time / steps
    late_in, late_out = split(input_path[0], sample_time)[1], split(output_path[0], sample_time)[1]

    instants = [bound * step for bound in range(steps + 1)]
    reached = [*instants[1:], sample_time - late_out]
    times = sorted({_rounded(time - since) for time in reached for since in (0.0, late_in, *instants)})
    responses = zip(*_integrals(a, np.column_stack([drive, force]), times), strict=True)
    known = dict(zip(times, responses, strict=True))

    def after(time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return known[_rounded(time)]

    def columns(time: float) -> np.ndarray:
        """State after `time` in the sample, from its begin's state, two inputs and all forces, (n, n + 3 + steps)."""
        effect = np.zeros((n, n + 3 + steps))
        transition, held, _ = after(time)
        later = after(time - late_in)[1]
        effect[:, :n], effect[:, n], effect[:, n + 1] = transition, held[:, 0] - later[:, 0], later[:, 0]
        for j in range(steps):  # the force goes from one bound's value to the next one's, then has no effect of its own
            _, held_begin, ramp_begin = after(time - j * step)
            _, held_end, ramp_end = after(time - (j + 1) * step)
            rising = (ramp_begin - ramp_end) / step - held_end
            effect[:, n + 2 + j] -= (held_begin - held_end - rising)[:, 1]
            effect[:, n + 3 + j] -= rising[:, 1]
        return effect

    ends = np.array([displacement @ columns((j + 1) * step) for j in range(steps)])
    size = max(controller[0].size, controller[1].size)
    numerator, denominator = (np.concatenate([c, np.zeros(size - c.size)]) for c in controller)
    return Discrete(
        displacement=ends[:, : n + 2],
        compliance=-ends[:, n + 2 :],
        measured=measured @ columns(sample_time - late_out),  # the instant whose position is sampled next
        transition=columns(sample_time),
        numerator=numerator,
        denominator=denominator,
    )


def split(dead_time: float, sample_time: float) -> tuple[int, float]:
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


def _rounded(time: float) -> float:
    """Return a time of 0 s at least, such that the same instant reached in another way is the same number."""
    return max(round(time, TIME_DIGITS), 0.0)


def _integrals(a: np.ndarray, b: np.ndarray, times: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return e^(at), and the responses to a unit step and a unit ramp of each input (Van Loan, 1978), at times [s].

    Their shapes are (times, n, n), (times, n, inputs) and (times, n, inputs).
    """
    n, inputs = b.shape
    block = np.zeros((n + 2 * inputs, n + 2 * inputs))
    block[:n, :n], block[:n, n : n + inputs], block[n : n + inputs, n + inputs :] = a, b, np.eye(inputs)
    result = _exponentials(block * np.array(times)[:, None, None])
    return result[:, :n, :n], result[:, :n, n : n + inputs], result[:, :n, n + inputs :]


def _exponentials(matrices: np.ndarray) -> np.ndarray:
    """Return e^M of each matrix by scaling, Taylor's series and squaring, shape (count, n, n).

    As exact as scipy's for these matrices, all at once, and without its fifth of a second of import.
    """
    norm = max(float(np.abs(matrices).sum(axis=1).max()), 1e-300)
    squarings = max(0, int(np.ceil(np.log2(norm))) + 1)
    scaled = matrices / 2.0**squarings
    term = result = np.broadcast_to(np.eye(matrices.shape[1]), matrices.shape)
    for order in range(1, TAYLOR_TERMS + 1):
        term = term @ scaled / order
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result
