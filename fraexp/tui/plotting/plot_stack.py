"""A stack of plots with shared axes, zoom, pan and cursor."""

from collections.abc import Mapping, Sequence

import numpy as np
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Resize
from textual.message import Message

from fraexp.data.texts import printable
from fraexp.figures.elements.bands import finite_span, ordinate_limits
from fraexp.figures.elements.view import FREQUENCY_KINDS, View
from fraexp.tui.plotting.braille import DOTS_ACROSS, DOTS_DOWN, Window
from fraexp.tui.plotting.curve_styles import CurveStyles, curve_digit
from fraexp.tui.plotting.panel_drawing import ViewRange, nearest_point, settled_line
from fraexp.tui.plotting.plot_widget import LEFT_CELLS, RIGHT_CELLS, TOP_CELLS, Plot
from fraexp.tui.plotting.plotted_curves import Picture, PlotPanel, PlotTrace

MAX_PANELS = 4
"""Maximum number of panels at once."""
MIN_PANEL_ROWS = 5
"""Minimum height of a panel, with its frame."""
AXIS_MARGIN = 0.02
"""Fraction of its span by which an axis extends beyond the curves."""
Span = tuple[float, float]


class PlotStack(Vertical):
    """The panels of a picture that fit."""

    DEFAULT_CSS = "PlotStack { width: 1fr; height: 1fr; }"

    class Moved(Message):
        """The cursor has moved."""

    class Fitted(Message):
        """The number of panels that fit may have changed."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - as Textual calls it
        super().__init__(id=id)
        self.picture: Picture | None = None
        self.view_range = ViewRange()
        self.first = 0
        """Index of the first visible panel, if not all fit."""
        self.min_panel_rows = MIN_PANEL_ROWS
        self.whole_x: Span | None = None
        """Range of x in which all is seen; None for that of the curves."""
        self._x: dict[int, Span] = {}
        self._y: dict[int, Span] = {}

    def compose(self) -> ComposeResult:
        """Yield a plot for each panel."""
        for _ in range(MAX_PANELS):
            yield Plot()

    def on_mount(self) -> None:
        """Hide all plots, and draw again when the theme changes."""
        for plot in self.query(Plot):
            plot.display = False
        self.watch(self.app, "theme", self.draw, init=False)

    @on(Resize)
    def _handle_resize(self) -> None:
        self.draw()
        self.post_message(self.Fitted())

    def display_picture(self, picture: Picture | None, cursor: bool = True) -> None:
        """Show another picture, with a cursor if wanted; the zoom is kept where the axis is the same."""
        before, self.picture = self.picture, picture
        same = before and picture and before.panels[0].abscissa == picture.panels[0].abscissa
        if not (same and before and picture and before.upright == picture.upright):
            self._x, self.view_range.cursor = {}, None
        if not (same and before and picture and before.kind == picture.kind):
            self._y, self.first = {}, 0
        if self.view_range.cursor is None and cursor:
            self._place_cursor()
        self.draw()

    @property
    def curve_styles(self) -> CurveStyles:
        """The styles that distinguish curves on this terminal."""
        return CurveStyles.of_app(self.app)

    def legend(self, labels: Mapping[int, str]) -> Text:
        """Return a line for each curve: a sample of its line, its digit where colours say nothing, and its name."""
        styles, text = self.curve_styles, Text(no_wrap=True, overflow="ellipsis")
        for place, label in labels.items():
            digit = f"{curve_digit(place)} " if styles.digits else ""
            text.append("\n" if text else "").append(f"━━ {digit}", styles.style(place)).append(printable(label))
        return text

    def panels(self) -> list[tuple[int, PlotPanel]]:
        """Return the panels that fit, with their indices."""
        fitting = max(1, min(MAX_PANELS, self.size.height // self.min_panel_rows))
        every = list(enumerate(self.picture.panels if self.picture else ()))
        self.first = max(0, min(self.first, len(every) - fitting))
        return every[self.first : self.first + fitting]

    def beyond(self) -> tuple[int, int]:
        """Return the number of panels before and after the visible ones."""
        shown, every = len(self.panels()), len(self.picture.panels if self.picture else ())
        return self.first, every - self.first - shown

    def turn(self, panels: int) -> None:
        """Show later panels, or earlier ones."""
        self.first += panels
        self.draw()

    def draw(self) -> None:
        """Draw the visible panels."""
        plots = list(self.query(Plot))
        shown = self.panels() if self.picture else []
        for plot in plots[len(shown) :]:
            plot.display = False
        for place, ((index, panel), plot) in enumerate(zip(shown, plots, strict=False)):
            last = place + 1 == len(shown) or shown[place + 1][1].axis != panel.axis
            plot.display = True
            assert self.picture is not None
            plot.show(panel, self.window(index), self.view_range, self.curve_styles, self.picture.upright, last)

    def window(self, index: int) -> Window:
        """Return the visible range of a panel: the zoomed one, else all of the visible curves."""
        assert self.picture is not None
        panel = self.picture.panels[index]
        alike = [of for of in self.picture.panels if of.axis == panel.axis]
        x = self._x.get(panel.axis) or self.whole_x
        x = x or _full_x_span([trace for of in alike for trace in self._visible_traces(of)])
        y = self._y.get(index) or self._full_y_span(panel)
        if self.picture.equal and panel.axis not in self._x and index not in self._y:
            x, y = self._equal_scales(x, y)
        return *x, *y

    def _visible_traces(self, panel: PlotPanel) -> list[PlotTrace]:
        return self.view_range.order(panel.traces) or list(panel.traces)

    def _full_y_span(self, panel: PlotPanel) -> Span:
        if panel.span:
            return panel.span
        if panel.angle and self.view_range.wrapped:
            return -190.0, 190.0
        traces = self._visible_traces(panel)
        lines = [settled_line(trace) for trace in traces]
        bands = [(line.y, line.band) for line in lines if line.band is not None and self.view_range.bands]
        core = ordinate_limits([line.y for line in lines], bands) or finite_span([trace.y for trace in traces])
        return _widen(core or (0.0, 1.0), AXIS_MARGIN)

    def _equal_scales(self, x: Span, y: Span) -> tuple[Span, Span]:
        """Return wider spans with equal scales in both directions."""
        columns, rows = self.size.width - LEFT_CELLS - RIGHT_CELLS, self.size.height - TOP_CELLS - 1
        if columns < 1 or rows < 1:
            return x, y
        across, down = (x[1] - x[0]) / (DOTS_ACROSS * columns), (y[1] - y[0]) / (DOTS_DOWN * rows)
        return _widen(x, (max(down / across, 1) - 1) / 2), _widen(y, (max(across / down, 1) - 1) / 2)

    def zoom(self, x: float = 1.0, y: float = 1.0) -> None:
        """Zoom in by factors around the cursor; y around the middle where the cursor is a vertical line."""
        windows = [(index, panel, self.window(index)) for index, panel in self.panels()]
        for index, panel, (left, right, bottom, top) in windows:
            around_x, around_y = self._cursor_point(panel)
            if x != 1:
                middle = around_x if around_x is not None and left < around_x < right else (left + right) / 2
                self._x[panel.axis] = middle - (middle - left) / x, middle + (right - middle) / x
            if y != 1:
                middle = around_y if around_y is not None and bottom < around_y < top else (bottom + top) / 2
                self._y[index] = middle - (middle - bottom) / y, middle + (top - middle) / y
        self.draw()

    def pan(self, x: float = 0.0, y: float = 0.0) -> None:
        """Move the visible range by fractions of it."""
        windows = [(index, panel, self.window(index)) for index, panel in self.panels()]
        for index, panel, (left, right, bottom, top) in windows:
            if x:
                self._x[panel.axis] = left + x * (right - left), right + x * (right - left)
            if y:
                self._y[index] = bottom + y * (top - bottom), top + y * (top - bottom)
        self.draw()

    def view(self) -> View:
        """Return the visible part of the figure: frequency range and phase wrapping."""
        if self.picture is None or self.picture.kind not in FREQUENCY_KINDS:
            return View()
        zoomed = next((self._x[of.axis] for of in self.picture.panels if of.axis in self._x), None)
        band = (float(10 ** zoomed[0]), float(10 ** zoomed[1])) if zoomed else None
        return View(band, self.view_range.wrapped and self.picture.kind == "bode")

    def home(self) -> None:
        """Show all again."""
        self._x, self._y = {}, {}
        self.draw()

    @on(Plot.Reached)
    def _follow_mouse(self, event: Plot.Reached) -> None:
        """Follow the mouse: plots with a shared axis move together."""
        event.stop()
        for (index, panel), plot in zip(self.panels(), self.query(Plot), strict=False):
            if plot is event.plot:
                self._reach(index, panel, event.window)
        self.draw()
        self.post_message(self.Moved())

    def _reach(self, index: int, panel: PlotPanel, window: Window) -> None:
        """Show another window of a panel; the range of an axis that has not changed stays open to other curves."""
        before = self.window(index)
        if window[:2] != before[:2]:
            self._x[panel.axis] = window[:2]
        if window[2:] != before[2:]:
            self._y[index] = window[2:]

    @on(Plot.Pointed)
    def _handle_click(self, event: Plot.Pointed) -> None:
        panel = event.plot.panel
        if panel and self.picture and self.picture.upright:
            self.place(10**event.x if panel.spectral else event.x)
        elif panel:
            self._point_at(panel, event.x, event.y)

    def _point_at(self, panel: PlotPanel, x: float, y: float) -> None:
        """Put the cursor on the point of the focused curve that is nearest on the screen."""
        trace = next((of for of in self._visible_traces(panel) if of.curve == self.view_range.focus), None)
        if trace is not None and np.isfinite(trace.y).any():
            left, right, bottom, top = self.window(self.picture.panels.index(panel) if self.picture else 0)
            away = np.hypot((trace.x - x) / (right - left), (trace.y - y) / (top - bottom))
            self.place(float(trace.at[np.nanargmin(away)]))

    def place(self, cursor: float) -> None:
        """Put the cursor on the point of the focused curve nearest to a value."""
        trace = self._cursor_trace()
        if trace is not None:
            nearest = nearest_point(trace, cursor)
            self.view_range.cursor = cursor if nearest is None else float(trace.at[nearest])
            self.draw()
            self.post_message(self.Moved())

    def step(self, towards: int) -> None:
        """Move the cursor by columns, to the next point of the focused curve."""
        trace = self._cursor_trace()
        if trace is None or self.view_range.cursor is None or self.picture is None:
            return
        at = np.unique(trace.at[np.isfinite(trace.y)])
        axis = np.log10(at) if self.picture.upright and self.picture.panels[0].spectral else at
        here = np.log10(self.view_range.cursor) if axis is not at else self.view_range.cursor
        left, right = self.window(0)[:2] if self.picture.upright else (axis[0], axis[-1])
        cell = (right - left) / max(self.size.width - LEFT_CELLS - RIGHT_CELLS, 1)
        away = (axis - here) * np.sign(towards)
        ahead, far = np.flatnonzero(away > 0), np.flatnonzero(away >= abs(towards) * cell)
        if far.size:
            self.place(float(at[far[np.argmin(away[far])]]))
        elif ahead.size:
            self.place(float(at[ahead[np.argmax(away[ahead])]]))

    def _place_cursor(self) -> None:
        trace = self._cursor_trace()
        if trace is not None:
            at = np.sort(trace.at[np.isfinite(trace.y)])
            self.view_range.cursor = float(at[len(at) // 2])

    def _cursor_trace(self) -> PlotTrace | None:
        """Return the trace that the cursor follows: that of the focused curve, else the first."""
        traces = [trace for panel in (self.picture.panels if self.picture else ()) for trace in panel.traces]
        having = [trace for trace in traces if np.isfinite(trace.y).any() and not trace.model]
        return next((trace for trace in having if trace.curve == self.view_range.focus), having[0] if having else None)

    def _cursor_point(self, panel: PlotPanel) -> tuple[float | None, float | None]:
        """Return x and y of the cursor in a panel; None where it has none."""
        cursor = self.view_range.cursor
        if cursor is None or self.picture is None or (panel.spectral and cursor <= 0):
            return None, None
        if self.picture.upright:
            return (float(np.log10(cursor)) if panel.spectral else cursor), None
        trace = next((of for of in panel.traces if of.curve == self.view_range.focus), None)
        nearest = nearest_point(trace, cursor) if trace else None
        return (None, None) if trace is None or nearest is None else (float(trace.x[nearest]), float(trace.y[nearest]))


def _full_x_span(traces: Sequence[PlotTrace]) -> Span:
    found = finite_span([trace.x[np.isfinite(trace.y)] for trace in traces]) or (0.0, 1.0)
    return _widen(found, AXIS_MARGIN / 2)


def _widen(span: Span, share: float) -> Span:
    """Return a span widened by a fraction of it at each end; an empty span gets some width."""
    low, high = span
    room = share * (high - low) if high > low else max(0.05 * abs(low), 1e-3)
    return low - room, high + room
