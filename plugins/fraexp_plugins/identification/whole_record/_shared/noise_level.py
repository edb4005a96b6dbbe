"""The encoder's noise: as scatter and spectrum of the records show it, and as residuals make it likely."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Signals
from fraexp_plugins.identification.whole_record._shared.joint_fit import LinearRecord, interval_loss

NOISE = "noise"
"""Name of the noise among the free parameters."""
MIN_SAMPLES = 64
"""Samples of a period from which its upper half of the spectrum has no harmonics of friction to speak of."""
MIN_NOISE_RATIO, MAX_NOISE_RATIO = 1e-3, 3.0
"""Least noise that is looked for over the greatest one, and that one over the residual."""
LOG_DIFFERENCE = 0.05
"""Half width of the second difference by the logarithm of the noise."""


def noise_in_records(signals: Signals, output: str, resolution: float) -> float:
    """Return the standard deviation of the noise [m] besides rounding.

    It is that of the scatter over the periods; of single periods, that of the upper half of their spectrum.
    """
    known = [each for each in (_variance(segment.channels[output]) for segment in signals.segments) if each is not None]
    return float(np.sqrt(max(np.median(known) - resolution**2 / 12, 0.0))) if known else 0.0


def _variance(periods: NDArray[np.float64]) -> float | None:
    """Return the mean variance over the periods, shape (periods, n), or that of white noise in one; None if unknown."""
    if len(periods) > 1:
        return float(np.mean(np.var(periods - periods.mean(axis=1, keepdims=True), axis=0, ddof=1)))
    size = periods.shape[1]
    if size < MIN_SAMPLES:
        return None
    power = np.abs(np.fft.rfft(periods[0])[size // 4 : size // 2]) ** 2 / size
    return float(np.median(power) / np.log(2))  # the median of an exponential distribution over its mean


class NoiseLevel(NamedTuple):
    """An estimate of the noise."""

    value: float
    """Standard deviation of the noise [m]."""
    std: float
    """Standard deviation of the estimate [m]."""
    log_likelihood: float
    """Log-likelihood per sample."""


def likely_noise(records: Sequence[LinearRecord], freedom: float) -> NoiseLevel:
    """Return the noise with which residuals are most likely, given the degrees of freedom that a fit left of them."""
    from scipy.optimize import minimize_scalar  # slow to import: only where the noise is free

    residual = np.concatenate([record.residual for record in records])
    largest = MAX_NOISE_RATIO * float(np.sqrt(np.mean(residual**2)))

    # A density has the standard deviation in its denominator, the probability of an interval has not.
    densities = 0 if records[0].resolution else residual.size

    def loss(log: float) -> float:
        values = interval_loss(residual, records[0].resolution, largest * float(np.exp(log))).value
        return float(values.sum()) + densities * log

    found = minimize_scalar(loss, bounds=(np.log(MIN_NOISE_RATIO), 0.0), method="bounded", options={"xatol": 1e-4})
    log = float(found.x)
    curvature = (loss(log + LOG_DIFFERENCE) - 2 * loss(log) + loss(log - LOG_DIFFERENCE)) / LOG_DIFFERENCE**2
    value = largest * float(np.exp(log)) * float(np.sqrt(residual.size / freedom))
    std = value / float(np.sqrt(curvature)) if curvature > 0 else np.inf
    return NoiseLevel(value, std, -float(found.fun) / residual.size)
