"""The describing function of a friction model over amplitude and frequency, and the limit cycles it predicts."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Estimator, FrictionModel, Motion, Result
from fraexp_plugins.tuning._shared.gain_search import LoopFamily

POINTS = 256
"""Points of the sine along which a law is driven."""
PROBE_FREQUENCIES = 14
"""Frequencies at which a law is driven; between them the describing function is interpolated."""


def known_friction(method: Estimator, found: Result) -> FrictionModel | None:
    """Return the friction model that a method identified, or the one that it uses; None if it knows none."""
    fit = next((fit for fit in found.fits if fit.kind == FrictionModel.kind), None)
    if fit is None:
        used = getattr(method, "friction", None)
        return used if isinstance(used, FrictionModel) else None
    law = next(each for each in _subclasses(FrictionModel) if each.name == fit.component["name"])
    return law.parse({key: value for key, value in fit.component.items() if key not in ("name", "version")}, "friction")


def _subclasses(base: type[FrictionModel]) -> Iterator[type[FrictionModel]]:
    for each in base.__subclasses__():
        yield each
        yield from _subclasses(each)


@dataclass(frozen=True)
class FrictionGain:
    """N(A, ω) + jω Dv [N/m]: fundamental of the friction force over that of a sine of the displacement."""

    amplitudes: NDArray[np.float64]
    """Amplitudes of the displacement [m], ascending, shape (a,)."""
    frequencies: NDArray[np.float64]
    """Frequencies of the table [Hz], ascending, shape (f,)."""
    table: NDArray[np.complex128]
    """N [N/m], shape (f, a)."""
    viscous: float
    """Dv [N s/m]."""

    @classmethod
    def from_model(
        cls, friction: FrictionModel | None, amplitudes: NDArray[np.float64], low: float, high: float
    ) -> "FrictionGain":
        """Return the describing function of a model between two frequencies [Hz]; 0 without a model."""
        if friction is None:
            return cls(np.ones(1), np.array([low, high]), np.zeros((2, 1), dtype=complex), 0.0)
        frequencies = np.geomspace(low, high, PROBE_FREQUENCIES)
        angle = 2 * np.pi * np.arange(POINTS) / POINTS
        motions = [
            Motion(amplitude * np.cos(angle), 1 / (frequency * POINTS), True)
            for frequency in frequencies
            for amplitude in amplitudes
        ]
        forces = np.array(friction.forces(motions)).reshape(frequencies.size, amplitudes.size, POINTS)
        table = 2 / POINTS * (forces @ np.exp(-1j * angle)) / amplitudes
        return cls(amplitudes, frequencies, table, friction.viscous)

    def gain_at(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return N + jω Dv [N/m] at frequencies [Hz], shape (n, a)."""
        place = np.interp(np.log(frequency), np.log(self.frequencies), np.arange(self.frequencies.size))
        below = np.minimum(place.astype(int), self.frequencies.size - 2)
        share = (place - below)[:, None]
        law = (1 - share) * self.table[below] + share * self.table[below + 1]
        return np.asarray(law + 2j * np.pi * frequency[:, None] * self.viscous)

    def between(self, frequency: float, log_amplitude: float) -> complex:
        """Return N + jω Dv [N/m] at a frequency [Hz] and the logarithm of an amplitude."""
        row = self.gain_at(np.array([frequency]))[0]
        logs = np.log(self.amplitudes)
        return complex(np.interp(log_amplitude, logs, row.real) + 1j * np.interp(log_amplitude, logs, row.imag))


NEAR_ZERO = 0.5
"""Relative size of the loop's sum at a grid point from which a zero nearby is looked for."""
DERIVATIVE_STEP = 1e-3
"""Relative step of frequency and amplitude by which the sum's derivatives are found."""
ZERO_TOLERANCE = 1e-6
"""Relative size of the sum at a zero."""


@dataclass(frozen=True)
class LimitCycle:
    """A sustained oscillation of the displacement."""

    amplitude: float
    """Amplitude [m]."""
    frequency: float
    """Frequency [Hz]."""
    is_stable: bool
    """Whether the loop returns to it; if not, it grows from above and decays from below."""


def limit_cycles(family: LoopFamily, friction: FrictionGain, control: NDArray[np.complex128]) -> list[LimitCycle]:
    """Return the limit cycles of the nominal plant, by frequency: 1/P + N(A, ω) + C G = 0.

    J. M. Loeb's criterion says which are stable (A. Gelb and W. E. Vander Velde, Multiple-Input Describing Functions,
    1968, section 3.3).
    """
    linear = 1 / family.band.nominal + control
    total = linear[:, None] + family.friction
    size = np.abs(linear)[:, None] + np.abs(family.friction)
    relative = np.abs(total) / size
    found: list[LimitCycle] = []
    for row, column in _minima(relative):
        cycle = _solve(family.band.frequency, linear, friction, row, column)
        if cycle and not any(_is_same(cycle, other) for other in found):
            found.append(cycle)
    return sorted(found, key=lambda cycle: cycle.frequency)


def _minima(values: NDArray[np.float64]) -> Iterator[tuple[int, int]]:
    """Yield the places inside of a grid that are no greater than their neighbours, and small."""
    inner = values[1:-1, 1:-1]
    around = [
        values[1 + i : values.shape[0] - 1 + i, 1 + j : values.shape[1] - 1 + j]
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        if i or j
    ]
    is_least = np.logical_and.reduce([inner <= other for other in around]) & (inner < NEAR_ZERO)
    for row, column in np.argwhere(is_least):
        yield int(row) + 1, int(column) + 1


def _solve(
    frequency: NDArray[np.float64], linear: NDArray[np.complex128], friction: FrictionGain, row: int, column: int
) -> LimitCycle | None:
    """Return the limit cycle near a place of the grid, or None if there is none."""
    from scipy.optimize import root

    logs = np.log(frequency)
    scale = abs(linear[row]) + abs(friction.between(frequency[row], np.log(friction.amplitudes[column])))

    def total(point: NDArray[np.float64]) -> complex:
        here = complex(np.interp(point[0], logs, linear.real) + 1j * np.interp(point[0], logs, linear.imag))
        return here + friction.between(float(np.exp(point[0])), float(point[1]))

    def parts(point: NDArray[np.float64]) -> NDArray[np.float64]:
        value = total(point) / scale
        return np.array([value.real, value.imag])

    start = np.array([logs[row], np.log(friction.amplitudes[column])])
    solution = root(parts, start, method="hybr")
    point = solution.x
    bounds = (logs[0], logs[-1]), (np.log(friction.amplitudes[0]), np.log(friction.amplitudes[-1]))
    is_inside = all(low < value < high for value, (low, high) in zip(point, bounds, strict=True))
    if not is_inside or np.hypot(*parts(point)) > ZERO_TOLERANCE:
        return None
    by_frequency, by_amplitude = (total(point + step) - total(point - step) for step in DERIVATIVE_STEP * np.eye(2))
    # a change of amplitude moves the root s = σ + jω of the sum by dσ = Im(∂N/∂A / ∂F/∂ω) dA
    return LimitCycle(float(np.exp(point[1])), float(np.exp(point[0])), (by_amplitude / by_frequency).imag < 0)


def _is_same(first: LimitCycle, second: LimitCycle) -> bool:
    return bool(np.allclose([first.amplitude, first.frequency], [second.amplitude, second.frequency], rtol=1e-3))
