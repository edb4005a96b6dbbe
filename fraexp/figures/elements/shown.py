"""A result with what figures want to know about it."""

from dataclasses import dataclass

import numpy as np

from fraexp.data.results import Curve, FrequencyResponse, Result
from fraexp.figures.elements.labels import Drawn

FITTED = "plant fit"
"""Name of the curve that has the response of a fitted plant: its magnitude, and its phase if that was fitted."""


@dataclass(frozen=True)
class ShownResult:
    """One sweep's result, named, with the plant's own response where it is known."""

    label: str
    result: Result
    group: str = ""
    """Name of its group, by which it is told apart where there are too many."""
    truth: np.ndarray | None = None
    """P(jω) at the frequencies of its response and in its unit, complex, shape (n,); None where it is not known."""
    amplitude: float = np.nan
    """Amplitude of the excitation [`amplitude_unit`]; NaN where there is no single one."""
    amplitude_unit: str = ""
    key: str = ""
    """Key of its sweep."""
    series: str = ""
    """Name without the amplitude: the sweeps of one series differ in nothing else."""
    drawn: Drawn | None = None
    """What was drawn; None where it was not drawn at random."""

    @property
    def response(self) -> FrequencyResponse | None:
        """Its response, if it has one with at least one point."""
        found = self.result.response
        return found if found is not None and len(found.frequency) else None

    @property
    def fitted(self) -> Curve | None:
        """Magnitude and perhaps phase [deg] over frequency of the plant that was fitted to its response, if one was."""
        unit = self.response.unit if self.response else None
        fits = (of for of in self.result.curves if of.name == FITTED and of.units.get("magnitude") == unit)
        return next(fits, None)
