"""What noise and rounding of an encoder do to Fourier sums over one period."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import phasors
from fraexp.analysis.tolerances import SIGNIFICANCE
from fraexp.data.signals import Encoder, Segment

ALIKE_VARIANCE = 2.0
"""Factor on the variance of odd terms where both halves of a motion are rounded alike: the even terms have none."""

ROUNDING_OF_NUMBERS = 1e-9
"""Difference of two values, relative to their range, that is no step."""
GRID_TOLERANCE = 0.01
"""Part of a step by which differences of rounded values may miss a whole number of steps."""


def smallest_step(samples: NDArray[np.float64]) -> float:
    """Return the smallest difference of two values [their unit]: the step of an encoder, if that is coarse.

    It is infinite if all values are equal.
    """
    steps = np.diff(np.unique(samples))
    return float(steps[steps > ROUNDING_OF_NUMBERS * np.ptp(samples)].min(initial=np.inf))


def grid_step(samples: NDArray[np.float64]) -> float:
    """Return the step between values that all lie on one grid [their unit]; 0 if they are as good as continuous."""
    steps, step = np.diff(np.unique(samples)), smallest_step(samples)
    if not step < np.inf:
        return 0.0
    counts = steps / step
    return step if np.abs(counts - np.rint(counts)).max() < GRID_TOLERANCE else 0.0


def phasor_variance(segment: Segment, encoder: Encoder, channel: str) -> NDArray[np.float64]:
    """Return the variance E|dY|² of the phasors of one period of a measured position [m²], shape (lines,)."""
    return np.full(segment.lines.size, line_variance(segment, encoder, channel))


def line_variance(segment: Segment, encoder: Encoder, channel: str) -> float:
    """Return this variance at one line [m²]: it is the same at each.

    Rounding counts as white, with a variance of q²/12, over the terms that it can reach: of a motion that crosses few
    steps it has slow teeth, and all of its power in the lowest terms. B. Widrow and I. Kollár, Quantization Noise,
    2008, doi:10.1017/CBO9780511754661.
    """
    variance = encoder.noise**2 / segment.samples
    if encoder.resolution:
        reach = min(_distinct_samples(segment), crossed_steps(segment, encoder.resolution, channel))
        variance += encoder.resolution**2 / 12 * rounding_symmetry(segment) / reach
    return 4 * variance


def crossed_steps(segment: Segment, resolution: float, channel: str) -> float:
    """Return how many samples the rounding error of a period fills evenly: it has a tooth for each step crossed.

    The teeth of a sine of amplitude A are of up to 2π A/q times its frequency.
    """
    y = segment.channels[channel]
    path = np.abs(np.diff(y, axis=1)).sum() / len(y)
    return max(np.pi * float(path) / resolution, 1.0)


def rounding_symmetry(segment: Segment) -> float:
    """Return the factor on the variance of odd terms by rounding.

    A sine that is sampled evenly about a multiple of half a quantisation step is rounded alike to and fro: all of its
    error is then in its odd terms. A loop at rest usually is near such a place.
    """
    return ALIKE_VARIANCE if segment.lines.size == 1 and _distinct_samples(segment) % 2 == 0 else 1.0


def _distinct_samples(segment: Segment) -> int:
    """Return the samples of a period at different places of the motion, which may repeat itself in it."""
    return segment.samples // math.gcd(segment.samples, *segment.lines.tolist())


MIN_WHITENESS = 0.5
"""Mean square of the differences from sample to sample over twice the variance: 1 for noise, near 0 for what moves."""


def moves_visibly(segments: Sequence[Segment], channel: str) -> bool:
    """Return whether what repeats in each period is more than its scatter explains; True if it cannot be seen.

    It cannot where the scatter is no noise: an axis that is moved otherwise, or drifts, does not stand. The squared
    means of the phasors over the periods, against their scatter, have an F distribution if there is only noise: all
    lines together, as noise differs little between them.
    """
    from scipy.special import fdtrc  # slow to import: listing plugins must stay fast

    mean = scatter = 0.0
    lines = freedom = 0
    for segment in segments:
        found = phasors(segment, channel)
        if len(found) < 2 or not _is_noise(segment.channels[channel].ravel()):
            return True
        average = found.mean(axis=0)
        mean += float(len(found) * np.sum(np.abs(average) ** 2))
        scatter += float(np.sum(np.abs(found - average) ** 2))
        lines, freedom = lines + average.size, freedom + average.size * (len(found) - 1)
    if scatter == 0.0:
        return mean > 0.0 or not lines
    return bool(fdtrc(2 * lines, 2 * freedom, (mean / lines) / (scatter / freedom)) < SIGNIFICANCE)


def _is_noise(samples: NDArray[np.float64]) -> bool:
    """Return whether samples differ from their neighbours as from all others (J. von Neumann's ratio, 1941)."""
    return bool(np.mean(np.diff(samples) ** 2) >= MIN_WHITENESS * 2 * np.var(samples))
