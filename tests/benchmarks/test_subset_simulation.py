"""Rare events whose probability is known in closed form."""

import numpy as np
import pytest
import subset_simulation
from scipy.stats import chi2, norm

pytestmark = pytest.mark.thorough
SIZE, REPEATS, DIMENSION = 1000, 20, 60
BLOCKS = np.array([np.ones(DIMENSION), np.arange(DIMENSION) < 40, np.arange(DIMENSION) >= 40], dtype=bool)


def estimates(score, threshold):
    """Return the probability of exceeding a threshold that each repeat finds."""
    found = []
    for seed in range(REPEATS):
        levels = list(subset_simulation.climb(score, np.random.default_rng(seed), SIZE, BLOCKS, 8))
        found.append(subset_simulation.exceedance(levels, threshold))
    return np.array(found)


def holds(found, truth):
    """Return whether the mean is the truth within three standard errors, and half of the repeats are not far off.

    The estimate is right in the mean, but its distribution is wide to the upper side: one in twenty is ten times high.
    """
    error = found.std(ddof=1) / np.sqrt(found.size)
    return abs(found.mean() - truth) < 3 * error and 0.4 * truth < np.median(found) < 1.5 * truth


def test_a_sum_exceeds_what_one_in_ten_million_does():
    found = estimates(lambda x: x.sum() / np.sqrt(DIMENSION), norm.isf(1e-7))
    assert holds(found, 1e-7), found


def test_two_separate_ways_to_exceed_add_up():
    """The radius in two coordinates of different blocks, where one direction must not be lost for the other."""
    found = estimates(lambda x: np.hypot(x[0], x[-1]), np.sqrt(chi2.isf(1e-7, 2)))
    assert holds(found, 1e-7), found


def test_what_cannot_be_drawn_is_drawn_again():
    """A half of all coordinates draws nothing: the probability is twice as great among the others."""
    found = estimates(lambda x: x[1] if x[0] * x[1] > 0 else np.nan, norm.isf(1e-6))
    assert holds(found, 1e-6), found


def test_scores_that_many_share_are_counted_once():
    """A fifth of all samples has the same score, where a level would begin; above it lies the tail of a Gaussian."""
    shared = norm.isf(0.2)
    found = estimates(lambda x: max(x[0], shared), norm.isf(1e-6))
    assert holds(found, 1e-6), found


def test_nothing_lies_above_the_greatest_score():
    levels = list(subset_simulation.climb(lambda x: float(x[0] > 0), np.random.default_rng(1), 100, BLOCKS, 8))
    assert len(levels) == 2
    assert subset_simulation.exceedance(levels, 1.0) == 0
