"""Leakage of windows: the bias of a response from windows, by comparison with windows of another length.

The expectation of an estimate from Hann windows is the response averaged over the width of a line. The bias is
proportional to the response's curvature and to 1/T² for windows of length T (J. S. Bendat and A. G. Piersol, Random
Data, 4th ed. 2010, section 8.5, doi:10.1002/9781118032428): with D = Ĝ(T) - Ĝ(2T) it is 4/3 D for T and 1/3 D for 2T.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import SIGNIFICANCE, at_worst
from fraexp_plugins.estimators._shared.hann_windows import LINE_HALF_WIDTH, independent_windows, window_starts
from fraexp_plugins.estimators._shared.realisations import Group, Part, circular_covariance

DIFFERENCE_VARIANCE = 0.73
"""E|D|² by noise alone over the variance of Ĝ(T): Monte-Carlo, Hann windows with 50 % overlap. Half of it takes noise
for leakage."""
NEIGHBOURS = 2 * LINE_HALF_WIDTH - 1
"""Lines whose differences are averaged: a Hann window spreads a line over so many. They are correlated, so that each is
one degree of freedom. One line alone raises false alarms in 6 % of sound records instead of 1 %."""


class WindowedResponse(NamedTuple):
    """A response from windows."""

    response: NDArray[np.complex128]
    """Shape (n,)."""
    variance: NDArray[np.float64]
    """E|dG|² by noise, shape (n,)."""


def total_variance(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return E|dG|², shape (n,), of a covariance of both parts, shape (n, 2, 2)."""
    return np.asarray(covariance[:, 0, 0] + covariance[:, 1, 1])


Estimate = Callable[[int, NDArray[np.int64], int], WindowedResponse]
"""Returns the response from windows of so many samples at bins of a transform of so many samples."""


def with_leakage(
    part: Part,
    group: Group,
    channel: str,
    samples: int,
    bins: NDArray[np.int64],
    estimate: Estimate,
    is_inverse: bool = False,
) -> Part:
    """Return a response from windows of so many samples with its bias in the covariance, and a finding if it is large.

    `channel` tells how many windows are independent. The estimates are of the inverse response if that is the one
    whose denominator has no noise.
    """
    own = estimate(samples, bins, samples)
    if len(window_starts(group[0], 2 * samples)) > 1:
        short, ratio, variance = samples, 4 / 3, own.variance
        other = estimate(2 * samples, 2 * bins, 2 * samples)
    else:
        short, ratio = samples // 2, -1 / 3
        other = estimate(samples // 2, bins, samples)
        variance = np.where(bins < LINE_HALF_WIDTH, np.nan, other.variance)
    difference = own.response - other.response
    windows = independent_windows(group, channel, short)
    evidence = _evidence(np.abs(difference) ** 2, DIFFERENCE_VARIANCE * variance, windows)
    unbiased = own.response - ratio * difference
    return _with_bias(part, part.response - (1 / unbiased if is_inverse else unbiased), evidence)


class _Evidence(NamedTuple):
    """Where two lengths of windows differ by more than noise, each of shape (n,)."""

    is_likely: NDArray[np.bool_]
    """Where the difference is known, if the record leaks; nowhere in a record that need not."""
    is_significant: NDArray[np.bool_]
    """Where noise alone does not explain the difference."""
    excess: NDArray[np.float64]
    """The part of |D|² that noise does not explain, over |D|²."""


def _evidence(difference: NDArray[np.float64], expected: NDArray[np.float64], windows: float) -> _Evidence:
    """Return where |D|² is more than its expectation by noise, shape (n,) each, given so many independent windows."""
    from scipy.special import fdtri  # slow to import: listing plugins must stay fast

    known = np.isfinite(difference) & np.isfinite(expected) & (expected > 0)
    ratio = np.where(known, difference / np.where(known, expected, 1.0), 0.0)
    limit = fdtri(NEIGHBOURS, windows, 1 - SIGNIFICANCE / max(known.sum(), 1))
    is_significant = known & (_running_mean(ratio, NEIGHBOURS) > limit)
    return _Evidence(known & is_significant.any(), is_significant, 1 - 1 / np.maximum(ratio, 1.0))


def _running_mean(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the mean over so many neighbours, those at the ends like the next ones."""
    if values.size < count:
        return np.full(values.size, np.add.reduce(values) / values.size)
    means = np.add.reduce(np.lib.stride_tricks.sliding_window_view(values, count), axis=1) / count
    return np.pad(means, (count // 2, count - 1 - count // 2), mode="edge")


def _with_bias(part: Part, bias: NDArray[np.complex128], evidence: _Evidence) -> Part:
    """Return a response with a bias in the covariance where there is evidence of it, and a finding if it is large."""
    if not evidence.is_likely.any():
        return part
    square = np.where(evidence.is_likely, np.abs(bias) ** 2 * evidence.excess, 0.0)
    relative = np.sqrt(square) / np.abs(part.response - bias)
    covariance = part.covariance + circular_covariance(square)
    inflated = replace(part, covariance=covariance)
    affected = evidence.is_significant & (square > total_variance(part.covariance))
    if not affected.any():
        return inflated
    leak = at_worst("leakage", part.frequency, affected, relative, "response off by about")
    return replace(inflated, remarks=(leak,))
