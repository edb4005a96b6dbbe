"""The Nyquist plot: frequency responses in the complex plane."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.facets import FACET_WIDTH, by_facet, facet_panels, group_styles
from fraexp.figures.elements.frequency_lines import GroupedLine, draw_grouped_lines, draw_line
from fraexp.figures.elements.grouping import OWN_PLACE, CurvePlace, ShownResult, curve_places
from fraexp.figures.elements.scales import readable_unit
from fraexp.figures.kinds.bode import Reference

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKED_FREQUENCIES_HZ = tuple(mantissa * 10.0**decade for decade in range(-3, 6) for mantissa in (1, 2, 5))
"""Frequencies that are marked on the largest curve."""
MIN_MARK_DISTANCE = 0.08
"""Least distance between marks, relative to the largest response."""


@dataclass(frozen=True)
class _NyquistCurve(GroupedLine):
    """A response in the complex plane, in ascending frequency: imaginary over real part [unit of the figure]."""

    frequency: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """Frequency [Hz], shape (n,)."""

    @property
    def size(self) -> float:
        """Largest magnitude of a settled point [unit of the figure]; 0 if there is none."""
        return float(np.nanmax(np.hypot(self.x, self.y)[self.usable], initial=0.0))

    def marked_points(self) -> dict[float, int]:
        """Return the index of the settled point nearest to each marked frequency [Hz] in the range of the curve."""
        usable = self.usable & np.isfinite(self.x)
        if not usable.any():
            return {}
        low, high = self.frequency[usable][[0, -1]]
        distance = {
            frequency_mark: np.where(usable, np.abs(np.log(self.frequency / frequency_mark)), np.inf)
            for frequency_mark in MARKED_FREQUENCIES_HZ
        }
        return {
            frequency_mark: int(np.argmin(away))
            for frequency_mark, away in distance.items()
            if low <= frequency_mark <= high
        }


@dataclass(frozen=True)
class NyquistInfo:
    """Contents of a Nyquist plot."""

    curves: tuple[_NyquistCurve, ...]
    reference: _NyquistCurve | None
    unit: str
    """Unit of both axes, such as ``mm/N``."""
    title: str


def nyquist_info(shown: Sequence[ShownResult], reference: Reference | None = None, title: str = "") -> NyquistInfo:
    """Return the numbers of a Nyquist plot of all responses; FraexpError if there is none or their units differ."""
    pairs = zip(shown, curve_places(shown), strict=True)
    found = [(of.label, of.response, place) for of, place in pairs if of.response is not None]
    units = sorted({response.unit for _, response, _ in found})
    if len(units) != 1:
        raise FraexpError(f"Nyquist plot: found responses in {' and '.join(units) or 'nothing'}; choose one unit")
    factor, unit = readable_unit(units[0])
    curves = (_curve(label, factor, of.frequency, of.response, of.settled, place) for label, of, place in found)
    known = None
    if reference is not None:
        label, frequency, response = reference
        order = np.argsort(frequency)
        known = _curve(label, factor, frequency[order], response[order], np.ones(len(frequency), dtype=bool))
    return NyquistInfo(tuple(curves), known, unit, title or "Frequency response in the complex plane")


def _curve(
    label: str,
    factor: float,
    frequency: NDArray[np.float64],
    response: NDArray[np.complex128],
    settled: NDArray[np.bool_],
    place: CurvePlace = OWN_PLACE,
) -> _NyquistCurve:
    scaled = factor * response
    shown = np.where(np.isfinite(scaled), scaled, np.nan)
    return _NyquistCurve(label, place, shown.real, shown.imag, settled, frequency=frequency)


def draw_nyquist(info: NyquistInfo) -> "Figure":
    """Draw a Nyquist plot with equal axes and frequency marks on the largest curve."""
    with canvas.figure_style():
        shown = [*info.curves, *([info.reference] if info.reference else [])]
        places = [curve.place for curve in info.curves]
        facets, styles = by_facet(info.curves, places), group_styles(places)
        panels = facet_panels(list(facets), (7.2, 6.4), facet_height=_facet_height(shown))
        for (axes,), curves in zip(panels.facets.values(), facets.values(), strict=True):
            draw_grouped_lines(axes, curves, styles)
            _draw_marks(axes, curves, info.reference)
        x_titles, y_titles = [f"Real part [{info.unit}]"], [f"Imaginary part [{info.unit}]"]
        return panels.finish(info.title, x_titles, y_titles, places)


def _facet_height(curves: Sequence[_NyquistCurve]) -> float:
    """Return the height [inch] at which a facet with equal axes is as wide as its place."""
    real, imaginary = (np.concatenate([[0.0], *parts]) for parts in zip(*((of.x, of.y) for of in curves), strict=True))
    width, height = (float(np.nanmax(of) - np.nanmin(of)) or 1.0 for of in (real, imaginary))
    return float(np.clip(FACET_WIDTH * height / width, 1.2, 5.0)) + 0.9


def _draw_marks(axes: "Axes", curves: Sequence[_NyquistCurve], reference: _NyquistCurve | None) -> None:
    """Draw the reference, the axes through 0, and frequencies on the largest curve that are not too close."""
    if reference is not None:
        draw_line(axes, reference.x, reference.y, reference.usable, reference.name, canvas.REFERENCE_STYLE)
    curve, taken = max(curves, key=lambda curve: curve.size), list[complex]()
    size = max(curve.size, reference.size if reference is not None else 0.0)
    for frequency_mark, index in curve.marked_points().items():
        place = complex(curve.x[index], curve.y[index])
        if all(abs(place - other) > MIN_MARK_DISTANCE * size for other in taken):
            taken.append(place)
            axes.plot(place.real, place.imag, "o", color="0.1", markersize=3, zorder=5)
            axes.annotate(
                f"{frequency_mark:g} Hz", (place.real, place.imag), (4, 4), textcoords="offset points", fontsize=9
            )
    axes.axhline(0, color="0.55", linewidth=0.8, zorder=1)
    axes.axvline(0, color="0.55", linewidth=0.8, zorder=1)
    axes.margins(y=0.12)  # for the frequencies that are written above their marks
    axes.set_aspect("equal", adjustable="datalim" if len(axes.figure.axes) == 1 else "box")
