"""The verdict on a response: a point is ok if its whole band lies within the accuracy that is asked for."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import FrequencyResponse


class Accuracy(NamedTuple):
    """How far a response may be off at most, at 95 %."""

    magnitude: float = 0.5
    """Of its magnitude [dB]."""
    phase: float = 3.0
    """Of its phase [°]."""


class BandReach(NamedTuple):
    """How far the band of a response reaches, shape (n,); infinite where it has no end, 0 where nothing is known."""

    magnitude: NDArray[np.float64]
    """Greatest distance of the magnitude [dB]."""
    phase: NDArray[np.float64]
    """Greatest distance of the phase [°]."""

    @classmethod
    def of(cls, response: FrequencyResponse) -> "BandReach":
        """Return the reach of a response's 95 % limits."""
        with np.errstate(divide="ignore", invalid="ignore"):
            magnitude, phase = confidence_limits(response)
            level = 20 * np.abs(np.log10(np.maximum(magnitude, 0.0)))
        return cls(*(np.nan_to_num(each, posinf=np.inf).max(axis=0) for each in (level, np.degrees(np.abs(phase)))))

    def is_within(self, accuracy: Accuracy) -> NDArray[np.bool_]:
        """Return where the whole band lies within an accuracy, shape (n,)."""
        return np.asarray((self.magnitude <= accuracy.magnitude) & (self.phase <= accuracy.phase))
