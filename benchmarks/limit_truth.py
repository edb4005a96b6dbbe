"""A fast fine simulation of plays on a machine: what they truly ask of it, between the samples too.

It shares no code with fraexp, only the matrices of `reference_loop` and the Coulomb law of `reference_laws`, which do
not either. Several plays on one machine go side by side, as lanes of each array. The plant is propagated exactly for a
held input; friction acts by its mean over the step, at a displacement that is predicted and corrected once.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from reference_laws import BRISTLE, COULOMB, ELEMENTS, coulomb_force
from reference_loop import FINE_CLOCK, ReferenceMachine
from scipy.linalg import expm

LANES = 128
STEPS = 10
"""Steps per sample; dead times must be multiples of them."""
SILENCE_S = 1.0
"""Time after a play in which the machine is still watched."""
DEMANDS = ("stroke", "velocity", "acceleration", "force", "force_rate")
"""Columns of what is returned. An acceleration is that between three samples: at once, Coulomb friction has none."""


class FinePlay(NamedTuple):
    """An excitation as it is played, and stopped."""

    waveform: NDArray[np.float64]
    rise: float
    """Rise of the amplitude per sample; 0 for all of it at once."""
    stop: int
    """Sample at which the ramp out begins."""
    ramp_out: int
    """Samples of the ramp out."""


class FineEncoder(NamedTuple):
    """Errors of the measured position."""

    resolution: float
    noise: NDArray[np.float64]
    """Noise [m], from which each play takes a part; its size is a power of two."""


def simulate_plays(machine: ReferenceMachine, plays: Sequence[FinePlay], encoder: FineEncoder) -> NDArray[np.float64]:
    """Return what each play asks of the machine, shape (plays, 5)."""
    arguments = _arguments(machine)
    quiet = math.ceil(SILENCE_S / machine.sample_time)
    found = np.empty((len(plays), len(DEMANDS)))
    order = np.argsort([play.stop + play.ramp_out for play in plays], kind="stable")
    for first in range(0, len(plays), LANES):
        chosen = order[first : first + LANES]
        lanes = [plays[k] for k in np.resize(chosen, LANES)]
        samples = max(play.stop + play.ramp_out for play in lanes) + quiet
        waves = np.concatenate([play.waveform for play in lanes])
        sizes = np.array([play.waveform.size for play in lanes])
        starts = np.cumsum(sizes) - sizes
        rises = np.array([play.rise or np.inf for play in lanes])
        stops, ramps = (np.array([play[k] for play in lanes]) for k in (2, 3))
        shifts = 7919 * np.arange(first, first + LANES)
        out = np.zeros((len(DEMANDS), LANES))
        _run(samples, waves, starts, sizes, rises, stops, ramps, shifts, *encoder, *arguments, out)
        found[chosen] = out.T[: chosen.size]
    return found


def _arguments(machine: ReferenceMachine) -> tuple[object, ...]:
    a, drive, force, row, measured = machine.matrices()
    h, n = machine.sample_time / STEPS, a.shape[0]
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n], block[:n, n + 1] = a, drive, force
    result = expm(block * h)
    kp, ti, td, tf = machine.pid
    ts = machine.sample_time
    controller = (kp, kp * ts / (2 * ti) if ti else 0.0, 2 * kp * td / (2 * tf + ts), (2 * tf - ts) / (2 * tf + ts))
    late = tuple(count * STEPS // FINE_CLOCK for count in machine.dead_times)
    assert [count * FINE_CLOCK // STEPS for count in late] == list(machine.dead_times)
    phi, thrust, held = np.ascontiguousarray(result[:n, :n]), result[:n, n].copy(), result[:n, n + 1].copy()
    states = max(machine.states, 1)
    parameters = np.array(machine.parameters, dtype=float)
    return phi, thrust, held, row, measured, row @ a, h, ts, machine.law, parameters, states, late, controller


@njit(fastmath=True, error_model="numpy")
def _elements(z, dy, parameters, force, z_next):
    """Springs that slide at a width: the mean of the force at both ends of the step."""
    force[:] = 0.0
    for i in range(parameters.size // 3):
        half, width = 0.5 * parameters[3 * i], parameters[3 * i + 2]
        for lane in range(LANES):
            end = min(max(z[i, lane] + dy[lane], -width), width)
            z_next[i, lane] = end
            force[lane] += half * (z[i, lane] + end)


@njit(fastmath=True, error_model="numpy")
def _bristle(z, dy, h, parameters, force, z_next):
    """A bristle that yields exponentially to its sliding deflection; the exact solution for a steady velocity."""
    stiffness, damping, coulomb, static, velocity, _ = parameters
    for lane in range(LANES):
        path, speed = abs(dy[lane]), abs(dy[lane]) / h
        steady = (coulomb + (static - coulomb) * math.exp(-((speed / velocity) ** 2))) / stiffness
        limit = math.copysign(steady, dy[lane])
        end = limit + (z[0, lane] - limit) * math.exp(-path / steady)
        z_next[0, lane] = end
        force[lane] = 0.5 * stiffness * (z[0, lane] + end) + damping * (end - z[0, lane]) / h


@njit(error_model="numpy")
def _coulomb(z, x, free, velocity_row, velocity_gain, parameters, force, z_next):
    before, after = np.zeros(1), np.zeros(1)
    for lane in range(LANES):
        now = then = 0.0
        for i in range(velocity_row.size):
            now += velocity_row[i] * x[i, lane]
            then += velocity_row[i] * free[i, lane]
        before[0] = z[0, lane]
        force[lane] = coulomb_force(before, now, then, velocity_gain, parameters, after)
        z_next[0, lane] = after[0]


@njit(fastmath=True, error_model="numpy")
def _product(row, columns, out):
    out[:] = 0.0
    for i in range(row.size):
        for lane in range(LANES):
            out[lane] += row[i] * columns[i, lane]


@njit(fastmath=True, error_model="numpy")
def _run(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917
    samples, waves, starts, sizes, rises, stops, ramps, shifts, resolution, noise,
    phi, thrust, held, row, measured, velocity_row, h, ts, law, parameters, states, late, controller, out,
):  # fmt: skip
    """Run plays side by side; `out` takes what they ask for, shape (5, lanes)."""
    n, (kp, ki, kd, pole) = phi.shape[0], controller
    gain, velocity_gain = 0.0, 0.0
    for i in range(n):
        gain += row[i] * held[i]
        velocity_gain += velocity_row[i] * held[i]
    x, free = np.zeros((n, LANES)), np.zeros((n, LANES))
    z, z_next = np.zeros((states, LANES)), np.zeros((states, LANES))
    if law == COULOMB:
        z[:] = 1.0
    depth, length = late[0] // STEPS + 3, late[1] + STEPS + 2
    inputs, positions = np.zeros((depth, LANES)), np.zeros((length, LANES))
    integral, filtered, error, u = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    place, velocity, dy, force = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    low, high, before, earlier = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    without, moved, arrived = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    for sample in range(samples):
        now = sample * STEPS
        for lane in range(LANES):
            y = positions[(now - late[1]) % length, lane] if now >= late[1] else 0.0
            y += noise[(sample + shifts[lane]) & (noise.size - 1)]
            if resolution > 0.0:
                y = resolution * math.floor(y / resolution + 0.5)
            last, error[lane] = error[lane], -y
            integral[lane] += ki * (error[lane] + last)
            filtered[lane] = pole * filtered[lane] + kd * (error[lane] - last)
            size = 1.0 if rises[lane] > 1.0 else min(1.0, rises[lane] * sample)
            if sample >= stops[lane]:
                size *= max(1.0 - (sample - stops[lane] + 1) / ramps[lane], 0.0)
            asked = kp * error[lane] + integral[lane] + filtered[lane]
            asked += size * waves[starts[lane] + sample % sizes[lane]]
            out[3, lane] = max(out[3, lane], abs(asked))
            if sample:
                out[4, lane] = max(out[4, lane], abs(asked - u[lane]) / ts)
                bend = abs(place[lane] - 2.0 * before[lane] + earlier[lane]) / ts**2
                out[2, lane] = max(out[2, lane], bend)
            earlier[lane], before[lane] = before[lane], place[lane]
            u[lane] = asked
            inputs[sample % depth, lane] = asked
        for step in range(STEPS):
            sent = (now + step - late[0]) // STEPS
            for lane in range(LANES):
                arrived[lane] = inputs[sent % depth, lane] if sent >= 0 else 0.0
            for i in range(n):
                for lane in range(LANES):
                    free[i, lane] = thrust[i] * arrived[lane]
                for j in range(n):
                    for lane in range(LANES):
                        free[i, lane] += phi[i, j] * x[j, lane]
            if law == COULOMB:
                _coulomb(z, x, free, velocity_row, velocity_gain, parameters, force, z_next)
            elif law in (ELEMENTS, BRISTLE):
                _product(row, free, without)
                for lane in range(LANES):
                    without[lane] -= place[lane]
                for _ in range(2):
                    for lane in range(LANES):
                        dy[lane] = without[lane] - gain * force[lane]
                    if law == ELEMENTS:
                        _elements(z, dy, parameters, force, z_next)
                    else:
                        _bristle(z, dy, h, parameters, force, z_next)
            for i in range(n):
                for lane in range(LANES):
                    x[i, lane] = free[i, lane] - held[i] * force[lane]
            z[:] = z_next
            _product(row, x, place)
            _product(velocity_row, x, velocity)
            _product(measured, x, moved)
            for lane in range(LANES):
                low[lane], high[lane] = min(low[lane], place[lane]), max(high[lane], place[lane])
                out[1, lane] = max(out[1, lane], abs(velocity[lane]))
                positions[(now + step + 1) % length, lane] = moved[lane]
    for lane in range(LANES):
        out[0, lane] = high[lane] - low[lane]
