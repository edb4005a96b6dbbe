"""How far the band of a response reaches, in the units in which an accuracy is asked for."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import FrequencyResponse

USUAL_MAGNITUDE, USUAL_PHASE = 0.5, math.radians(3)
"""Error of magnitude [dB] and phase [rad] within which a response has to lie if its study asks for nothing else."""


class BandReach(NamedTuple):
    """How far the band of a response reaches, shape (n,); infinite where it has no end or is not known."""

    magnitude: NDArray[np.float64]
    """Greatest distance of the magnitude [dB]."""
    phase: NDArray[np.float64]
    """Greatest distance of the phase [rad]."""

    @classmethod
    def of(cls, response: FrequencyResponse) -> "BandReach":
        """Return the reach of a response's 95 % limits."""
        with np.errstate(divide="ignore", invalid="ignore"):
            magnitude, phase = confidence_limits(response)
            level = 20 * np.abs(np.log10(np.maximum(magnitude, 0.0)))
        is_known = np.isfinite(response.covariance).all(axis=(1, 2)) & np.isfinite(level + phase).all(axis=0)
        return cls(*(np.where(is_known, each.max(axis=0), np.inf) for each in (level, np.abs(phase))))

    def over(self, magnitude: float, phase: float) -> NDArray[np.float64]:
        """Return the band over a magnitude [dB] and a phase [rad], shape (n,): at most 1 where it lies within both."""
        return np.asarray(np.maximum(self.magnitude / magnitude, self.phase / phase))

    def is_within(self, magnitude: float = USUAL_MAGNITUDE, phase: float = USUAL_PHASE) -> NDArray[np.bool_]:
        """Return where the whole band lies within a magnitude [dB] and a phase [rad], shape (n,)."""
        return self.over(magnitude, phase) <= 1
