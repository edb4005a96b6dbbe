"""The likelihood of rounded and noisy samples: how probable it is that noise takes a position into its interval."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MIN_CURVATURE = 1e-6
"""Least curvature of a sample's loss, in units of 1/σ²: inside its interval it has hardly any."""
FAR_OUT = -30.0
"""Standard deviations at which Φ is too small a number."""
LOG_NORMAL_PEAK = 0.5 * np.log(2 * np.pi)


class Loss(NamedTuple):
    """The negative logarithm of the likelihood of each sample, with its derivatives by the residual."""

    value: NDArray[np.float64]
    """Shape (n,)."""
    slope: NDArray[np.float64]
    """[1/m], shape (n,)."""
    curvature: NDArray[np.float64]
    """[1/m²], shape (n,)."""


def interval_loss(residual: NDArray[np.float64], resolution: float, std: float) -> Loss:
    """Return the loss of samples that were rounded to steps of `resolution` [m] after noise of `std` [m].

    `residual` is the rounded sample less the position [m], shape (n,). The likelihood of a sample is
    Φ((r + q/2)/σ) - Φ((r - q/2)/σ): that of Gaussian noise for q = 0, a box for σ = 0. It is log-concave.
    """
    if not resolution:
        scaled = residual / std
        return Loss(0.5 * scaled**2, scaled / std, np.full(residual.shape, 1 / std**2))
    # Both ends on the left tail, where Φ and its logarithm are exact.
    upper = (-np.abs(residual) + resolution / 2) / std
    lower = (-np.abs(residual) - resolution / 2) / std
    log_probability = _log_difference(upper, lower)
    at_upper = np.exp(-0.5 * upper**2 - LOG_NORMAL_PEAK - log_probability)
    at_lower = np.exp(-0.5 * lower**2 - LOG_NORMAL_PEAK - log_probability)
    rise = at_upper - at_lower
    curvature = rise**2 + upper * at_upper - lower * at_lower
    return Loss(-log_probability, np.sign(residual) * rise / std, np.maximum(curvature, MIN_CURVATURE) / std**2)


def _log_difference(upper: NDArray[np.float64], lower: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ln(Φ(upper) - Φ(lower)); logarithms of Φ take several times as long, and are needed far out only."""
    from scipy.special import log_ndtr, ndtr  # slow to import: listing plugins must stay fast

    if upper.min(initial=0.0) > FAR_OUT:
        return np.asarray(np.log(np.maximum(ndtr(upper) - ndtr(lower), 1e-300)))
    log_upper = log_ndtr(upper)
    return np.asarray(log_upper + np.log1p(-np.exp(np.minimum(log_ndtr(lower) - log_upper, -1e-300))))
