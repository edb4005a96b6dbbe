"""Results with the names and references that figures show."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import EXTREMUM_CURVES, Curve, FrequencyResponse, Result
from fraexp.figures.elements.grouping import CurvePlace
from fraexp.figures.elements.labels import RandomDraw

FITTED_CURVE = "plant fit"
"""Name of the curve with the response of a fitted plant: its magnitude, and its phase if that was fitted."""


@dataclass(frozen=True)
class ShownResult:
    """The result of a sweep with its name, and the response of the simulated plant if it is known."""

    label: str
    result: Result
    place: CurvePlace | None = None
    """Where its curve belongs; None for a colour of its own."""
    truth: NDArray[np.complex128] | None = None
    """P(jω) at the frequencies and in the unit of its response, shape (n,); None if it is unknown."""
    amplitude: float = np.nan
    """Amplitude of the excitation [`amplitude_unit`]; NaN if there is none, or several."""
    amplitude_unit: str = ""
    key: str = ""
    """Key of its sweep."""
    series: str = ""
    """Name without the amplitude: the sweeps of a series differ in the amplitude only."""
    drawn: RandomDraw | None = None
    """Its random draw; None if nothing was drawn."""

    @property
    def name(self) -> str:
        """Name of its curve in a legend: that of its group if it shares one."""
        return self.place.group if self.place and self.place.group else self.label

    @property
    def response(self) -> FrequencyResponse | None:
        """Its response if it has at least one point, otherwise None."""
        found = self.result.response
        return found if found is not None and len(found.frequency) else None

    @property
    def fitted(self) -> Curve | None:
        """Magnitude, and phase [deg] if known, of the plant that was fitted to its response; None without a fit.

        The column ``extremum`` is 1 at its resonances and -1 at its antiresonances, ``rigid body`` the magnitude of its
        rigid body alone.
        """
        unit = self.response.unit if self.response else None
        fits = (of for of in self.result.curves if of.name == FITTED_CURVE and of.units.get("magnitude") == unit)
        found = next(fits, None)
        return replace(found, columns={**found.columns, **self._plant_columns(found)}) if found else None

    def _plant_columns(self, of: Curve) -> dict[str, NDArray[np.float64]]:
        frequency, columns = of.columns["frequency"], {"extremum": np.zeros(len(of.columns["frequency"]))}
        for curve in self.result.curves:
            if curve.name in EXTREMUM_CURVES:
                nearest = np.abs(frequency - curve.columns["frequency"][:, None]).argmin(axis=1)
                columns["extremum"][nearest] = EXTREMUM_CURVES[curve.name]
        gains = [fit.component.get("rigid_body_gain") for fit in self.result.fits]
        if gains and isinstance(gains[0], float):
            columns["rigid body"] = gains[0] / (2 * np.pi * frequency) ** 2
        return columns


def curve_places(shown: Sequence[ShownResult]) -> list[CurvePlace]:
    """Return the places of results; those without one are points of the grid of their own."""
    return [of.place or CurvePlace(group=of.label, point=f"{of.label} {index}") for index, of in enumerate(shown)]
