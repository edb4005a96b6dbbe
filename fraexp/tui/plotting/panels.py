"""Small plots of curves without a cursor, over a linear or logarithmic abscissa."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.figures.elements.bands import finite_span
from fraexp.tui.plotting.curve_styles import CurveStyles
from fraexp.tui.plotting.panel_drawing import ViewRange
from fraexp.tui.plotting.plot_widget import Plot
from fraexp.tui.plotting.plotted_curves import REFERENCE, PlotPanel, PlotTrace

Line = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Abscissa and ordinate, each of shape (n,)."""
MARGIN = 0.05
"""Fraction of its span by which an axis extends beyond the curves."""
UNIT_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


def prefixed_text(value: float, unit: str = "") -> str:
    """Return a number with a prefix before its unit: ``150 kN/m``."""
    if not math.isfinite(value) or abs(value) < UNIT_PREFIXES[-1][0] / 1000:
        value = value if not math.isfinite(value) else 0.0
        return f"{value:g} {unit}".strip()
    factor, prefix = next((pair for pair in UNIT_PREFIXES if abs(value) >= 0.9999995 * pair[0]), UNIT_PREFIXES[-1])
    blank = " " if unit else ""
    return f"{value / factor:.4g}{blank}{prefix}{unit}"


class SmallPlot(Plot):
    """One plot under a title; logarithmic axes get the log10 of their quantity."""

    def __init__(self, title: str, x_decades: bool = False, y_decades: bool = False, id: str | None = None) -> None:  # noqa: A002
        super().__init__(id)
        self._title, self._x_decades, self._y_decades = title, x_decades, y_decades

    def draw(
        self, lines: Sequence[Line], dotted: Sequence[Line] = (), bar: float | None = None, title: str = ""
    ) -> None:
        """Draw lines, dotted lines and a vertical bar in place of the previous ones."""
        self._title = title or self._title
        traces = [_trace(0, line) for line in lines] + [_trace(REFERENCE, line) for line in dotted]
        if not traces:
            return
        panel = PlotPanel(self._title, "", "", tuple(traces), spectral=self._x_decades, decades=self._y_decades)
        x, y = ([getattr(trace, part) for trace in traces] for part in ("x", "y"))
        window = *_span(x), *_span(y)
        cursor = bar if bar is None or not self._x_decades else 10.0**bar
        self.show(panel, window, ViewRange(cursor=cursor), CurveStyles.of_app(self.app), upright=True, labelled=True)


def _trace(of: int, line: Line) -> PlotTrace:
    x, y = line
    return PlotTrace(of, x, y, np.isfinite(x) & np.isfinite(y), x)


def _span(values: Sequence[NDArray[np.float64]]) -> tuple[float, float]:
    """Return a span a little wider than that of the values."""
    low, high = finite_span(values) or (0.0, 1.0)
    room = MARGIN * (high - low) if high > low else max(abs(low) * MARGIN, 1e-9)
    return low - room, high + room
