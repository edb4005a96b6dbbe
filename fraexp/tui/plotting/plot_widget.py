"""Curves in a terminal: a plot with a logarithmic axis, gaps and bands, and several above each other."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, TypeVar

import numpy as np
from rich.markup import escape
from rich.style import Style
from textual.app import ComposeResult
from textual.containers import Grid
from textual.events import Click, MouseDown
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.widgets import Static
from textual_hires_canvas import Canvas
from textual_plot import PlotWidget

from fraexp.figures.elements.labels import printable
from fraexp.tui.plotting.braille import Window, characters, line, sparse
from fraexp.tui.plotting.plotted_curves import REFERENCE, PlotPanel, PlotTrace
from fraexp.tui.plotting.ticks import Ticks

ON_DARK = ("#56B4E9", "#E69F00", "#CC79A7", "#00B98B", "#F0E442", "#FF7F45")
"""Okabe and Ito's palette (2008), light enough for a dark ground."""
ON_LIGHT = ("#0063A0", "#B04400", "#8E3B6F", "#00694B", "#6B5A00", "#333333")
"""The same hues, dark enough for a light ground."""
PLAIN = {True: "#D0D0D0", False: "#303030"}
"""Of what belongs to no curve, on a dark and on a light ground."""
UNSETTLED, ALONE, HERE = "○", "•", "◉"
"""A point that had not settled, one that no line reaches, and where the cursor is on a curve."""
DIGITS = 3
"""Times that a curve's digit stands on it where colours do not tell curves apart."""
MOST_POINTS = 2000
"""Points that are looked at one by one; more than a terminal has cells across."""
Cells = list[tuple[int, int, str]]
"""Column, row and character."""
Phase = TypeVar("Phase", float, np.ndarray)
LEFT, RIGHT = 8, 2
"""Cells beside a plot: for its ticks, and for the end of the last label."""


@dataclass(frozen=True)
class Look:
    """How curves are told apart."""

    dark: bool = True
    digits: bool = False
    """Whether each curve carries its digit, since colours do not tell."""

    def style(self, of: int) -> str:
        """Return the style of a curve."""
        colours = ON_DARK if self.dark else ON_LIGHT
        return PLAIN[self.dark] if of == REFERENCE else colours[of % len(colours)]


@dataclass
class Sight:
    """What of a picture is to be seen, and how."""

    hidden: set[int] = field(default_factory=set)
    focus: int = 0
    cursor: float | None = None
    bands: bool = True
    wrapped: bool = False

    def order(self, traces: Iterable[PlotTrace]) -> list[PlotTrace]:
        """Return the visible traces; what must be seen comes last, as it covers the others."""
        seen = [trace for trace in traces if trace.of not in self.hidden]
        return sorted(seen, key=lambda trace: (trace.of == self.focus, trace.of != REFERENCE))


class Ground(Canvas):
    """A canvas whose lines have a style even before it has a size, as a terminal without colours needs."""

    _style: Style | None = None

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return lines; the style of their ground is looked up once, not for each of them."""
        self._style = super().rich_style
        try:
            return super().render_lines(crop)
        finally:
            self._style = None

    @property
    def rich_style(self) -> Style:
        """The style of the ground."""
        return self._style or super().rich_style

    def render_line(self, y: int) -> Strip:
        """Return one line."""
        strip = super().render_line(y)
        return strip if strip.cell_length else Strip.blank(self.size.width, self.rich_style)

    def paint(self, cells: Cells, style: str) -> None:
        """Write characters into the frame, without the test and the call that each would cost by itself."""
        width, height = self._canvas_size
        for column, row, character in cells:
            if column + 1 < width and row + 1 < height:
                self._buffer[row + 1][column + 1] = character
                self._styles[row + 1][column + 1] = style
        self.refresh()


class Plot(PlotWidget, can_focus=False, inherit_bindings=False):
    """One pair of axes; textual-plot draws the axes and knows the mouse, the curves are drawn here."""

    DEFAULT_CSS: ClassVar[str] = f"""
    Plot {{ height: 1fr; }}
    Plot #plot {{ margin-right: {RIGHT}; }}
    Plot > .plot--axis {{ color: $text-muted; }}
    Plot > .plot--tick {{ color: $text-muted; text-style: none; }}
    Plot > .plot--label {{ color: $text; text-style: none; }}
    """

    class Pointed(Message):
        """Somewhere was clicked."""

        def __init__(self, plot: "Plot", x: float) -> None:
            super().__init__()
            self.plot, self.x = plot, x

    def __init__(self) -> None:
        super().__init__()
        self.panel: PlotPanel | None = None
        self.sight, self.look, self.upright = Sight(), Look(), True
        self._pressed: tuple[int, int] | None = None
        self._made_of: PlotPanel | None = None
        self._made_for: tuple[object, ...] = ()
        self._made: dict[tuple[int, str], Cells] = {}
        """What the parts of a panel's traces have become in the cells, by the trace's id and part: as long as it is
        seen so, whatever the cursor, the focus and what is hidden."""
        self._waiting = False
        """Whether more is to come before it is drawn: once a change, straight into the canvases."""
        self.set_reactive(Plot.margin_top, 0)
        self.set_reactive(Plot.margin_bottom, 0)
        self.set_reactive(Plot.margin_left, LEFT)

    def compose(self) -> ComposeResult:
        """Make what textual-plot draws on, by the names that it knows."""
        with Grid():
            for name in ("margin-top", "margin-left", "plot", "margin-bottom"):
                yield Ground(1, 1, id=name)
        yield Static(id="legend")

    def show(self, panel: PlotPanel, window: Window, sight: Sight, look: Look, upright: bool, labelled: bool) -> None:
        """Show a panel through a window; `labelled`, with the labels of its x axis."""
        self.panel, self.sight, self.look, self.upright = panel, sight, look, upright
        self.margin_bottom = int(labelled)
        self._waiting = True
        self.clear()
        self.set_xlimits(*window[:2])
        self.set_ylimits(*window[2:])
        self._waiting = False
        if self._needs_canvas_resize or not self._scale_rectangle:
            self._rerender()  # once there is room
        else:
            self._render_plot()

    def _rerender(self) -> None:
        if not self._waiting:
            super()._rerender()

    @property
    def cells(self) -> tuple[int, int]:
        """Columns and rows within the axes."""
        return max(self.size.width - LEFT - RIGHT - 2, 1), max(self.size.height - self.margin_bottom - 2, 1)

    @property
    def window(self) -> Window:
        """What is seen."""
        return self._x_min, self._x_max, self._y_min, self._y_max

    def column(self, x: float) -> int:
        """Return the column of the canvas at which a value of x lies."""
        return self.get_pixel_from_coordinate(x, self._y_min)[0]

    def _render_plot(self) -> None:
        columns, rows = self.cells
        if self.panel is None or not self._scale_rectangle:
            return
        columns, rows = self._scale_rectangle.width, self._scale_rectangle.height
        if columns < 4 or rows < 1:
            return
        panel = self.panel
        self.set_x_formatter(Ticks(columns, logarithmic=panel.spectral))
        self.set_y_formatter(Ticks(rows, upright=True, logarithmic=panel.decades, angle=panel.angle))
        self.query_one("#margin-bottom", Canvas).reset()
        super()._render_plot()
        canvas = self.query_one("#plot", Ground)
        with canvas.batch_refresh():
            self._draw(canvas, panel, (columns, rows))
            title = f" {printable(panel.title)} "[:columns]
            canvas.write_text(1, 0, escape(title) if len(title) > 2 else "")
        if self.margin_bottom:
            self.query_one("#margin-bottom", Canvas).write_text(1, 0, escape(panel.abscissa)[: LEFT - 2])

    def _draw(self, canvas: Ground, panel: PlotPanel, cells: tuple[int, int]) -> None:
        window, traces = self.window, self.sight.order(panel.traces)
        wrapped = panel.angle and self.sight.wrapped
        made_for = (window, cells, wrapped)
        if panel is not self._made_of or made_for != self._made_for:
            self._made_of, self._made_for, self._made = panel, made_for, {}
        across = np.array(window[:2])
        for mark in panel.marks:
            dots = sparse(line(across, np.full(2, mark), window, cells), 1, 4)
            canvas.paint(characters(dots), f"dim {PLAIN[self.look.dark]}")
        self._draw_cursor_line(canvas)
        for trace in traces if self.sight.bands else ():
            canvas.paint(self._cells(trace, "band", cells, wrapped), self.look.style(trace.of))
        for trace in traces:
            canvas.paint(self._cells(trace, "line", cells, wrapped), self.look.style(trace.of))
            self._draw_points(canvas, trace, wrapped)
        for place, trace in enumerate(traces):
            if self.look.digits and trace.of != REFERENCE and not trace.model:
                self._draw_digits(canvas, trace.of, line_of(trace, wrapped)[:2], (place, len(traces)))
            if not self.upright and self.sight.cursor is not None:
                nearest = nearest_point(trace, self.sight.cursor)
                if nearest is not None:
                    self._mark(canvas, trace.x[nearest], trace.y[nearest], HERE, f"bold {self.look.style(trace.of)}")

    def _cells(self, trace: PlotTrace, part: str, cells: tuple[int, int], wrapped: bool) -> Cells:
        """Return the characters of a trace's line, or of its band."""
        key = (id(trace), part)
        if key not in self._made:
            x, y, band = line_of(trace, wrapped)
            if part == "line":
                on, of = (3, 6) if trace.of == REFERENCE else (1, 2) if trace.model else (1, 1)
                self._made[key] = characters(sparse(line(x, y, self.window, cells), on, of))
            else:
                low, high = self.window[2] - 1e3, self.window[3] + 1e3
                edges = (
                    []
                    if band is None
                    else [np.where(np.isnan(edge), np.nan, np.clip(edge, low, high)) for edge in band]
                )
                drawn = (characters(sparse(line(x, edge, self.window, cells), 1, 3)) for edge in edges)
                self._made[key] = [cell for found in drawn for cell in found]
        return self._made[key]

    def _draw_cursor_line(self, canvas: Canvas) -> None:
        cursor = self.sight.cursor
        if cursor is None or not self.upright or self.panel is None:
            return
        if self.panel.spectral and cursor <= 0:
            return
        x = np.log10(cursor) if self.panel.spectral else cursor
        if not self.window[0] <= x <= self.window[1]:
            return
        for row in range(1, self._scale_rectangle.bottom):
            canvas.set_pixel(self.column(x), row, "│", f"dim {PLAIN[self.look.dark]}")

    def _draw_points(self, canvas: Canvas, trace: PlotTrace, wrapped: bool) -> None:
        known = np.isfinite(trace.x) & np.isfinite(trace.y)
        beside = np.concatenate([[False], trace.settled, [False]])
        alone = trace.settled & ~beside[:-2] & ~beside[2:]
        for chosen, character in ((known & ~trace.settled, UNSETTLED), (alone, ALONE)):
            seen = np.flatnonzero(chosen & (trace.x >= self._x_min) & (trace.x <= self._x_max))
            for index in seen[:: max(1, seen.size // MOST_POINTS)]:
                y = turned(float(trace.y[index])) if wrapped else float(trace.y[index])
                self._mark(canvas, trace.x[index], y, character, self.look.style(trace.of))

    def _draw_digits(
        self, canvas: Canvas, of: int, points: tuple[np.ndarray, np.ndarray], turn: tuple[int, int]
    ) -> None:
        """Put a curve's digit on it at some places, other ones than those of the other curves."""
        x, y = points
        left, right, bottom, top = self.window
        seen = np.flatnonzero((x >= left) & (x <= right) & (y >= bottom) & (y <= top))
        if not seen.size:
            return
        for index in range(DIGITS):
            share = (index + (turn[0] + 0.5) / turn[1]) / DIGITS
            wanted = left + share * (right - left)
            found = seen[np.argmin(np.abs(x[seen] - wanted))]
            self._mark(canvas, x[found], y[found], digit(of), f"bold {self.look.style(of)}")

    def _mark(self, canvas: Canvas, x: float, y: float, character: str, style: str) -> None:
        left, right, bottom, top = self.window
        if left <= x <= right and bottom <= y <= top:
            column, row = self.get_pixel_from_coordinate(x, y)
            inner = self._scale_rectangle
            canvas.set_pixel(min(column, inner.width), min(max(row, 1), inner.height), character, style)

    def on_mouse_down(self, event: MouseDown) -> None:
        """Remember where: moving on from there is no click."""
        self._pressed = event.screen_x, event.screen_y

    def on_click(self, event: Click) -> None:
        """Tell where was clicked."""
        canvas = self.query_one("#plot", Canvas)
        if self._pressed == (event.screen_x, event.screen_y) and canvas.region.contains(*event.screen_offset):
            x, _ = self.get_coordinate_from_pixel(event.screen_x - canvas.region.x, 1)
            self.post_message(self.Pointed(self, x))


def digit(of: int) -> str:
    """Return the one character that a curve is told by: 1 to 9, then letters."""
    return "123456789abcdefghijklmnopqrstuvwxyz"[of % 35]


def turned(phase: Phase) -> Phase:
    """Return a phase [deg] within ±180."""
    return (phase + 180) % 360 - 180


def line_of(trace: PlotTrace, wrapped: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return x, y and band of the line through the settled points; `wrapped`, with gaps where the phase jumps."""
    y = np.where(trace.settled, trace.y, np.nan)
    band = None if trace.band is None else np.where(trace.settled, trace.band, np.nan)
    if not wrapped:
        return trace.x, y, band
    inside = turned(y)
    jumps = np.flatnonzero(np.abs(np.diff(inside)) > 180) + 1
    band = None if band is None else np.insert(band + (inside - y), jumps, np.nan, axis=1)
    return np.insert(trace.x, jumps, np.nan), np.insert(inside, jumps, np.nan), band


def nearest_point(trace: PlotTrace, cursor: float) -> int | None:
    """Return the index of the point nearest to the cursor; None if there is none."""
    known = np.flatnonzero(np.isfinite(trace.y))
    if not known.size:
        return None
    return int(known[np.argmin(np.abs(trace.at[known] - cursor))])


def span_of(values: Sequence[np.ndarray]) -> tuple[float, float] | None:
    """Return least and greatest of all values that are finite; None if none is."""
    known = np.concatenate([np.ravel(of) for of in values]) if values else np.zeros(0)
    known = known[np.isfinite(known)]
    return (float(known.min()), float(known.max())) if known.size else None
