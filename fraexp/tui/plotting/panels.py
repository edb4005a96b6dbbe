"""Small plots of curves without a cursor, over a linear or logarithmic abscissa."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Resize
from textual.widgets import Static
from textual_plot import AxisFormatter, HiResMode, NumericAxisFormatter, PlotWidget

from fraexp.tui.plotting.ticks import TickFormatter

Line = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Abscissa and ordinate, each of shape (n,)."""
UNIT_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"))
DECADE_STEPS = (1.0, 2.0, 5.0)
LEFT_MARGIN = 8
"""Cells beside a plot for its ticks."""


def prefixed_text(value: float, unit: str = "") -> str:
    """Return a number with a prefix before its unit: ``150 kN/m``."""
    if not math.isfinite(value) or abs(value) < UNIT_PREFIXES[-1][0] / 1000:
        value = value if not math.isfinite(value) else 0.0
        return f"{value:g} {unit}".strip()
    factor, prefix = next((pair for pair in UNIT_PREFIXES if abs(value) >= 0.9999995 * pair[0]), UNIT_PREFIXES[-1])
    blank = " " if unit else ""
    return f"{value / factor:.4g}{blank}{prefix}{unit}"


class DecadeFormatter(AxisFormatter):
    """Ticks of a logarithmic axis: 1, 10, 100, and 2 and 5 between them if there is room."""

    def get_ticks(self, min_: float, max_: float, max_ticks: int = 8) -> list[float]:
        """Return the places of ticks."""
        low, high = math.floor(min_), math.ceil(max_)
        decades = [float(power) for power in range(low, high + 1)]
        fine = [power + math.log10(step) for power in decades for step in DECADE_STEPS]
        inside = [[tick for tick in ticks if min_ - 1e-9 <= tick <= max_ + 1e-9] for ticks in (fine, decades)]
        if len(inside[0]) <= max_ticks:
            return inside[0]
        return inside[1][:: max(1, math.ceil(len(inside[1]) / max_ticks))]

    def get_labels_for_ticks(self, ticks: Sequence[float]) -> list[str]:
        """Return the numbers at ticks."""
        return [prefixed_text(10.0**tick) for tick in ticks]


class SmallAxes(PlotWidget, can_focus=False):
    """The axes of a small plot: no more room beside the curves than ticks need, and as many ticks as have rows."""

    DEFAULT_CSS = "SmallAxes > .plot--tick { color: $text; text-style: none; }"

    def __init__(self, x_decades: bool, y_decades: bool) -> None:
        super().__init__(allow_pan_and_zoom=False)
        self._y_decades = y_decades
        self.set_x_formatter(DecadeFormatter() if x_decades else NumericAxisFormatter())
        self.set_y_formatter(DecadeFormatter() if y_decades else NumericAxisFormatter())

    def on_mount(self) -> None:
        """Leave no more room beside the curves than ticks need."""
        self.margin_top, self.margin_bottom, self.margin_left = 0, 1, LEFT_MARGIN

    def on_resize(self, event: Resize) -> None:
        """Use as many ticks as have rows of their own between frame and labels."""
        if not self._y_decades:
            self.set_y_formatter(TickFormatter(event.size.height - self.margin_bottom - 2, upright=True))


class SmallPlot(Vertical):
    """One plot under a title."""

    DEFAULT_CSS = f"""
    SmallPlot {{ height: 1fr; }}
    SmallPlot > Static {{ height: 1; padding-left: {LEFT_MARGIN}; text-wrap: nowrap; }}
    SmallPlot > Static {{ color: $primary; text-style: bold italic; }}
    SmallPlot > SmallAxes {{ height: 1fr; }}
    """

    def __init__(self, title: str, x_decades: bool = False, y_decades: bool = False, id: str | None = None) -> None:  # noqa: A002
        super().__init__(id=id)
        self._title = Static(Text(title))
        self._axes = SmallAxes(x_decades, y_decades)

    def compose(self) -> ComposeResult:
        """Put the title above the axes."""
        yield self._title
        yield self._axes

    def draw(
        self, lines: Sequence[Line], dotted: Sequence[Line] = (), bar: float | None = None, title: str = ""
    ) -> None:
        """Draw lines, dotted lines and a vertical bar in place of the previous ones."""
        if title:
            self._title.update(Text(title))
        axes = self._axes
        axes.clear()
        colour, faint = (self.app.theme_variables.get(name, "") for name in ("primary", "secondary"))
        for x, y in dotted:
            axes.scatter(x, y, marker_style=_rich_style(faint), hires_mode=HiResMode.BRAILLE)
        if bar is not None:
            axes.add_v_line(bar, line_style=_rich_style(faint))
        for x, y in lines:
            if x.size:
                axes.plot(x, y, line_style=_rich_style(colour), hires_mode=HiResMode.BRAILLE)


def _rich_style(colour: str) -> str:
    """Return a colour of the theme as a style; a blended colour is left to the terminal."""
    return colour if colour.startswith("#") and len(colour) == 7 else "default"
