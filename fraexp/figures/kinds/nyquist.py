"""The Nyquist plot: frequency responses in the complex plane."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.canvas import LineStyle
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
class NyquistCurve:
    """A response in the complex plane, in ascending frequency."""

    label: str
    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    real: NDArray[np.float64]
    """Real part [unit of the figure], shape (n,)."""
    imaginary: NDArray[np.float64]
    """Imaginary part [unit of the figure], shape (n,)."""
    settled: NDArray[np.bool_]
    """Whether the point had settled, shape (n,); lines join settled points only."""
    place: CurvePlace = OWN_PLACE
    """Where it belongs."""

    @property
    def size(self) -> float:
        """Largest magnitude of a settled point [unit of the figure]; 0 if there is none."""
        return float(np.nanmax(np.hypot(self.real, self.imaginary)[self.settled], initial=0.0))

    def marked_points(self) -> dict[float, int]:
        """Return the index of the settled point nearest to each marked frequency [Hz] in the range of the curve."""
        usable = self.settled & np.isfinite(self.real)
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

    curves: tuple[NyquistCurve, ...]
    reference: NyquistCurve | None
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
        known = _curve(label, factor, frequency, response, np.ones(len(frequency), dtype=bool))
    return NyquistInfo(tuple(curves), known, unit, title or "Frequency response in the complex plane")


def _curve(
    label: str,
    factor: float,
    frequency: NDArray[np.float64],
    response: NDArray[np.complex128],
    settled: NDArray[np.bool_],
    place: CurvePlace = OWN_PLACE,
) -> NyquistCurve:
    order = np.argsort(frequency, kind="stable")
    scaled = factor * response
    shown = np.where(np.isfinite(scaled), scaled, np.nan)[order]
    return NyquistCurve(label, frequency[order], shown.real, shown.imag, settled[order], place)


def draw_nyquist(info: NyquistInfo) -> "Figure":
    """Draw a Nyquist plot with equal axes and frequency marks on the largest curve."""
    places = [curve.place for curve in info.curves]
    with canvas.figure_style():
        facets = by_facet(info.curves, places)
        shown = [*info.curves, *([info.reference] if info.reference else [])]
        panels = facet_panels(list(facets), (7.2, 6.4), facet_height=_facet_height(shown))
        styles = group_styles(places)
        for curves, (axes,) in zip(facets.values(), panels.facets.values(), strict=True):
            _draw_facet(axes, curves, info.reference, styles)
        canvas.draw_grid(*panels.all)
        panels.label(info.title, [f"Real part [{info.unit}]"], [f"Imaginary part [{info.unit}]"])
        panels.add_legend(places)
    return panels.figure


def _facet_height(curves: Sequence[NyquistCurve]) -> float:
    """Return the height [inch] at which a facet with equal axes is as wide as its place."""
    real, imaginary = (
        np.concatenate([[0.0], *parts]) for parts in zip(*((of.real, of.imaginary) for of in curves), strict=True)
    )
    width, height = (float(np.nanmax(of) - np.nanmin(of)) or 1.0 for of in (real, imaginary))
    return float(np.clip(FACET_WIDTH * height / width, 1.2, 5.0)) + 0.9


def _draw_facet(
    axes: "Axes", curves: Sequence[NyquistCurve], reference: NyquistCurve | None, styles: Mapping[str, LineStyle]
) -> None:
    lines = [GroupedLine(of.label, of.place, of.real, of.imaginary, of.settled) for of in curves]
    draw_grouped_lines(axes, lines, styles)
    if reference is not None:
        draw_line(axes, reference.real, reference.imaginary, reference.settled, reference.label, canvas.REFERENCE_STYLE)
    shown = [*curves, *([reference] if reference is not None else [])]
    _draw_marks(axes, max(curves, key=lambda curve: curve.size), max(curve.size for curve in shown))
    axes.axhline(0, color="0.55", linewidth=0.8, zorder=1)
    axes.axvline(0, color="0.55", linewidth=0.8, zorder=1)
    axes.margins(y=0.12)  # for the frequencies that are written above their marks
    axes.set_aspect("equal", adjustable="datalim" if len(axes.figure.axes) == 1 else "box")


def _draw_marks(axes: "Axes", curve: NyquistCurve, size: float) -> None:
    """Mark the frequencies of points that are not too close to each other in a plot of responses up to a size."""
    taken: list[complex] = []
    for frequency_mark, index in curve.marked_points().items():
        place = complex(curve.real[index], curve.imaginary[index])
        if all(abs(place - other) > MIN_MARK_DISTANCE * size for other in taken):
            taken.append(place)
            axes.plot(place.real, place.imag, "o", color="0.1", markersize=3, zorder=5)
            axes.annotate(
                f"{frequency_mark:g} Hz", (place.real, place.imag), (4, 4), textcoords="offset points", fontsize=9
            )
