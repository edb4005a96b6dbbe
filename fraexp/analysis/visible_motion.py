"""Whether a recorded position moves at the excited frequencies, or shows nothing but noise."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import phasors
from fraexp.data.signals import Segment

CHANCE = 0.01
"""Chance by which noise alone passes for motion."""
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
    return bool(fdtrc(2 * lines, 2 * freedom, (mean / lines) / (scatter / freedom)) < CHANCE)


def _is_noise(samples: NDArray[np.float64]) -> bool:
    """Return whether samples differ from their neighbours as from all others (J. von Neumann's ratio, 1941)."""
    return bool(np.mean(np.diff(samples) ** 2) >= MIN_WHITENESS * 2 * np.var(samples))
