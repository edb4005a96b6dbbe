"""What rounding adds to a position: the part that noise makes random, and the part that repeats in every period."""

import numpy as np
from numpy.typing import NDArray

ROUNDING_HARMONICS = 200
"""Terms of the Fourier series of the rounding error over one quantisation step."""
MIN_DITHER = 0.05
"""Noise in quantisation steps below which it does not act as dither."""
SIGNIFICANT_DITHER = 0.75
"""Noise in quantisation steps, times the order, from which dither removes a harmonic of the rounding error."""
BISECTIONS = 20
"""Halvings of an interval of noise."""


def repeated_rounding_variance(resolution: float, noise: float) -> float:
    """Return the variance [m²] of the rounding error that repeats with a motion, under normal noise [m].

    Without noise that is all of it, q²/12. Noise acts as dither: of the rounding error's sawtooth over the position
    the mean over noise keeps its k-th harmonic (q/πk) e^{-2(πkσ/q)²}. R. M. Gray and T. G. Stockham, Dithered
    quantizers, IEEE Trans. Inf. Theory 39(3), 1993, doi:10.1109/18.256489.
    """
    if not resolution:
        return 0.0
    if not noise:
        return resolution**2 / 12
    order = np.arange(1, ROUNDING_HARMONICS + 1)
    amplitudes = resolution / (np.pi * order) * np.exp(-2 * (np.pi * order * noise / resolution) ** 2)
    return float(np.add.reduce(amplitudes**2) / 2)


def mean_rounding_error(position: NDArray[np.float64], resolution: float, noise: float) -> NDArray[np.float64]:
    """Return the mean rounding error [m] at positions [m] of any shape, over normal noise [m]."""
    if not resolution:
        return np.zeros_like(position)
    if noise < MIN_DITHER * resolution:
        return np.round(position / resolution) * resolution - position
    error, turns = np.zeros_like(position), 2 * np.pi / resolution * position
    for order in range(1, int(SIGNIFICANT_DITHER * resolution / noise) + 1):
        damping = np.exp(-2 * (np.pi * order * noise / resolution) ** 2)
        error += (-1) ** order * resolution / (np.pi * order) * damping * np.sin(order * turns)
    return error


def noise_from_scatter(variance: float, resolution: float) -> float:
    """Return the noise [m] with which rounded positions scatter with this variance [m²] from period to period."""
    low, high = 0.0, np.sqrt(variance)  # rounding only adds to the scatter
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        rounding = resolution**2 / 12 - repeated_rounding_variance(resolution, middle)
        low, high = (middle, high) if middle**2 + rounding < variance else (low, middle)
    return float(low)
