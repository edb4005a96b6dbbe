"""Terms of a motion's Fourier series that noise and rounding partly hide: how large they are likely to be.

Terms that are left out are missing in the friction force, all in the same direction. So a weak term is estimated from
its own value and from what is likely beforehand, weighted by their variances (empirical Bayes: B. Efron and C. Morris,
Stein's estimation rule and its competitors, J. Am. Stat. Assoc. 68(341), 1973, doi:10.1080/01621459.1973.10481350).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

CLEAR_TERM_STDS = 3.0
"""Size of a term of the Fourier series, in standard deviations of its noise, from which all of it counts as motion."""
LEAST_ERROR = 0.1
"""Relative error of a term that friction predicts, at least: a measured term is never given up for it altogether."""
MIN_NEIGHBOURS = 4
"""Terms on either side from which the power of a weaker one is taken, at least."""
NEIGHBOUR_SHARE = 3
"""One of so many of the terms below it: the spectrum of a motion falls over a ratio of frequencies."""
MIN_POWER_STDS = 2.0
"""Mean power above that of noise, in standard deviations, from which it counts as motion."""


class LikelyTerms(NamedTuple):
    """What friction makes likely of each term, before it is measured, shape (terms,)."""

    mean: NDArray[np.complex128]
    """Its likely value [m]; 0 where friction does not predict it."""
    deviation: NDArray[np.float64]
    """Standard deviation of that [m], by an error that all terms have in common; NaN where friction does not predict
    it."""

    @property
    def variance(self) -> NDArray[np.float64]:
        """Variance of a term around its likely value, as one term alone may err [m²]."""
        return np.maximum(self.deviation, LEAST_ERROR * np.abs(self.mean)) ** 2

    @classmethod
    def unknown(cls, count: int) -> "LikelyTerms":
        """Return it for terms of which nothing is known beforehand."""
        return cls(np.zeros(count, dtype=complex), np.full(count, np.nan))


class EstimatedMotion(NamedTuple):
    """Terms of a motion, shape (..., terms)."""

    terms: NDArray[np.complex128]
    share: NDArray[np.float64]
    """Share of the measured value in each, 0 … 1: 1 for a clear term; their variance is share × scatter."""


def clear_terms(terms: NDArray[np.complex128], scatter: float) -> NDArray[np.bool_]:
    """Return whether terms stand out of a scatter of this variance, shape (..., terms)."""
    return np.asarray(np.abs(terms) ** 2 >= CLEAR_TERM_STDS**2 * scatter)


def estimate_motion(terms: NDArray[np.complex128], scatter: float, likely: LikelyTerms) -> EstimatedMotion:
    """Return the motion of measured terms, shape (..., terms), from what is likely of them beforehand."""
    predicted = likely.variance / (likely.variance + scatter)
    share = np.where(np.isnan(predicted), motion_shares(terms, scatter), predicted)
    return EstimatedMotion(likely.mean + share * (terms - likely.mean), share)


def likely_spread(
    likely: LikelyTerms, share: NDArray[np.float64], scatter: float, normal: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return deviations of possible motions from the estimated one, shape (draws, terms), from normal numbers.

    The first number of each draw, of the term that is constant, is the error of the plant: what it predicts errs alike
    at all terms.
    """
    own, predicted = np.sqrt(share * scatter) * normal, ~np.isnan(likely.deviation)
    mean, size = likely.mean[predicted], likely.deviation[predicted]
    common = (1 - share[predicted]) * size * mean / np.abs(mean) * normal[:, :1]
    own[:, predicted] = common + share[predicted] * np.sqrt(scatter) * normal[:, predicted]
    return np.asarray(own)


def motion_shares(terms: NDArray[np.complex128], scatter: float) -> NDArray[np.float64]:
    """Return the share of each term of Fourier series that is motion rather than scatter, 0 … 1, shape (..., terms).

    `scatter` is the variance of a term. A clear term is kept whole. A weaker one is shrunk by Wiener's v/(v + s): v is
    the mean power of its neighbours of the same parity less the scatter s, because the even terms of a motion that is
    odd about its middle vanish.
    """
    power = np.abs(terms) ** 2 / scatter
    share = np.ones(power.shape)
    for first in (1, 2):
        share[..., first::2] = _wiener_shares(power[..., first::2])
    return share


def _wiener_shares(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shares of terms from their power in units of the scatter, shape (..., terms)."""
    excess = np.minimum(power, CLEAR_TERM_STDS**2) - 1
    first, behind = _neighbours(np.arange(power.shape[-1]))
    sums = np.concatenate([np.zeros((*power.shape[:-1], 1)), np.cumsum(excess, axis=-1)], axis=-1)
    neighbours = behind - first
    mean = (sums[..., behind] - sums[..., first]) / neighbours
    likely = np.where(mean * np.sqrt(neighbours) > MIN_POWER_STDS, mean, 0.0)
    return np.where(power >= CLEAR_TERM_STDS**2, 1.0, likely / (likely + 1))


def _neighbours(number: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first one of the neighbours of each term, and the one behind the last."""
    reach = np.maximum(MIN_NEIGHBOURS, number // NEIGHBOUR_SHARE)
    return np.maximum(number - reach, 0), np.minimum(number + reach + 1, number.size)
