"""What is learnt from signals: frequency responses with covariance, metrics, curves, and the outcome."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

HARMONICS = 7
"""Highest harmonic of the output that is kept with each frequency."""


class Outcome(Enum):
    """How a computation ended; the value is the remedy to show."""

    OK = ""
    NOT_SETTLED = "raise excitation.settle_limit, or loosen excitation.tolerance"
    NO_SIGNAL = "raise excitation.amplitude, or take a finer scale: where nothing moves nothing is learnt"
    DIVERGED = (
        "the loop is unstable, or excited beyond loop.stroke: lower the controller gain, the dead time or the amplitude"
    )
    FAILED = "see the message, and the log that fraexp show prints"


@dataclass(frozen=True)
class FrequencyResponse:
    """A complex response from one channel to another, with its covariance, frequency by frequency."""

    frequency: np.ndarray
    """Frequency [Hz], shape (n,)."""
    response: np.ndarray
    """Complex response [unit], shape (n,)."""
    covariance: np.ndarray
    """Covariance of (real, imaginary) part [unit²], shape (n, 2, 2); NaN where unknown."""
    unit: str
    """Unit of the response, such as ``m/N``."""
    input: str
    """Name of the input, such as ``u`` or ``u_e``."""
    output: str
    """Name of the output, such as ``y``."""
    input_amplitude: np.ndarray
    """Amplitude of the input [its unit], shape (n,)."""
    output_amplitude: np.ndarray
    """Amplitude of the output [its unit], shape (n,)."""
    settled: np.ndarray
    """Whether successive periods agreed, shape (n,) of bool."""
    settling_time: np.ndarray
    """Time until they did [s], shape (n,); NaN for a record that does not tell."""
    residual: np.ndarray
    """Relative difference of the last two periods compared, shape (n,); NaN where unknown."""
    harmonics: np.ndarray
    """Harmonics 2…7 of the output relative to its fundamental, complex, shape (n, 6)."""

    @property
    def standard_deviation(self) -> np.ndarray:
        """Standard deviation of the complex response [unit], shape (n,); NaN where unknown."""
        return np.sqrt(self.covariance[:, 0, 0] + self.covariance[:, 1, 1])

    @property
    def distortion(self) -> np.ndarray:
        """Total harmonic distortion of the output over the known harmonics 2…7, shape (n,); NaN where none is known."""
        known = np.isfinite(self.harmonics)
        total = np.sum(np.where(known, np.abs(self.harmonics), 0.0) ** 2, axis=1)
        return np.where(known.any(axis=1), np.sqrt(total), np.nan)


@dataclass(frozen=True)
class Metric:
    """One named number with its unit."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True)
class Curve:
    """Named columns of equal length, such as a hysteresis loop; the first one is the abscissa."""

    name: str
    columns: dict[str, np.ndarray]
    units: dict[str, str]


@dataclass(frozen=True)
class Result:
    """All that one sweep has taught."""

    outcome: Outcome
    message: str = ""
    """What exactly happened, in one line; empty when all is well."""
    response: FrequencyResponse | None = None
    metrics: tuple[Metric, ...] = ()
    curves: tuple[Curve, ...] = ()
    numerics: str = ""
    """How the signals were simulated, such as ``5 steps per sample, 8 lanes``; empty for measured ones."""
    elapsed: float = field(default=0.0, compare=False)
    """Computing time [s] of this sweep (its share, where sweeps share an experiment)."""
