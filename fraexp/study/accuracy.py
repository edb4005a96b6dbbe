"""The section ``[accuracy]`` of a study."""

import math

from fraexp.analysis.confidence import USUAL_MAGNITUDE, USUAL_PHASE
from fraexp.components.parameters import Parameters, param


class Accuracy(Parameters):
    """How far a response may be off at most, at 95 %."""

    magnitude: float = param("dB", "greatest error of the magnitude", USUAL_MAGNITUDE, above=0)
    phase: float = param("rad", "greatest error of the phase, such as '3 deg'", USUAL_PHASE, above=0, at_most=math.pi)

    @property
    def relative_error(self) -> float:
        """Greatest relative error of a response, or of a force, that is within both."""
        return min(10 ** (self.magnitude / (2 * 10)) - 1, math.sin(min(self.phase, math.pi / 2)))
