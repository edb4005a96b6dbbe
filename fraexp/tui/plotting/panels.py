"""Small plots of curves without a cursor: over a plain or a logarithmic abscissa."""

import math
from collections.abc import Sequence

import numpy as np
from rich.markup import escape
from textual_hires_canvas import Canvas
from textual_plot import AxisFormatter, HiResMode, NumericAxisFormatter, PlotWidget

from fraexp.tui.plotting.ticks import Ticks

Line = tuple[np.ndarray, np.ndarray]
"""Abscissa and ordinate, each of shape (n,)."""
PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"))
STEPS = (1.0, 2.0, 5.0)


def scaled(value: float, unit: str = "") -> str:
    """Return a number with a prefix before its unit: ``150 kN/m``."""
    if not math.isfinite(value) or abs(value) < PREFIXES[-1][0] / 1000:
        value = value if not math.isfinite(value) else 0.0
        return f"{value:g} {unit}".strip()
    factor, prefix = next((pair for pair in PREFIXES if abs(value) >= 0.9999995 * pair[0]), PREFIXES[-1])
    blank = " " if unit else ""
    return f"{value / factor:.4g}{blank}{prefix}{unit}"


class Decades(AxisFormatter):
    """Ticks of numbers whose logarithms are drawn: 1, 10, 100, and between them 2 and 5 where there is room."""

    def get_ticks(self, min_: float, max_: float, max_ticks: int = 8) -> list[float]:
        """Return the places of ticks."""
        low, high = math.floor(min_), math.ceil(max_)
        decades = [float(power) for power in range(low, high + 1)]
        fine = [power + math.log10(step) for power in decades for step in STEPS]
        inside = [[tick for tick in ticks if min_ - 1e-9 <= tick <= max_ + 1e-9] for ticks in (fine, decades)]
        if len(inside[0]) <= max_ticks:
            return inside[0]
        return inside[1][:: max(1, math.ceil(len(inside[1]) / max_ticks))]

    def get_labels_for_ticks(self, ticks: Sequence[float]) -> list[str]:
        """Return the numbers at ticks."""
        return [scaled(10.0**tick) for tick in ticks]


class SmallPlot(PlotWidget, can_focus=False):
    """One plot under a title, with as much room for its curves as there is."""

    DEFAULT_CSS = "SmallPlot { height: 1fr; } SmallPlot > .plot--tick { color: $text; text-style: none; }"

    def __init__(self, title: str, x_decades: bool = False, y_decades: bool = False, id: str | None = None) -> None:  # noqa: A002
        super().__init__(id=id, allow_pan_and_zoom=False)
        self.set_ylabel(title)
        self.set_x_formatter(Decades() if x_decades else NumericAxisFormatter())
        self.set_y_formatter(Decades() if y_decades else NumericAxisFormatter())

    def on_mount(self) -> None:
        """Leave no more room beside the curves than title and ticks need."""
        self.margin_top, self.margin_bottom, self.margin_left = 1, 1, 8

    def draw(
        self, lines: Sequence[Line], dotted: Sequence[Line] = (), bar: float | None = None, title: str = ""
    ) -> None:
        """Draw lines in place of what was drawn before, some of them dotted, and a bar at an abscissa."""
        self.clear()
        self.set_ylabel(title or self._y_label)
        colour, faint = (self.app.theme_variables.get(name, "") for name in ("primary", "secondary"))
        for x, y in dotted:
            self.scatter(x, y, marker_style=_rich(faint), hires_mode=HiResMode.BRAILLE)
        if bar is not None:
            self.add_v_line(bar, line_style=_rich(faint))
        for x, y in lines:
            if x.size:
                self.plot(x, y, line_style=_rich(colour), hires_mode=HiResMode.BRAILLE)

    def _render_y_ticks(self) -> None:
        """Leave as many ticks as have rows of their own."""
        if not isinstance(self._y_formatter, Decades):
            self.set_y_formatter(Ticks(self._scale_rectangle.height, upright=True))
        super()._render_y_ticks()

    def _render_y_label(self) -> None:
        """Write the title from the left; its brackets are no markup."""
        style = self.get_component_rich_style("plot--label")
        self.query_one("#margin-top", Canvas).write_text(self.margin_left, 0, f"[{style}]{escape(self._y_label)}")


def _rich(colour: str) -> str:
    """Return a colour of the theme as a style; one that depends on what is below it is left to the terminal."""
    return colour if colour.startswith("#") and len(colour) == 7 else "default"
