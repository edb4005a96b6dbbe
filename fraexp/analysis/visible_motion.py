"""Whether a recorded position moves at the excited frequencies, or shows nothing but noise."""

from collections.abc import Sequence

import numpy as np

from fraexp.analysis.fourier import phasors
from fraexp.data.signals import Segment

CHANCE = 0.01
"""Chance by which noise alone passes for motion."""


def moves_visibly(segments: Sequence[Segment], channel: str) -> bool:
    """Return whether what repeats in each period is more than its scatter explains; True if it cannot be seen.

    The squared means of the phasors over the periods, against their scatter, have an F distribution if there is only
    noise: all lines together, as noise differs little between them.
    """
    from scipy.special import fdtrc  # slow to import: listing plugins must stay fast

    mean = scatter = 0.0
    lines = freedom = 0
    for segment in segments:
        found = phasors(segment, channel)
        if len(found) < 2:
            return True
        average = found.mean(axis=0)
        mean += float(len(found) * np.sum(np.abs(average) ** 2))
        scatter += float(np.sum(np.abs(found - average) ** 2))
        lines, freedom = lines + average.size, freedom + average.size * (len(found) - 1)
    if scatter == 0.0:
        return mean > 0.0 or not lines
    return bool(fdtrc(2 * lines, 2 * freedom, (mean / lines) / (scatter / freedom)) < CHANCE)
