"""Fourier sums over periods, their means, and the covariance of a response that follows from their scatter."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.array_cache import cached_arrays
from fraexp.data.results import HARMONICS
from fraexp.data.signals import Segment

Number = TypeVar("Number", np.float64, np.complex128)
MAX_TABLE_SIZE = 1 << 14
"""Samples times lines up to which sums with tabulated waves are faster than a Fourier transform."""
MAX_TABLES_BYTES = 1 << 27
"""Memory of all tables: enough for a sweep of a thousand frequencies."""


@dataclass(frozen=True)
class PeriodicSpectrum:
    """Mean amplitude phasors of two channels at the excited lines, and the (co)variances of these means.

    A phasor X stands for the signal Re(X e^{jωt}). A variance is E|X - E X|², of both parts together; with one
    period it is NaN.
    """

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (lines,)."""
    input: NDArray[np.complex128]
    """Mean phasor U of the input [its unit], shape (lines,)."""
    output: NDArray[np.complex128]
    """Mean phasor Y of the output [its unit], shape (lines,)."""
    input_variance: NDArray[np.float64]
    """Variance of U [unit²], shape (lines,)."""
    output_variance: NDArray[np.float64]
    """Variance of Y [unit²], shape (lines,)."""
    covariance: NDArray[np.complex128]
    """Covariance E[(Y - E Y) conj(U - E U)], shape (lines,)."""


def phasors(segment: Segment, channel: str) -> NDArray[np.complex128]:
    """Return 2/N Σ x e^{-jωt} of each period at the excited lines [unit], shape (periods, lines)."""
    return _cached_sums(segment, channel, "phasors", segment.lines)


def line_amplitude(segment: Segment, channel: str) -> float:
    """Return the amplitude of a channel at the excited lines together: √Σ|X|² of the mean phasors [unit]."""
    return float(np.linalg.norm(phasors(segment, channel).mean(axis=0)))


def harmonic_phasors(segment: Segment, channel: str) -> NDArray[np.complex128]:
    """Return the phasors [unit] of each period at a single line and its harmonics below Nyquist, (periods, orders)."""
    highest = max((segment.samples - 1) // (2 * int(segment.lines[0])), 1)
    orders = np.arange(1, min(HARMONICS, highest) + 1)
    return _cached_sums(segment, channel, "harmonics", segment.lines[0] * orders)


def _cached_sums(segment: Segment, channel: str, name: str, lines: NDArray[np.int64]) -> NDArray[np.complex128]:
    """Return the Fourier sums of a channel; several estimators ask for those of the same segment."""
    sums = segment.cache.get((channel, name))
    if sums is None:
        sums = segment.cache[channel, name] = fourier_sums(segment.channels[channel], lines)
    return sums


def record_spectrum(segment: Segment, channel: str) -> NDArray[np.complex128]:
    """Return Σ x e^{-jωt} over all periods as one record of n samples, shape (n // 2 + 1,)."""
    spectrum = segment.cache.get((channel, "spectrum"))
    if spectrum is None:
        spectrum = segment.cache[channel, "spectrum"] = np.fft.rfft(segment.channels[channel].ravel())
    return spectrum


def fourier_sums(periods: NDArray[np.float64], lines: NDArray[np.int64]) -> NDArray[np.complex128]:
    """Return 2/N Σ x e^{-j2πkn/N} at lines k of periods of N samples, shape (periods, N), as shape (periods, lines)."""
    samples = periods.shape[1]
    if lines.size * samples > MAX_TABLE_SIZE:
        return np.fft.rfft(periods, axis=1)[:, lines] * (2 / samples)
    return (periods @ _wave_table(lines.tobytes(), samples)).view(complex)


@cached_arrays(MAX_TABLES_BYTES)
def _wave_table(lines: bytes, samples: int) -> NDArray[np.float64]:
    """Return 2/N cos and -2/N sin of each line, side by side, shape (samples, 2 lines).

    Many sweeps have the same lines, which are bytes here because a cache needs hashable arguments. Real waves make the
    sums real products, half the work of complex ones.
    """
    turns = np.arange(samples)[:, None] * np.frombuffer(lines, dtype=np.int64) % samples / samples
    return (2 / samples) * np.exp(-2j * np.pi * turns).view(float)


def mean_spectrum(
    frequency: NDArray[np.float64], u: NDArray[np.complex128], y: NDArray[np.complex128]
) -> PeriodicSpectrum:
    """Return means of phasors of input and output, (periods, lines) each, and (co)variances from their scatter.

    The variance of a mean over P periods is Σ|x_p - x̄|²/(P(P-1)): Pintelon and Schoukens, System Identification:
    A Frequency Domain Approach, 2nd ed. 2012, section 2.4, doi:10.1002/9781118287422.
    """
    du, dy = u - _mean(u), y - _mean(y)
    return PeriodicSpectrum(
        frequency=frequency,
        input=_mean(u),
        output=_mean(y),
        input_variance=_variance_of_mean(np.abs(du) ** 2),
        output_variance=_variance_of_mean(np.abs(dy) ** 2),
        covariance=_variance_of_mean(dy * np.conj(du)),
    )


def response_covariance(
    u: NDArray[np.complex128],
    y: NDArray[np.complex128],
    var_u: NDArray[np.float64],
    var_y: NDArray[np.float64],
    cov_yu: NDArray[np.complex128],
) -> NDArray[np.float64]:
    """Return the covariance of (real, imaginary) part of Y/U [unit²], shape (n, 2, 2), to first order.

    The error of G = Y/U is dG = (dY - G dU)/U, so E|dG|² = (σ_Y² + |G|² σ_U² - 2 Re(conj(G) σ_YU))/|U|²: the
    trace. Phasors of stationary noise are circular: both parts have half of it, and no covariance.
    """
    response = y / u
    spread = var_y + np.abs(response) ** 2 * var_u - 2 * np.real(np.conj(response) * cov_yu)
    variance = np.maximum(spread, 0.0) / np.abs(u) ** 2  # rounding may leave a tiny negative
    return variance[:, None, None] * (np.eye(2) / 2)


def _mean(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    # Summed row by row, in the order of the periods: bitwise reproducible on every machine.
    return np.add.reduce(values, axis=0) / len(values)


def _variance_of_mean(squares: NDArray[Number]) -> NDArray[Number]:
    """Return the (co)variance of a mean over periods, from the squares or products of deviations in each period."""
    periods = len(squares)
    if periods < 2:
        return np.full(squares.shape[1], np.nan, squares.dtype)
    return np.add.reduce(squares, axis=0) / (periods * (periods - 1))
