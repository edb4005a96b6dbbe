"""The describing function of a friction model over amplitude and frequency."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Estimator, FrictionModel, Motion, Result

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
