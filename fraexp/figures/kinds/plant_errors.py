"""Errors of frequency responses against the plant that was simulated."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import EFFORT, FrequencyResponse, Metric
from fraexp.errors import FraexpError
from fraexp.figures.elements.frequency_lines import GroupedLine, PhasedCurve, with_gaps
from fraexp.figures.elements.grouping import OWN_PLACE, CurvePlace, ShownResult, curve_places
from fraexp.figures.elements.panel_figure import Panel, PanelFigure, over_frequency
from fraexp.figures.elements.scales import decibel, decibel_limits, degree_limits, degrees, readable_unit

TABLE_FREQUENCIES_HZ = (1.0, 5.0, 12.0, 20.0, 39.0, 80.0, 150.0)
"""Default frequencies of the table."""
FREQUENCY_FACTOR = 1.05
"""Factor within which the table uses the nearest settled frequency, with P(jω) there."""
PARTS = {"magnitude": ("dB", 0.1), "phase": ("deg", 1.0)}
"""Unit of each part of an error, and size up to which its axis is linear if far greater ones must be shown as well."""
FAR_ERROR_RATIO = 20.0
"""Ratio of the greatest error to the linear range above which an axis is logarithmic."""


@dataclass(frozen=True)
class ErrorCurve(PhasedCurve):
    """The error Ĝ/P of a response: |Ĝ/P| [dB], and arg(Ĝ/P) [deg] within ±180."""

    cost: tuple[Metric, ...] = ()
    """Known metrics of the experiment's effort."""
    key: str = ""
    """Key of its sweep."""
    place: CurvePlace = OWN_PLACE
    """Where it belongs."""

    @property
    def effort(self) -> dict[str, float]:
        """Effort of the experiment in readable units, such as ``{"stroke [mm]": 1.2}``."""
        units = [readable_unit(metric.unit) for metric in self.cost]
        return {
            f"{metric.name} [{unit}]": factor * metric.value
            for metric, (factor, unit) in zip(self.cost, units, strict=True)
        }

    def index_near(self, spot: float) -> int | None:
        """Return the index of the settled point nearest to a frequency [Hz]; None if none is near enough."""
        distance = np.where(self.settled & np.isfinite(self.magnitude), np.abs(np.log(self.frequency / spot)), np.inf)
        index = int(np.argmin(distance)) if len(distance) else 0
        return index if len(distance) and distance[index] <= np.log(FREQUENCY_FACTOR) else None

    @property
    def coverage(self) -> float:
        """Share of the 95 % limits at settled points that cover P(jω); NaN if none is known."""
        bands = np.stack([self.magnitude_band, self.phase_band])[:, :, self.settled]
        known = ~np.isnan(bands).any(axis=1)
        covered = (bands[:, 0] <= 0) & (bands[:, 1] >= 0)
        return float(covered[known].mean()) if known.any() else np.nan


@dataclass(frozen=True)
class ErrorsInfo:
    """Errors of responses, for a figure, and for a table at some frequencies."""

    curves: tuple[ErrorCurve, ...]
    spots: tuple[float, ...]
    """Frequencies [Hz] of the table's columns."""
    title: str

    @property
    def effort(self) -> tuple[str, ...]:
        """Titles of the known efforts of the experiments."""
        return tuple(dict.fromkeys(name for curve in self.curves for name in curve.effort))


def errors_info(
    shown: Sequence[ShownResult], title: str = "", spots: Sequence[float] = TABLE_FREQUENCIES_HZ
) -> ErrorsInfo:
    """Return the errors of the responses whose plant is known; FraexpError if there is none.

    `spots` outside of the range of the responses are left out.
    """
    curves = tuple(
        _error_curve(of, of.response, of.truth, place)
        for of, place in zip(shown, curve_places(shown), strict=True)
        if of.truth is not None and of.response is not None
    )
    if not curves:
        raise FraexpError("errors: found no response of a simulated plant; choose sweeps of a loop, in m/N")
    low = min(float(curve.frequency[0]) for curve in curves) / FREQUENCY_FACTOR
    high = max(float(curve.frequency[-1]) for curve in curves) * FREQUENCY_FACTOR
    in_range = tuple(spot for spot in spots if low <= spot <= high)
    return ErrorsInfo(curves, in_range, title or "Error against P(jω)")


def _error_curve(
    of: ShownResult, response: FrequencyResponse, truth: NDArray[np.complex128], place: CurvePlace
) -> ErrorCurve:
    """Return the error of a response against P(jω), shape (n,), at its own frequencies."""
    with np.errstate(invalid="ignore"):  # where the machine did not move
        ratio = response.response / truth
    band, turn = confidence_limits(response)
    magnitude, phase = decibel(ratio), degrees(ratio)
    return ErrorCurve(
        label=of.label,
        frequency=response.frequency,
        magnitude=magnitude,
        phase=phase,
        settled=response.settled,
        magnitude_band=magnitude + decibel_limits(band),
        phase_band=phase + degree_limits(turn),
        cost=tuple(metric for name in EFFORT for metric in of.result.metrics if metric.name == name),
        key=of.key,
        place=place,
    )


def errors_figure(info: ErrorsInfo) -> PanelFigure:
    """Return the errors of magnitude and phase over frequency."""
    return over_frequency(info.title, *error_panels(info.curves))


def error_panels(curves: Sequence[ErrorCurve], noun: str = "error") -> list[Panel]:
    """Return magnitude and phase of errors; far beyond its linear range an axis is logarithmic."""
    panels = []
    for part, (unit, linear_range) in PARTS.items():
        lines = tuple(_line(curve, part) for curve in curves)
        greatest = max(np.nanmax(np.abs(with_gaps(line.y, line.usable)), initial=0.0) for line in lines)
        fine = linear_range if greatest > FAR_ERROR_RATIO * linear_range else None
        panels.append(Panel(f"{part.title()} {noun} [{unit}]", unit, lines, linear_range=fine, marks=(0.0,)))
    return panels


def _line(curve: ErrorCurve, part: str) -> GroupedLine:
    band = getattr(curve, f"{part}_band")
    known = None if np.isnan(band).all() else band
    return GroupedLine(curve.label, curve.place, curve.frequency, getattr(curve, part), curve.settled, known)
