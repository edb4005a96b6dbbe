"""The loop's linear part over one sample, exactly: any dead time, first-order lags, friction linear in the step."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.components.ports import Ports

TAYLOR_TERMS = 16
"""Terms of the series of e^M where the norm of M is a half or less: the next one is 1e-20."""
NEGLIGIBLE_STEP = 1e-3
"""Part of a step below which it does not matter on which side of a bound the thrust jumps."""
TIME_DIGITS = 15
"""Decimals [s] to which two instants of a sample are the same."""


ControllerCoefficients = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Numerator and denominator in ascending powers of z⁻¹, shape (order,) each."""


class SignalPath(NamedTuple):
    """What delays a signal between controller and plant."""

    dead_time: float
    """Dead time [s]."""
    lags: tuple[float, ...]
    """Time constants of first-order lags [s]."""


class DiscreteLoop(NamedTuple):
    """The loop over one sample of m steps: n states, two values of each of t inputs, c contacts with m + 1 forces each.

    Displacements and forces of a step stand together, those of the contacts one after another. At a contact whose
    friction is a law of velocity the rows of the displacement at each step's end, and what forces take away there, are
    those of the velocity; each force is held over the step that ends with it, and the first has no effect.
    """

    displacement: NDArray[np.float64]
    """Rows that give the displacements at each step's end from state and inputs, shape (m c, n + 2 t)."""
    compliance: NDArray[np.float64]
    """Displacements at each step's end that the forces at the steps' bounds take away [m/N], shape (m c, (m + 1) c)."""
    measured: NDArray[np.float64]
    """Rows that give the next measured positions from state, inputs and forces, shape (p, n + 2 t + (m + 1) c)."""
    transition: NDArray[np.float64]
    """Rows that give the next state from state, inputs and forces, shape (n, n + 2 t + (m + 1) c)."""
    contacts: int
    """Number c of contacts."""
    numerator: NDArray[np.float64]
    """C(z) of each thrust in ascending powers of z⁻¹ [N/m], shape (t, order)."""
    denominator: NDArray[np.float64]
    """Ascending powers of z⁻¹, starting with 1, shape (t, order)."""
    present: NDArray[np.float64]
    """Rows that give the present displacements from the state, shape (c, n); empty, (0, n), if contacts hold them."""
    durations: NDArray[np.float64]
    """Duration of each step [s], shape (m,)."""

    @property
    def constants(self) -> tuple[NDArray[np.float64], ...]:
        """Constants of the kernel: three matrices, durations of the steps, then numerator and denominator of C(z).

        State, inputs and the first force are known before the sample is run: the first matrix gives what they
        contribute to each step's displacements, the next measurements and the next state, shape
        (m c + p + n, n + 2 t + c). The others give what the forces within the sample add to displacements, shape
        (m c, m c), and to measurements and state, shape (p + n, m c).
        """
        known = self.displacement.shape[1] + self.contacts
        after = np.vstack([self.measured, self.transition])
        before = np.hstack([self.displacement, -self.compliance[:, : self.contacts]])
        present = np.hstack([self.present, np.zeros((len(self.present), 2 * self.thrusts + self.contacts))])
        matrix = np.vstack([before, after[:, :known], present])
        compliance, responses = -self.compliance[:, self.contacts :], after[:, known:]
        return matrix, compliance, responses, self.durations, self.numerator, self.denominator

    @property
    def positions(self) -> int:
        """Number p of measured positions, one for each thrust first, which is fed back to it."""
        return int(self.measured.shape[0])

    @property
    def thrusts(self) -> int:
        """Number t of thrusts that have a controller; the first is excited."""
        return int(self.numerator.shape[0])

    @property
    def steps(self) -> int:
        """Steps per sample."""
        return int(self.compliance.shape[0]) // self.contacts

    @property
    def sample_compliance(self) -> list[float]:
        """Displacement of each contact [m/N] after a sample from rest by the excited thrust, size c."""
        states = self.transition.shape[0]
        rows = self.present @ self.transition if self.present.size else self.displacement[-self.contacts :]
        return np.abs(rows[:, states : states + 2].sum(axis=1)).tolist()

    @property
    def step_compliance(self) -> NDArray[np.float64]:
        """Displacements at a step's end that the forces there take away [m/N], shape (c, c)."""
        return self.compliance[: self.contacts, self.contacts : 2 * self.contacts]


def discretise(
    plant: Ports,
    viscous: Mapping[str, float],
    controllers: Sequence[ControllerCoefficients],
    *,
    sample_time: float,
    steps: int,
    is_force_held: tuple[bool, ...],
    input_path: SignalPath,
    output_path: SignalPath,
) -> DiscreteLoop:
    """Return the constants of the loops that the plant's first thrusts and first positions close, one per controller.

    `viscous` has the viscous coefficient [N s/m] of each contact, and `is_force_held` says of each whether its friction
    is a law of velocity. Raises ParameterError for a plant whose velocity
    jumps with a force.
    """
    part = _join_lags(plant, viscous, len(controllers), input_path.lags, output_path.lags)
    n, contacts, is_held = part.a.shape[0], part.force.shape[1], np.array(is_force_held)
    thrusts = len(controllers)
    first_force = n + 2 * thrusts
    late_in = split_dead_time(input_path.dead_time, sample_time).rest
    late_out = split_dead_time(output_path.dead_time, sample_time).rest

    # All instants at which the state is needed, and all from which an input acts: each difference is computed once.
    starts = step_bounds(sample_time, steps, late_in if is_held.any() else 0.0)
    durations = np.diff(starts) if is_held.any() else np.full(steps, sample_time / steps)
    instants = [*starts[1:], sample_time - late_out]
    times = sorted({_round_time(time - since) for time in instants for since in (0.0, late_in, *starts)})
    responses = zip(*_integrals(part.a, np.column_stack([part.drive, part.force]), times), strict=True)
    response_at = {time: _Responses(*response) for time, response in zip(times, responses, strict=True)}

    @cache
    def force_effects(begin: float, end: float, step: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the effect of a step's forces at its two bounds, which were `begin` and `end` ago, shape (n, c) each.

        The force goes from one bound's value to the next one's, then has no effect of its own.
        """
        (_, held_begin, ramp_begin), (_, held_end, ramp_end) = response_at[begin], response_at[end]
        held = (held_begin - held_end)[:, thrusts:]
        rising = np.where(is_held, held, ((ramp_begin - ramp_end) / step - held_end)[:, thrusts:])
        return held - rising, rising

    def effects_at(time: float) -> NDArray[np.float64]:
        """Return what states, two values of each input and all forces contribute to the state at `time`.

        Its shape is (n, n + 2 thrusts + contacts (steps + 1)).
        """
        effect = np.zeros((n, first_force + contacts * (steps + 1)))
        transition, held, _ = response_at[_round_time(time)]
        later = response_at[_round_time(time - late_in)].step
        effect[:, :n], drives = transition, slice(0, thrusts)
        effect[:, n:first_force:2], effect[:, n + 1 : first_force : 2] = (held - later)[:, drives], later[:, drives]
        forces = effect[:, first_force:].reshape(n, steps + 1, contacts)
        since = [_round_time(time - start) for start in starts]
        for j in range(steps):
            if since[j] > 0:  # the steps after it have no effect yet
                at_begin, at_end = force_effects(since[j], since[j + 1], float(durations[j]))
                forces[:, j] -= at_begin
                forces[:, j + 1] -= at_end
        return effect

    velocities = part.displacement @ part.a  # as c·b = 0
    rows = np.where(is_held[:, None], velocities, part.displacement)
    ends = np.concatenate([rows @ effects_at(end) for end in starts[1:]])
    size = max(coefficients.size for controller in controllers for coefficients in controller)
    padded = [[np.concatenate([c, np.zeros(size - c.size)]) for c in controller] for controller in controllers]
    numerator, denominator = map(np.array, zip(*padded, strict=True))
    return DiscreteLoop(
        displacement=ends[:, :first_force],
        compliance=-ends[:, first_force:],
        measured=part.measured @ effects_at(sample_time - late_out),  # the instant whose positions are sampled next
        transition=effects_at(sample_time),
        contacts=contacts,
        numerator=numerator,
        denominator=denominator,
        present=part.displacement if is_held.any() else np.empty((0, n)),
        durations=durations,
    )


def step_bounds(sample_time: float, steps: int, jump: float) -> list[float]:
    """Return the instants of a sample that bound its steps [s], steps + 1 of them.

    The steps are equal, unless the thrust jumps within the sample, at `jump` [s], and a law is solved for stick and
    slip: that takes the thrust of a step for constant, and would break away at the wrong time, by as much as a step.
    The jump then bounds a step, and the steps on either side of it are equal.
    """
    before = min(max(round(steps * jump / sample_time), 1), steps - 1)
    shortest = NEGLIGIBLE_STEP * sample_time / steps
    if not before or not shortest < jump < sample_time - shortest:
        return [number * (sample_time / steps) for number in range(steps + 1)]
    first, second = jump / before, (sample_time - jump) / (steps - before)
    return [number * first for number in range(before)] + [
        jump + number * second for number in range(steps - before + 1)
    ]


class DeadTime(NamedTuple):
    """A dead time, split at the sample time."""

    samples: int
    """Whole samples."""
    rest: float
    """What is left of it [s]."""


def split_dead_time(dead_time: float, sample_time: float) -> DeadTime:
    """Return a dead time as whole samples and a rest; a rest that is rounding alone counts as none."""
    samples = int(np.floor(dead_time / sample_time + 1e-9))
    return DeadTime(samples, max(dead_time - samples * sample_time, 0.0))


class _LinearPart(NamedTuple):
    """Plant and lags in one state space, with n states in all."""

    a: NDArray[np.float64]
    """State matrix, shape (n, n)."""
    drive: NDArray[np.float64]
    """Columns of the control inputs, shape (n, thrusts)."""
    force: NDArray[np.float64]
    """Columns of the contacts' friction forces, shape (n, contacts)."""
    displacement: NDArray[np.float64]
    """Rows of the contacts' displacements, shape (contacts, n)."""
    measured: NDArray[np.float64]
    """Rows of the measured positions, those which are fed back first, shape (positions, n)."""


def _join_lags(
    plant: Ports, viscous: Mapping[str, float], thrusts: int, lags_in: tuple[float, ...], lags_out: tuple[float, ...]
) -> _LinearPart:
    """Return plant, viscous friction and lags in one state space.

    Viscous friction is linear and therefore part of a; the velocity is d·a·x, as d·b = 0 for a relative degree of 2.
    """
    plant.check()
    positions = plant.measured
    n, p, q, count = plant.a.shape[0], len(lags_in), len(lags_out), len(positions)
    size = n + p * thrusts + q * count
    a, drive = np.zeros((size, size)), np.zeros((size, thrusts))
    force, displacement = np.zeros((size, len(plant.contacts))), np.zeros((len(plant.contacts), size))
    a[:n, :n] = plant.a
    for k, (name, contact) in enumerate(plant.contacts.items()):
        a[:n, :n] -= viscous[name] * np.outer(contact.force, contact.displacement @ plant.a)
        force[:n, k], displacement[k, :n] = contact.force, contact.displacement
    for k, column in enumerate(list(plant.thrusts.values())[:thrusts]):
        first = n + k * p
        for i, constant in enumerate(lags_in, first):
            a[i, i] = -1 / constant
            if i > first:
                a[i, i - 1] = 1 / constant
        if p:
            a[:n, first + p - 1] = column
            drive[first, k] = 1 / lags_in[0]
        else:
            drive[:n, k] = column
    measured = np.zeros((count, size))
    measured[:, :n] = positions
    for i, constant in enumerate(lags_out):
        first = n + p * thrusts + i * count
        states = range(first, first + count)
        a[first : first + count] += measured / constant
        a[states, states] -= 1 / constant
        measured = np.eye(size)[first : first + count]
    return _LinearPart(a, drive, force, displacement, measured)


def _round_time(time: float) -> float:
    """Return a time, 0 s or later, rounded such that one instant is one number however it was computed."""
    return max(round(time, TIME_DIGITS), 0.0)


class _Responses(NamedTuple):
    """How a state responds, at one time or, with a leading axis, at several."""

    transition: NDArray[np.float64]
    """e^(at), shape (n, n)."""
    step: NDArray[np.float64]
    """Response to a unit step of each input, shape (n, inputs)."""
    ramp: NDArray[np.float64]
    """Response to a unit ramp of each input, shape (n, inputs)."""


def _integrals(a: NDArray[np.float64], b: NDArray[np.float64], times: Sequence[float]) -> _Responses:
    """Return the responses at times [s], each with a leading axis of times: C. F. Van Loan, IEEE TAC 23, 1978."""
    n, inputs = b.shape
    block = np.zeros((n + 2 * inputs, n + 2 * inputs))
    block[:n, :n], block[:n, n : n + inputs], block[n : n + inputs, n + inputs :] = a, b, np.eye(inputs)
    result = _exponentials(block * np.array(times)[:, None, None])
    return _Responses(result[:, :n, :n], result[:, :n, n : n + inputs], result[:, :n, n + inputs :])


def _exponentials(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return e^M of each matrix by scaling, Taylor's series and squaring, shape (count, n, n).

    For these matrices it is as exact as scipy's function, takes all of them at once, and saves the fifth of a second
    that scipy takes to be imported.
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
