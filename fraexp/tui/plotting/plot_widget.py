"""A plot of curves in a terminal, with logarithmic axes, gaps and confidence bands."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from rich.markup import escape
from rich.style import Style
from textual import on
from textual.app import ComposeResult
from textual.containers import Grid
from textual.events import Click, MouseDown
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.widgets import Static
from textual_hires_canvas import Canvas
from textual_plot import PlotWidget

from fraexp.data.terminal_text import printable
from fraexp.tui.plotting.braille import Window, dash_dots, dot_characters, line_dots
from fraexp.tui.plotting.plotted_curves import REFERENCE, PlotPanel, PlotTrace
from fraexp.tui.plotting.ticks import TickFormatter

ON_DARK = ("#56B4E9", "#E69F00", "#CC79A7", "#00B98B", "#F0E442", "#FF7F45")
"""The palette of Okabe and Ito (2008), light enough for a dark background."""
ON_LIGHT = ("#0063A0", "#B04400", "#8E3B6F", "#00694B", "#6B5A00", "#333333")
"""The same hues, dark enough for a light background."""
NEUTRAL_COLOURS = {True: "#D0D0D0", False: "#303030"}
"""Colours of references, marks and cursor, by whether the background is dark."""
UNSETTLED_SIGN, ISOLATED_SIGN, CURSOR_SIGN = "○", "•", "◉"
"""Signs of an unsettled point, of an isolated point, and of the cursor on a curve."""
DIGITS_PER_CURVE = 3
"""Number of digits along a curve where colours do not distinguish curves."""
MAX_POINTS = 2000
"""Maximum number of points drawn one by one; more than the columns of a terminal."""
Cells = dict[str, list[tuple[int, int]]]
"""Columns and rows on the canvas, by the character drawn there."""
Phase = TypeVar("Phase", float, NDArray[np.float64])
LEFT_CELLS, RIGHT_CELLS = 8, 2
"""Cells beside a plot: for tick labels, and for the end of the last label."""


@dataclass(frozen=True)
class CurveStyles:
    """Colours and digits that distinguish curves."""

    dark: bool = True
    digits: bool = False
    """Whether curves carry digits, as colours do not distinguish them."""

    def style(self, of: int) -> str:
        """Return the style of a curve."""
        colours = ON_DARK if self.dark else ON_LIGHT
        return NEUTRAL_COLOURS[self.dark] if of == REFERENCE else colours[of % len(colours)]


@dataclass
class ViewRange:
    """The visible part of a picture: hidden curves, focus, cursor, bands and phase wrapping."""

    hidden: set[int] = field(default_factory=set)
    focus: int = 0
    cursor: float | None = None
    bands: bool = True
    wrapped: bool = False

    def order(self, traces: Iterable[PlotTrace]) -> list[PlotTrace]:
        """Return the visible traces; the focused one comes last, as it covers the others."""
        seen = [trace for trace in traces if trace.curve not in self.hidden]
        return sorted(seen, key=lambda trace: (trace.curve == self.focus, trace.curve != REFERENCE))


def canvas_cells(found: Iterable[tuple[int, int, str]]) -> Cells:
    """Return characters with their places on the canvas, whose first row and column are the frame."""
    last = {(column + 1, row + 1): character for column, row, character in found}  # later characters cover earlier ones
    cells: Cells = {}
    for place, character in last.items():
        cells.setdefault(character, []).append(place)
    return cells


class PlotCanvas(Canvas):
    """A canvas that has a style even before it has a size, as terminals without colours need."""

    _style: Style | None = None

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return lines; the background style is looked up once instead of for each line."""
        self._style = super().rich_style
        try:
            return super().render_lines(crop)
        finally:
            self._style = None

    @property
    def rich_style(self) -> Style:
        """The background style."""
        return self._style or super().rich_style

    def render_line(self, y: int) -> Strip:
        """Return one line."""
        strip = super().render_line(y)
        return strip if strip.cell_length else Strip.blank(self.size.width, self.rich_style)

    def paint(self, cells: Cells, style: str) -> None:
        """Draw characters: all places of a character in one call, which is faster than a call for each."""
        for character, places in cells.items():
            self.set_pixels(places, character, style)


class Plot(PlotWidget, can_focus=False, inherit_bindings=False):
    """One pair of axes; textual-plot draws the axes and knows the mouse, the curves are drawn here.

    textual-plot offers no public place to draw curves of our own after its axes, nor a way to change the window without
    drawing at each step. So `_rerender` and `_render_plot` are overridden, `_needs_canvas_resize` and
    `_scale_rectangle` are read: private members, which tests/tui/test_toolkit.py watches.
    """

    DEFAULT_CSS: ClassVar[str] = f"""
    Plot {{ height: 1fr; }}
    Plot #plot {{ margin-right: {RIGHT_CELLS}; }}
    Plot > .plot--axis {{ color: $text-muted; }}
    Plot > .plot--tick {{ color: $text-muted; text-style: none; }}
    Plot > .plot--label {{ color: $text; text-style: none; }}
    """

    class Pointed(Message):
        """The plot was clicked."""

        def __init__(self, plot: "Plot", x: float) -> None:
            super().__init__()
            self.plot, self.x = plot, x

    def __init__(self) -> None:
        super().__init__()
        self.panel: PlotPanel | None = None
        self.view_range, self.curve_styles, self.upright = ViewRange(), CurveStyles(), True
        self.window: Window = (0.0, 1.0, 0.0, 1.0)
        """The visible range."""
        self._pressed: tuple[int, int] | None = None
        self._cached_panel: PlotPanel | None = None
        self._cache_key: tuple[object, ...] = ()
        self._cached_cells: dict[tuple[PlotTrace, str], Cells] = {}
        """Characters of each trace's line and band, valid for one panel, window and size; cursor, focus and hidden
        curves do not change them."""
        self._is_batching = False
        """Whether drawing waits for more changes, so that a change draws once."""
        self.set_reactive(Plot.margin_top, 0)
        self.set_reactive(Plot.margin_bottom, 0)
        self.set_reactive(Plot.margin_left, LEFT_CELLS)

    def compose(self) -> ComposeResult:
        """Yield the canvases that textual-plot draws on, by their names there."""
        with Grid():
            for name in ("margin-top", "margin-left", "plot", "margin-bottom"):
                yield PlotCanvas(1, 1, id=name)
        yield Static(id="legend")

    def show(
        self,
        panel: PlotPanel,
        window: Window,
        view_range: ViewRange,
        curve_styles: CurveStyles,
        upright: bool,
        labelled: bool,
    ) -> None:
        """Show a panel in a window; `labelled`, with the labels of its x axis."""
        self.panel, self.view_range, self.curve_styles, self.upright = panel, view_range, curve_styles, upright
        self.window = window
        self.margin_bottom = int(labelled)
        self._is_batching = True
        self.clear()
        self.set_xlimits(*window[:2])
        self.set_ylimits(*window[2:])
        self._is_batching = False
        if self._needs_canvas_resize or not self._scale_rectangle:
            self._rerender()  # after the layout
        else:
            self._render_plot()

    def _rerender(self) -> None:
        if not self._is_batching:
            super()._rerender()

    @property
    def cells(self) -> tuple[int, int]:
        """Columns and rows within the axes."""
        return max(self.size.width - LEFT_CELLS - RIGHT_CELLS - 2, 1), max(self.size.height - self.margin_bottom - 2, 1)

    def column(self, x: float) -> int:
        """Return the column of the canvas at which a value of x lies."""
        return self.get_pixel_from_coordinate(x, self.window[2])[0]

    def _render_plot(self) -> None:
        columns, rows = self.cells
        if self.panel is None or not self._scale_rectangle:
            return
        columns, rows = self._scale_rectangle.width, self._scale_rectangle.height
        if columns < 4 or rows < 1:
            return
        panel = self.panel
        self.set_x_formatter(TickFormatter(columns, logarithmic=panel.spectral))
        self.set_y_formatter(TickFormatter(rows, upright=True, logarithmic=panel.decades, angle=panel.angle))
        self.query_one("#margin-bottom", Canvas).reset()
        super()._render_plot()
        canvas = self.query_one("#plot", PlotCanvas)
        with canvas.batch_refresh():
            self._draw(canvas, panel, (columns, rows))
            title = f" {printable(panel.title)} "[:columns]
            canvas.write_text(1, 0, escape(title) if len(title) > 2 else "")
        if self.margin_bottom:
            self.query_one("#margin-bottom", Canvas).write_text(1, 0, escape(panel.abscissa)[: LEFT_CELLS - 2])

    def _draw(self, canvas: PlotCanvas, panel: PlotPanel, cells: tuple[int, int]) -> None:
        window, traces = self.window, self.view_range.order(panel.traces)
        wrapped = panel.angle and self.view_range.wrapped
        made_for = (window, cells, wrapped)
        if panel is not self._cached_panel or made_for != self._cache_key:
            self._cached_panel, self._cache_key, self._cached_cells = panel, made_for, {}
        across = np.array(window[:2])
        for mark in panel.marks:
            dots = dash_dots(line_dots(across, np.full(2, mark), window, cells), 1, 4)
            canvas.paint(canvas_cells(dot_characters(dots)), f"dim {NEUTRAL_COLOURS[self.curve_styles.dark]}")
        self._draw_cursor_line(canvas)
        for trace in traces if self.view_range.bands else ():
            canvas.paint(self._cells(trace, "band", cells, wrapped), self.curve_styles.style(trace.curve))
        for trace in traces:
            canvas.paint(self._cells(trace, "line", cells, wrapped), self.curve_styles.style(trace.curve))
            self._draw_points(canvas, trace, wrapped)
        for place, trace in enumerate(traces):
            if self.curve_styles.digits and trace.curve != REFERENCE and not trace.model:
                self._draw_digits(canvas, trace.curve, settled_line(trace, wrapped), (place, len(traces)))
            if not self.upright and self.view_range.cursor is not None:
                nearest = nearest_point(trace, self.view_range.cursor)
                if nearest is not None:
                    self._mark(
                        canvas,
                        trace.x[nearest],
                        trace.y[nearest],
                        CURSOR_SIGN,
                        f"bold {self.curve_styles.style(trace.curve)}",
                    )

    def _cells(self, trace: PlotTrace, part: str, cells: tuple[int, int], wrapped: bool) -> Cells:
        """Return the characters of a trace's line, or of its band."""
        key = (trace, part)
        if key not in self._cached_cells:
            x, y, band = settled_line(trace, wrapped)
            if part == "line":
                on, of = (3, 6) if trace.curve == REFERENCE else (1, 2) if trace.model else (1, 1)
                self._cached_cells[key] = canvas_cells(
                    dot_characters(dash_dots(line_dots(x, y, self.window, cells), on, of))
                )
            else:
                low, high = self.window[2] - 1e3, self.window[3] + 1e3
                edges = (
                    []
                    if band is None
                    else [np.where(np.isnan(edge), np.nan, np.clip(edge, low, high)) for edge in band]
                )
                drawn = (dot_characters(dash_dots(line_dots(x, edge, self.window, cells), 1, 3)) for edge in edges)
                self._cached_cells[key] = canvas_cells(cell for found in drawn for cell in found)
        return self._cached_cells[key]

    def _draw_cursor_line(self, canvas: Canvas) -> None:
        cursor = self.view_range.cursor
        if cursor is None or not self.upright or self.panel is None:
            return
        if self.panel.spectral and cursor <= 0:
            return
        x = np.log10(cursor) if self.panel.spectral else cursor
        if not self.window[0] <= x <= self.window[1]:
            return
        for row in range(1, self._scale_rectangle.bottom):
            canvas.set_pixel(self.column(x), row, "│", f"dim {NEUTRAL_COLOURS[self.curve_styles.dark]}")

    def _draw_points(self, canvas: Canvas, trace: PlotTrace, wrapped: bool) -> None:
        known = np.isfinite(trace.x) & np.isfinite(trace.y)
        beside = np.concatenate([[False], trace.settled, [False]])
        alone = trace.settled & ~beside[:-2] & ~beside[2:]
        for chosen, character in ((known & ~trace.settled, UNSETTLED_SIGN), (alone, ISOLATED_SIGN)):
            seen = np.flatnonzero(chosen & (trace.x >= self.window[0]) & (trace.x <= self.window[1]))
            for index in seen[:: max(1, seen.size // MAX_POINTS)]:
                y = wrap_degrees(float(trace.y[index])) if wrapped else float(trace.y[index])
                self._mark(canvas, trace.x[index], y, character, self.curve_styles.style(trace.curve))

    def _draw_digits(self, canvas: Canvas, curve: int, line: "SettledLine", turn: tuple[int, int]) -> None:
        """Draw the digit of a curve at some places along it, which differ between curves."""
        x, y = line.x, line.y
        left, right, bottom, top = self.window
        seen = np.flatnonzero((x >= left) & (x <= right) & (y >= bottom) & (y <= top))
        if not seen.size:
            return
        for index in range(DIGITS_PER_CURVE):
            share = (index + (turn[0] + 0.5) / turn[1]) / DIGITS_PER_CURVE
            wanted = left + share * (right - left)
            found = seen[np.argmin(np.abs(x[seen] - wanted))]
            self._mark(canvas, x[found], y[found], curve_digit(curve), f"bold {self.curve_styles.style(curve)}")

    def _mark(self, canvas: Canvas, x: float, y: float, character: str, style: str) -> None:
        left, right, bottom, top = self.window
        if left <= x <= right and bottom <= y <= top:
            column, row = self.get_pixel_from_coordinate(x, y)
            inner = self._scale_rectangle
            canvas.set_pixel(min(column, inner.width), min(max(row, 1), inner.height), character, style)

    @on(PlotWidget.ScaleChanged)
    def _follow_zoom(self, event: PlotWidget.ScaleChanged) -> None:
        """Follow the mouse: the axes have changed, and curves are drawn before the stack responds."""
        self.window = event.x_min, event.x_max, event.y_min, event.y_max

    def on_mouse_down(self, event: MouseDown) -> None:
        """Remember the place, as dragging from there is not a click."""
        self._pressed = event.screen_x, event.screen_y

    def on_click(self, event: Click) -> None:
        """Post the place of a click."""
        canvas = self.query_one("#plot", Canvas)
        if self._pressed == (event.screen_x, event.screen_y) and canvas.region.contains(*event.screen_offset):
            x, _ = self.get_coordinate_from_pixel(event.screen_x - canvas.region.x, 1)
            self.post_message(self.Pointed(self, x))


def curve_digit(of: int) -> str:
    """Return the character of a curve: 1 to 9, then letters."""
    return "123456789abcdefghijklmnopqrstuvwxyz"[of % 35]


def wrap_degrees(phase: Phase) -> Phase:
    """Return a phase [deg] within ±180."""
    return (phase + 180) % 360 - 180


class SettledLine(NamedTuple):
    """The line through the settled points of a trace; arrays of shape (n,)."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    """NaN at unsettled points."""
    band: NDArray[np.float64] | None
    """Lower and upper 95 % limit of y, shape (2, n); None if unknown."""


def settled_line(trace: PlotTrace, wrapped: bool = False) -> SettledLine:
    """Return the line through the settled points; `wrapped`, within ±180 and with gaps where the phase jumps."""
    y = np.where(trace.settled, trace.y, np.nan)
    band = None if trace.band is None else np.where(trace.settled, trace.band, np.nan)
    if not wrapped:
        return SettledLine(trace.x, y, band)
    inside = wrap_degrees(y)
    jumps = np.flatnonzero(np.abs(np.diff(inside)) > 180) + 1
    band = None if band is None else np.insert(band + (inside - y), jumps, np.nan, axis=1)
    return SettledLine(np.insert(trace.x, jumps, np.nan), np.insert(inside, jumps, np.nan), band)


def nearest_point(trace: PlotTrace, cursor: float) -> int | None:
    """Return the index of the finite point nearest to the cursor; None without one."""
    known = np.flatnonzero(np.isfinite(trace.y))
    if not known.size:
        return None
    return int(known[np.argmin(np.abs(trace.at[known] - cursor))])


def finite_span(values: Sequence[NDArray[np.float64]]) -> tuple[float, float] | None:
    """Return minimum and maximum of all finite values; None without one."""
    known = np.concatenate([np.ravel(of) for of in values]) if values else np.zeros(0)
    known = known[np.isfinite(known)]
    return (float(known.min()), float(known.max())) if known.size else None
