"""The Nyquist plot: frequency responses in the complex plane."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MAX_SINGLE_CURVES
from fraexp.figures.elements.frequency_lines import draw_line, with_gaps
from fraexp.figures.elements.scales import readable_unit
from fraexp.figures.elements.shown import ShownResult
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
    found = [(of.label, of.response) for of in shown if of.response is not None]
    units = sorted({response.unit for _, response in found})
    if len(units) != 1:
        raise FraexpError(f"Nyquist plot: found responses in {' and '.join(units) or 'nothing'}; choose one unit")
    factor, unit = readable_unit(units[0])
    curves = (_curve(label, factor, of.frequency, of.response, of.settled) for label, of in found)
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
) -> NyquistCurve:
    order = np.argsort(frequency, kind="stable")
    scaled = factor * response
    shown = np.where(np.isfinite(scaled), scaled, np.nan)[order]
    return NyquistCurve(label, frequency[order], shown.real, shown.imag, settled[order])


def draw_nyquist(info: NyquistInfo) -> "Figure":
    """Draw a Nyquist plot with equal axes and frequency marks on the largest curve."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    if len(info.curves) > MAX_SINGLE_CURVES:
        raise FraexpError(
            f"Nyquist plot: found {len(info.curves)} responses; no more than {MAX_SINGLE_CURVES} can be distinguished"
        )
    with canvas.figure_style():
        figure = canvas.new_figure(width=7.2, height=6.4)
        axes = figure.subplots()
        for curve, style in zip(info.curves, canvas.line_styles(len(info.curves)), strict=True):
            draw_line(axes, curve.real, curve.imaginary, curve.settled, curve.label, style)
        if info.reference is not None:
            of = info.reference
            draw_line(axes, of.real, with_gaps(of.imaginary, of.settled), of.settled, of.label, canvas.REFERENCE_STYLE)
        _draw_marks(axes, max(info.curves, key=lambda curve: curve.size))
        axes.axhline(0, color="0.55", linewidth=0.8, zorder=1)
        axes.axvline(0, color="0.55", linewidth=0.8, zorder=1)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(canvas.wrapped_title(figure, info.title))
        axes.set_xlabel(f"Real part [{info.unit}]")
        axes.set_ylabel(f"Imaginary part [{info.unit}]")
        canvas.draw_grid(axes)
        canvas.add_legend_below(figure, axes)
    return figure


def _draw_marks(axes: "Axes", curve: NyquistCurve) -> None:
    """Mark the frequencies of points that are not too close to each other."""
    taken: list[complex] = []
    for frequency_mark, index in curve.marked_points().items():
        place = complex(curve.real[index], curve.imaginary[index])
        if all(abs(place - other) > MIN_MARK_DISTANCE * curve.size for other in taken):
            taken.append(place)
            axes.plot(place.real, place.imag, "o", color="0.1", markersize=3, zorder=5)
            axes.annotate(
                f"{frequency_mark:g} Hz", (place.real, place.imag), (4, 4), textcoords="offset points", fontsize=9
            )
