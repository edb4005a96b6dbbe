"""A fine simulation of the sampled loop that shares neither code nor idea with fraexp's, and knows its own error.

The plant between two instants of a fine clock is propagated exactly for a held input; friction acts on it by its mean
over the step (`reference_laws`), which is found together with the displacement at the step's end. That is of second
order, for damped elements too. Two step sizes give the error and, by Richardson's extrapolation, a better number.
Dead times are whole steps of the fine clock. Excitation, ramp and loop are those of the experiment; the motion is
followed from rest until it repeats itself.
"""

import math
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numba import njit
from numpy.typing import NDArray
from reference_laws import COULOMB, coulomb_force, mean_force
from scipy.linalg import expm

FINE_CLOCK = 20
"""Steps per sample of the coarsest clock: dead times are multiples of Ts/FINE_CLOCK."""
RAMP_S = 0.1
"""Time over which the excitation's amplitude rises."""
PERIODIC = 2e-6
"""Relative distance to the limit at which the response counts as periodic."""
MIN_WINDOW_S = 0.25
"""Shortest window that is compared with the one before."""


@dataclass(frozen=True)
class ReferenceMachine:
    """Everything that the fine simulation needs, as plain numbers in SI units."""

    gain: float
    modes: tuple[tuple[float, float, float], ...]
    """Frequency [Hz], damping ratio and relative gain of each."""
    viscous: float
    law: int
    parameters: tuple[float, ...]
    states: int
    pid: tuple[float, float, float, float]
    """Kp, Ti, Td, Tf."""
    sample_time: float
    dead_times: tuple[int, int]
    """Of input and output, in units of Ts/FINE_CLOCK."""
    lags: tuple[tuple[float, ...], tuple[float, ...]]
    """Of input and output [s]."""
    spring: float = 0.0
    """Stiffness of a linear spring to ground [N/m]: the stuck machine, linearised."""

    def matrices(self) -> tuple[NDArray[np.float64], ...]:
        """Return A, columns of thrust and friction force, and rows of displacement and measurement."""
        lags_in, lags_out = self.lags
        n, p = 2 + 2 * len(self.modes), len(lags_in)
        size = n + p + len(lags_out)
        a, force, row = np.zeros((size, size)), np.zeros(size), np.zeros(size)
        for i, (frequency, ratio, gain) in enumerate(((0.0, 0.0, 1.0), *self.modes)):
            omega = 2 * math.pi * frequency
            a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[0, 1], [-(omega**2), -2 * ratio * omega]]
            force[2 * i + 1], row[2 * i] = 1.0, self.gain * gain
        a -= np.outer(force, self.viscous * (row @ a) + self.spring * row)
        for i, lag in enumerate(lags_in):  # the control input drives the first one, the last one the plant
            a[n + i, n + i] -= 1 / lag
            if i:
                a[n + i, n + i - 1] += 1 / lag
        drive = force.copy()
        if lags_in:
            a[:, n + p - 1] += force
            drive = np.eye(size)[n] / lags_in[0]
        measured = row.copy()
        for i, lag in enumerate(lags_out):
            a[n + p + i] += measured / lag
            a[n + p + i, n + p + i] -= 1 / lag
            measured = np.eye(size)[n + p + i]
        return a, drive, force, row, measured

    def plant(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return P(jω) [m/N], without viscous friction."""
        s = 2j * math.pi * frequency
        total = 1 / s**2
        for natural, ratio, gain in self.modes:
            omega = 2 * math.pi * natural
            total = total + gain / (s**2 + 2 * ratio * omega * s + omega**2)
        return self.gain * total


@dataclass(frozen=True)
class ReferenceResponse:
    """y'/u of the fine simulation at one frequency."""

    value: complex
    error: float
    """Relative error that the two step sizes show, before extrapolation."""
    spread: float
    """Relative spread over the last half of the simulated time: more than PERIODIC if it is not periodic."""


@njit
def _sum(row, column):
    total = 0.0
    for i in range(row.size):
        total += row[i] * column[i]
    return total


@njit
def _solve(kind, z, start, free, gain, h, parameters, z_next):
    """Return the mean force f with dy = free - gain f(dy): secants from `start` within a bracket."""
    low, high = -np.inf, np.inf
    dy, last, last_residual, force = start, 0.0, 0.0, 0.0
    for count in range(80):
        force = mean_force(kind, z, dy, h, parameters, z_next)
        residual = dy - free + gain * force
        if abs(residual) <= 1e-13 * abs(dy) + 1e-22:
            break
        if residual > 0.0:
            high = dy
        else:
            low = dy
        slope = 1.0
        if count > 0 and dy != last:
            slope = max((residual - last_residual) / (dy - last), 1.0)
        last, last_residual = dy, residual
        dy = dy - residual / slope
        if not low < dy < high:
            dy = 0.5 * (low + high)
            if dy in (low, high):
                break
    return force


@njit
def _advance(  # noqa: PLR0913, PLR0917
    samples, age, steps, h, phi, thrust, held, row, measured, velocity_row, kind, parameters, x, z, dead_times,
    thrusts, positions, memory, controller, wave, rise, out_u, out_y,
):  # fmt: skip
    """Run samples of the loop; `x`, `z`, the delays' buffers and the controller's memory go on where they stood."""
    kp, ki, kd, pole = controller
    gain, velocity_gain = _sum(row, held), _sum(velocity_row, held)
    free, z_next, depth, late, last_dy = np.empty(x.size), z.copy(), thrusts.size, positions.size, 0.0
    for sample in range(samples):
        number = age + sample
        now = number * steps
        y = positions[(now - dead_times[1]) % late] if now >= dead_times[1] else 0.0
        error = -y
        memory[0] += ki * (error + memory[1])  # integral, bilinear
        memory[2] = pole * memory[2] + kd * (error - memory[1])  # filtered derivative, bilinear
        memory[1] = error
        u = kp * error + memory[0] + memory[2] + min(1.0, rise * number) * wave[number % wave.size]
        thrusts[number % depth] = u
        out_u[sample], out_y[sample] = u, y
        for step in range(steps):
            arrived = (now + step - dead_times[0]) // steps
            force_in = thrusts[arrived % depth] if arrived >= 0 else 0.0
            for i in range(x.size):
                free[i] = _sum(phi[i], x) + thrust[i] * force_in
            if kind == COULOMB:
                friction = coulomb_force(
                    z, _sum(velocity_row, x), _sum(velocity_row, free), velocity_gain, parameters, z_next
                )
            elif kind == 0:
                friction = 0.0
            else:
                place = _sum(row, x)
                without = _sum(row, free) - place
                friction = _solve(kind, z, last_dy, without, gain, h, parameters, z_next)
                last_dy = without - gain * friction
            for i in range(x.size):
                x[i] = free[i] - held[i] * friction
            z[:] = z_next
            positions[(now + step + 1) % late] = _sum(measured, x)


class ReferenceRun:
    """One frequency on one machine, simulated from rest with a number of steps per sample."""

    def __init__(self, machine: ReferenceMachine, frequency: float, amplitude: float, steps: int) -> None:
        a, drive, force, row, measured = machine.matrices()
        h, n = machine.sample_time / steps, a.shape[0]
        block = np.zeros((n + 2, n + 2))
        block[:n, :n], block[:n, n], block[:n, n + 1] = a, drive, force
        result = expm(block * h)
        cycles = Fraction(frequency * machine.sample_time).limit_denominator(70_000)
        self.block = cycles.denominator
        self.line = cycles.numerator
        phase = 2 * math.pi * (self.line * np.arange(self.block) % self.block) / self.block
        scale = steps // FINE_CLOCK
        dead_times = (machine.dead_times[0] * scale, machine.dead_times[1] * scale)
        kp, ti, td, tf = machine.pid
        ts = machine.sample_time
        self.state = np.zeros(n)
        controller = (kp, kp * ts / (2 * ti) if ti else 0.0, 2 * kp * td / (2 * tf + ts), (2 * tf - ts) / (2 * tf + ts))
        self.arguments = (
            steps, h, np.ascontiguousarray(result[:n, :n]), result[:n, n].copy(), result[:n, n + 1].copy(), row,
            measured, row @ a, machine.law, np.array(machine.parameters, dtype=float), self.state,
            np.ones(1) if machine.law == COULOMB else np.zeros(machine.states + 1), dead_times,
            np.zeros(dead_times[0] // steps + 3), np.zeros(dead_times[1] + steps + 3), np.zeros(3), controller,
            amplitude * np.sin(phase), ts / RAMP_S,
        )  # fmt: skip
        self.age, self.sample_time = 0, ts

    def advance(self, samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return control input and measured position of the next samples."""
        u, y = np.empty(samples), np.empty(samples)
        _advance(samples, self.age, *self.arguments, u, y)
        self.age += samples
        return u, y

    def window(self, blocks: int) -> complex:
        """Return y'/u over the next blocks of whole periods."""
        u, y = (np.fft.rfft(each)[self.line * blocks] for each in self.advance(blocks * self.block))
        return complex(y / u)

    def periodic_response(self, limit: float) -> tuple[complex, float]:
        """Return y'/u once it is periodic, or at `limit` [s], with its relative spread over the last half of the time.

        Two windows that agree are not enough: a slow beat or a creeping mean turns round somewhere.
        """
        blocks = max(1, math.ceil(MIN_WINDOW_S / (self.block * self.sample_time)))
        self.advance(math.ceil(RAMP_S / self.sample_time / self.block) * self.block)
        values: list[complex] = []
        while self.age * self.sample_time < limit:
            values.append(self.window(blocks))
            if len(values) >= 8 and _spread(values) < PERIODIC:
                break
        return values[-1], _spread(values)


def _spread(values: list[complex]) -> float:
    """Return how far the later half of a sequence is from its last value, relative to that."""
    late = np.array(values[len(values) // 2 :])
    return float(np.max(np.abs(late - late[-1])) / max(abs(late[-1]), 1e-300))


def reference_response(
    machine: ReferenceMachine, frequency: float, amplitude: float, goal: float, limit: float = 30.0, most: int = 320
) -> ReferenceResponse:
    """Return y'/u by Richardson's extrapolation, with steps halved until the last two agree within `goal`."""
    steps = 2 * FINE_CLOCK
    run = ReferenceRun(machine, frequency, amplitude, steps)
    coarse, spread = run.periodic_response(limit)
    if spread > 10 * goal:  # nothing to be exact about
        return ReferenceResponse(coarse, spread, spread)
    while True:
        steps *= 2
        run = ReferenceRun(machine, frequency, amplitude, steps)
        fine, spread = run.periodic_response(limit)
        error = abs(fine - coarse) / (3 * max(abs(fine), 1e-300))
        if error < goal or steps >= most or spread > goal:
            return ReferenceResponse(fine + (fine - coarse) / 3, error, spread)
        coarse = fine


def is_stable(machine: ReferenceMachine, stiffness: float) -> bool:
    """Return whether the linear loop, held by a spring [N/m], forgets a push within seconds."""
    held = replace(machine, law=0, parameters=(), spring=stiffness)
    run = ReferenceRun(held, 1.0, 0.0, FINE_CLOCK)
    run.state[:] = machine.matrices()[2]  # a push
    seconds = round(1.0 / machine.sample_time)
    first = np.abs(run.advance(seconds)[1]).max()
    run.advance(2 * seconds)
    return bool(np.abs(run.advance(seconds)[1]).max() < 0.3 * first)
