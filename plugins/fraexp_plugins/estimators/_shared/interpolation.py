"""Interpolation of a periodic record by its Fourier series."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import cached_arrays

MAX_TABULATED_SAMPLES = 4096
"""Samples of a record up to which the shifts of its Fourier series are cached: many sweeps share them."""
MAX_SHIFTS_BYTES = 1 << 25
"""Memory of all that are cached."""


def resample(bins: NDArray[np.complex128], samples: int, points: int) -> NDArray[np.float64]:
    """Return a Fourier series at `points` points per sample, shape (samples points,)."""
    if samples <= MAX_TABULATED_SAMPLES:  # `points` transforms of the record's own length, whose factors are small
        return np.fft.irfft(bins * _shifts(samples, points), samples, axis=1).T.ravel()
    if samples % 2 == 0:
        bins = np.append(bins[:-1], bins[-1] / 2)  # the Nyquist line counts twice
    return np.fft.irfft(bins, samples * points) * points


@cached_arrays(MAX_SHIFTS_BYTES)
def _shifts(samples: int, points: int) -> NDArray[np.complex128]:
    """Return the factors that shift a Fourier series by 0, 1/points… of a sample, shape (points, samples // 2 + 1)."""
    parts = np.arange(points)[:, None] / points
    return np.exp(2j * np.pi * parts * np.arange(samples // 2 + 1) / samples)
