"""A machine with ideal Coulomb friction in its loop, event by event: it shares no code and no idea with the kernels.

Between events the machine is linear, sliding or stuck, and its motion is a Taylor series in time; an event is a root of
a polynomial: the velocity vanishes, or the force that holds the machine exceeds friction at rest.
"""

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

TERMS = 14
"""Terms of the series: at 0.5 ms and 500 rad/s the next one is 1e-18."""
ROOT_BRACKETS = 32
"""Parts of a sample in which a first root is sought."""


@dataclass(frozen=True)
class Guide:
    """Masses in parallel, the first one free, the others on springs; their displacements add up to the table's."""

    rigid_body_gain: float
    frequencies: tuple[float, ...]
    damping_ratios: tuple[float, ...]
    modal_gain_ratios: tuple[float, ...]
    coulomb_force: float
    viscous: float

    def sliding(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return A with viscous friction, b and the row of the velocity."""
        omega = 2 * np.pi * np.array([0.0, *self.frequencies])
        n = omega.size
        gains = self.rigid_body_gain * np.array([1.0, *self.modal_gain_ratios])
        velocity, b = np.r_[np.zeros(n), np.ones(n)], np.r_[np.zeros(n), gains]
        damping = np.diag(2 * np.array([0.0, *self.damping_ratios]) * omega)
        a = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega**2), -damping]])
        return a - self.viscous * np.outer(b, velocity), b, velocity


def simulate(
    guide: Guide,
    controller: tuple[NDArray[np.float64], NDArray[np.float64]],
    waveform: NDArray[np.float64],
    periods: int,
    sample_time: float,
    dead_samples: int,
    rest: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return displacement and control input of the last period, each of the waveform's shape.

    The thrust is late by whole samples and a rest [s].
    """
    a, b, velocity = guide.sliding()
    balance = velocity @ a / (velocity @ b)  # friction force over state that keeps the velocity
    stuck = a - np.outer(b, balance)
    numerator, denominator = controller
    x, way, inputs, memory = np.zeros(b.size), 0, [0.0] * (dead_samples + 2), np.zeros(numerator.size + 1)
    ys, us = [], []
    for excitation in np.tile(waveform, periods):
        y = x[: b.size // 2].sum()
        u = memory[0] - numerator[0] * y
        memory[:-2] = memory[1:-1] - numerator[1:] * y - denominator[1:] * u
        inputs = [u + excitation, *inputs[:-1]]
        ys.append(y)
        us.append(inputs[0])
        for thrust, seconds in ((inputs[-1], rest), (inputs[-2], sample_time - rest)):
            left = seconds
            while left > 1e-15:
                just_broken = False
                if way == 0 and abs(thrust + balance @ x) <= guide.coulomb_force:
                    series = _series(stuck, x, 0 * b)
                    held = series @ balance
                    held[0] += thrust
                    bound = np.zeros(TERMS)
                    bound[0] = guide.coulomb_force
                    until = min(_first_root(bound - held, 0.0, left), _first_root(bound + held, 0.0, left))
                    x, left = _at(series, until), left - until
                    if left <= 1e-15:
                        break
                if way == 0:
                    way, just_broken = (1 if thrust + balance @ x > 0 else -1), True
                series = _series(a, x, b * (thrust - way * guide.coulomb_force))
                until = _first_root(way * (series @ velocity), 1e-12 if just_broken else 0.0, left)
                x, left = _at(series, until), left - until
                if left > 1e-15:
                    x, way = x - b * (velocity @ x) / (velocity @ b), 0
    samples = waveform.size
    return np.array(ys[-samples:]), np.array(us[-samples:])


def _series(a: NDArray[np.float64], x: NDArray[np.float64], drive: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Taylor series of the state under ẋ = a x + drive, shape (TERMS, n)."""
    derivatives = [x, a @ x + drive]
    for _ in range(TERMS - 2):
        derivatives.append(a @ derivatives[-1])
    return np.array(derivatives) / np.array([[factorial(k)] for k in range(TERMS)])


def _at(series: NDArray[np.float64], time: float) -> NDArray[np.float64]:
    return np.asarray(time ** np.arange(TERMS) @ series)


def _first_root(series: NDArray[np.float64], begin: float, end: float) -> float:
    """Return the first time at which a series falls below 0; `end` if it does not."""
    times = np.linspace(begin, end, ROOT_BRACKETS + 1)
    below = np.flatnonzero(np.polynomial.polynomial.polyval(times, series) < 0)
    if not below.size:
        return end
    if below[0] == 0:
        return float(times[0])
    low, high, function = times[below[0] - 1], times[below[0]], Polynomial(series)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if function(middle) < 0 else (middle, high)
    return float(high)
