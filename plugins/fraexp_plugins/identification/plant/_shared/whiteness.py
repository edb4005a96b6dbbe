"""Whether residuals along the frequencies are uncorrelated."""

import numpy as np
from numpy.typing import NDArray

MAX_LAGS = 10


def whiteness(residuals: NDArray[np.float64], parts: int) -> float:
    """Return the probability that white residuals are as correlated as these or more: small for a wrong model.

    `residuals` holds n real parts, and n imaginary ones if there are two parts. The portmanteau statistic
    n(n + 2) Σ |ρ_k|²/(n - k) over the first lags, doubled for circular complex residuals, is χ² distributed with one
    degree of freedom for each lag and part: G. M. Ljung and G. E. P. Box, Biometrika 65(2), 1978,
    doi 10.1093/biomet/65.2.297.
    """
    from scipy.special import chdtrc  # slow to import: only when something is estimated

    values = _as_sequence(residuals, parts)
    n = values.size
    power = float(np.sum(np.abs(values) ** 2))
    lags = min(MAX_LAGS, n // 4)
    if power == 0 or lags == 0:
        return float("nan")
    statistic = 0.0
    for lag in range(1, lags + 1):
        correlation = np.sum(values[lag:] * np.conj(values[:-lag])) / power
        statistic += abs(correlation) ** 2 / (n - lag)
    return float(chdtrc(parts * lags, parts * n * (n + 2) * statistic))


def neighbour_correlation(residuals: NDArray[np.float64], parts: int) -> tuple[float, float]:
    """Return the correlation of neighbouring residuals, and the probability of this or a larger one if they are white.

    The correlation of n white residuals is normally distributed with the variance 1/(parts n).
    """
    from scipy.special import ndtr

    values = _as_sequence(residuals, parts)
    power = float(np.sum(np.abs(values) ** 2))
    if power == 0:
        return 0.0, 1.0
    correlation = float(np.sum((values[1:] * np.conj(values[:-1])).real)) / power
    return correlation, float(ndtr(-correlation * np.sqrt(parts * values.size)))


def _as_sequence(residuals: NDArray[np.float64], parts: int) -> NDArray[np.float64]:
    rows = residuals.reshape(parts, -1)
    return rows[0] + 1j * rows[1] if parts == 2 else rows[0]
