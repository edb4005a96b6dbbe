"""The Nyquist plot: frequency responses in the complex plane."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MANY
from fraexp.figures.elements.frequency_lines import draw_line, joined
from fraexp.figures.elements.scales import readable_unit
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.kinds.bode import Reference

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPOTS = tuple(mantissa * 10.0**decade for decade in range(-3, 6) for mantissa in (1, 2, 5))
"""Frequencies [Hz] that are marked on the largest curve."""
APART = 0.08
"""Least distance of marks, as a share of the largest response."""


@dataclass(frozen=True)
class NyquistCurve:
    """One response in the complex plane, in ascending frequency."""

    label: str
    frequency: np.ndarray
    """Frequency [Hz], shape (n,)."""
    real: np.ndarray
    """Real part [unit of the figure], shape (n,)."""
    imaginary: np.ndarray
    """Imaginary part [unit of the figure], shape (n,)."""
    settled: np.ndarray
    """Whether the point had become periodic, shape (n,) of bool; only such points are joined."""

    @property
    def size(self) -> float:
        """Greatest magnitude of a settled point [unit of the figure]; 0 if there is none."""
        return float(np.nanmax(np.hypot(self.real, self.imaginary)[self.settled], initial=0.0))

    def spots(self) -> dict[float, int]:
        """Return the indices of the settled points nearest to `SPOTS`, by frequency."""
        usable = self.settled & np.isfinite(self.real)
        if not usable.any():
            return {}
        low, high = self.frequency[usable][[0, -1]]
        distance = {spot: np.where(usable, np.abs(np.log(self.frequency / spot)), np.inf) for spot in SPOTS}
        return {spot: int(np.argmin(away)) for spot, away in distance.items() if low <= spot <= high}


@dataclass(frozen=True)
class NyquistInfo:
    """What a Nyquist plot shows."""

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
    curves = (_curve(label, of.frequency, factor * of.response, of.settled) for label, of in found)
    known = None
    if reference is not None:
        label, frequency, response = reference
        known = _curve(label, frequency, factor * response, np.ones(len(frequency), dtype=bool))
    return NyquistInfo(tuple(curves), known, unit, title or "Frequency response in the complex plane")


def _curve(label: str, frequency: np.ndarray, response: np.ndarray, settled: np.ndarray) -> NyquistCurve:
    order = np.argsort(frequency, kind="stable")
    response = np.where(np.isfinite(response), response, np.nan)[order]
    return NyquistCurve(label, frequency[order], response.real, response.imag, settled[order])


def draw_nyquist(info: NyquistInfo) -> "Figure":
    """Draw a Nyquist plot on equal axes; some frequencies are marked on its largest curve."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    if len(info.curves) > MANY:
        raise FraexpError(f"Nyquist plot: found {len(info.curves)} responses; {MANY} at most can be told apart")
    with canvas.styled():
        figure = canvas.new_figure(width=7.2, height=6.4)
        axes = figure.subplots()
        for curve, style in zip(info.curves, canvas.line_styles(len(info.curves)), strict=True):
            draw_line(axes, curve.real, curve.imaginary, curve.settled, curve.label, style)
        if info.reference is not None:
            of = info.reference
            draw_line(axes, of.real, joined(of.imaginary, of.settled), of.settled, of.label, canvas.REFERENCE)
        _mark(axes, max(info.curves, key=lambda curve: curve.size))
        axes.axhline(0, color="0.55", linewidth=0.8, zorder=1)
        axes.axvline(0, color="0.55", linewidth=0.8, zorder=1)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(canvas.heading(figure, info.title))
        axes.set_xlabel(f"Real part [{info.unit}]")
        axes.set_ylabel(f"Imaginary part [{info.unit}]")
        canvas.grid(axes)
        canvas.legend_below(figure, axes)
    return figure


def _mark(axes: "Axes", curve: NyquistCurve) -> None:
    """Name the frequencies of some points that do not lie on each other."""
    taken: list[complex] = []
    for spot, index in curve.spots().items():
        place = complex(curve.real[index], curve.imaginary[index])
        if all(abs(place - other) > APART * curve.size for other in taken):
            taken.append(place)
            axes.plot(place.real, place.imag, "o", color="0.1", markersize=3, zorder=5)
            axes.annotate(f"{spot:g} Hz", (place.real, place.imag), (4, 4), textcoords="offset points", fontsize=9)
