"""Spectra averaged over periods, with the scatter of the periods carried to the covariance of a response."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fraexp.data.results import HARMONICS
from fraexp.data.signals import Segment

FEW = 1 << 14
"""Samples times lines up to which sums over tabulated waves are faster than a Fourier transform."""


@dataclass(frozen=True)
class PeriodicSpectrum:
    """Mean amplitude phasors of two channels at the excited lines, and the (co)variances of these means.

    A phasor X stands for the signal Re(X e^{jωt}). A variance is E|X - E X|², of both parts together; with one
    period it is NaN.
    """

    frequency: np.ndarray
    """Frequency [Hz], shape (lines,)."""
    input: np.ndarray
    """Mean phasor U of the input [its unit], complex, shape (lines,)."""
    output: np.ndarray
    """Mean phasor Y of the output [its unit], complex, shape (lines,)."""
    var_input: np.ndarray
    """Variance of U [unit²], shape (lines,)."""
    var_output: np.ndarray
    """Variance of Y [unit²], shape (lines,)."""
    cov: np.ndarray
    """Covariance E[(Y - E Y) conj(U - E U)], complex, shape (lines,)."""


def phasors(segment: Segment, channel: str) -> np.ndarray:
    """Return 2/N Σ x e^{-jωt} of each period at the excited lines [unit], complex, shape (periods, lines)."""
    return _kept_sums(segment, channel, "phasors", segment.lines)


def harmonic_phasors(segment: Segment, channel: str) -> np.ndarray:
    """Return the phasors of each period at a single line and its harmonics 2… below Nyquist [unit], complex."""
    highest = max((segment.samples - 1) // (2 * int(segment.lines[0])), 1)
    orders = np.arange(1, min(HARMONICS, highest) + 1)
    return _kept_sums(segment, channel, "harmonics", segment.lines[0] * orders)


def _kept_sums(segment: Segment, channel: str, what: str, lines: np.ndarray) -> np.ndarray:
    found = segment.cache.get((channel, what))
    if found is None:
        found = segment.cache[channel, what] = fourier_sums(segment.channels[channel], lines)
    return found


def spectrum_of(segment: Segment, channel: str) -> np.ndarray:
    """Return Σ x e^{-jωt} over all periods as one record of n samples, complex, shape (n // 2 + 1,)."""
    found = segment.cache.get((channel, "spectrum"))
    if found is None:
        found = segment.cache[channel, "spectrum"] = np.fft.rfft(segment.channels[channel].ravel())
    return found


def fourier_sums(periods: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Return 2/N Σ x e^{-j2πkn/N} at lines k of periods of N samples, shape (periods, N), as shape (periods, lines)."""
    samples = periods.shape[1]
    if lines.size * samples > FEW:
        return np.fft.rfft(periods, axis=1)[:, lines] * (2 / samples)
    return (periods @ _waves(lines.tobytes(), samples)).view(complex)


@lru_cache(1024)
def _waves(lines: bytes, samples: int) -> np.ndarray:
    """Return 2/N cos and -2/N sin of each line, side by side, shape (samples, 2 lines): many sweeps have the same."""
    turns = np.arange(samples)[:, None] * np.frombuffer(lines, dtype=np.int64) % samples / samples
    return (2 / samples) * np.exp(-2j * np.pi * turns).view(float)


def periodic_spectrum(segment: Segment, input_channel: str, output_channel: str) -> PeriodicSpectrum:
    """Return mean phasors of two channels of a segment and their (co)variances from the scatter of its periods.

    The variance of a mean over P periods is Σ|x_p - x̄|²/(P(P-1)): Pintelon and Schoukens, System Identification:
    A Frequency Domain Approach, 2nd ed. 2012, section 2.4, doi:10.1002/9781118287422.
    """
    return spectrum(segment.frequency, phasors(segment, input_channel), phasors(segment, output_channel))


def spectrum(frequency: np.ndarray, u: np.ndarray, y: np.ndarray) -> PeriodicSpectrum:
    """Return the means over periods of the phasors of input and output, complex, each of shape (periods, lines)."""
    du, dy = u - _mean(u), y - _mean(y)
    return PeriodicSpectrum(
        frequency=frequency,
        input=_mean(u),
        output=_mean(y),
        var_input=_of_mean(np.abs(du) ** 2),
        var_output=_of_mean(np.abs(dy) ** 2),
        cov=_of_mean(dy * np.conj(du)),
    )


def response_covariance(
    u: np.ndarray, y: np.ndarray, var_u: np.ndarray, var_y: np.ndarray, cov_yu: np.ndarray
) -> np.ndarray:
    """Return the covariance of (real, imaginary) part of Y/U [unit²], shape (n, 2, 2), to first order.

    The error of G = Y/U is dG = (dY - G dU)/U, so E|dG|² = (σ_Y² + |G|² σ_U² - 2 Re(conj(G) σ_YU))/|U|²: the
    trace. Phasors of stationary noise are circular: both parts have half of it, and no covariance.
    """
    response = y / u
    spread = var_y + np.abs(response) ** 2 * var_u - 2 * np.real(np.conj(response) * cov_yu)
    variance = np.maximum(spread, 0.0) / np.abs(u) ** 2  # rounding may leave a tiny negative
    return variance[:, None, None] * (np.eye(2) / 2)


def _mean(values: np.ndarray) -> np.ndarray:
    # Summed row by row, in the order of the periods: the same bits everywhere.
    return np.add.reduce(values, axis=0) / len(values)


def _of_mean(squares: np.ndarray) -> np.ndarray:
    periods = len(squares)
    if periods < 2:
        return np.full(squares.shape[1], np.nan, squares.dtype)
    return np.add.reduce(squares, axis=0) / (periods * (periods - 1))
