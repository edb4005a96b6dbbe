"""What the tests of excitations measure."""

import numpy as np

from fraexp.components.periods import Period

TS = 500e-6
"""Sample time [s]."""


def amplitudes(period: Period) -> np.ndarray:
    """Return the amplitude of each harmonic of a waveform, shape (samples // 2 + 1,)."""
    return np.abs(np.fft.rfft(period.waveform)) * 2 / period.waveform.size


def others(period: Period) -> np.ndarray:
    """Return the amplitudes of the harmonics that are no lines."""
    return np.delete(amplitudes(period), period.lines)


def crest_factor(period: Period) -> float:
    """Return peak over root mean square."""
    return float(np.abs(period.waveform).max() / np.sqrt(np.mean(period.waveform**2)))
