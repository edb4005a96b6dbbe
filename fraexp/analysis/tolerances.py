"""What is told from nothing: the significance of a test, the size of a rounding error, and the steps of a search."""

from statistics import NormalDist

import numpy as np

SIGNIFICANCE = 0.01
"""Probability with which chance alone passes for an effect, in a test, over all of its trials: the usual level. Half of
it makes the limits of a χ² or F test some 5 to 10 % larger, and those in standard deviations 2.8 for 2.6."""
ROUNDING = float(np.sqrt(np.finfo(float).eps))
"""Relative size, 1.5e-8, below which a number is an error of the computation: half of a double's digits, as a square or
a difference has. Half of it changes nothing but what is as small."""
DIFFERENCE = float(np.cbrt(np.finfo(float).eps))
"""Relative half width, 6e-6, of central differences of a function that is smooth: their error by curvature and that by
rounding are equal. Half of it doubles the latter."""
COARSE_DIFFERENCE = 1e-3
"""The same of a function of motions, whose events make it rough below some 1e-4. Half of it doubles the roughness in a
derivative."""
MAX_ITERATIONS = 50
"""Bound of the steps of a search that ends by its own rule after some five to twenty: it only ends one that creeps, and
half of it changes no result."""
CONVERGED = 1e-3
"""Relative change of an estimate, or gain of a log-likelihood, with which a search ends: far below what scatter makes
of it. Half of it takes a step or two more."""
CURVE_POINTS = 400
"""Points of a curve that is drawn: enough for a resonance with 1 % damping. Its modes are points of their own; half
of it shows the flanks of such a peak as two lines."""


def significant_deviation(trials: int = 1) -> float:
    """Return from how many standard deviations a normal variable, or the largest of several, is significant."""
    return -NormalDist().inv_cdf(SIGNIFICANCE / 2 / max(trials, 1))
