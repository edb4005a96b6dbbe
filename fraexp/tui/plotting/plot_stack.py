"""A stack of plots with shared axes, zoom, pan and cursor; the Bode view of responses is one."""

import asyncio
from collections.abc import Sequence

import numpy as np
from textual import on
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Resize
from textual.message import Message
from textual_plot import PlotWidget

from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.elements.view import FREQUENCY_KINDS, View
from fraexp.tui.plotting.braille import DOTS_ACROSS, DOTS_DOWN, Window
from fraexp.tui.plotting.plot_widget import (
    LEFT_CELLS,
    RIGHT_CELLS,
    CurveStyles,
    Plot,
    ViewRange,
    finite_span,
    nearest_point,
    settled_line,
)
from fraexp.tui.plotting.plotted_curves import Picture, PlotPanel, PlotTrace, Reference, bode_picture

MAX_PANELS = 4
"""Maximum number of panels at once."""
MIN_PANEL_ROWS = 5
"""Minimum height of a panel, with its frame."""
AXIS_MARGIN = 0.02
"""Fraction of its span by which an axis extends beyond the curves."""
BAND_MARGIN = 0.25
"""Fraction by which it extends further for confidence bands."""
Span = tuple[float, float]


class PlotStack(Vertical):
    """The panels of a picture that fit."""

    DEFAULT_CSS = "PlotStack { width: 1fr; height: 1fr; }"

    class Moved(Message):
        """The cursor has moved."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - as Textual calls it
        super().__init__(id=id)
        self.picture: Picture | None = None
        self.view_range = ViewRange()
        self.first = 0
        """Index of the first visible panel, if not all fit."""
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

    def display_picture(self, picture: Picture | None) -> None:
        """Show another picture; the zoom is kept where the axis is the same."""
        before, self.picture = self.picture, picture
        same = before and picture and before.panels[0].abscissa == picture.panels[0].abscissa
        if not (same and before and picture and before.upright == picture.upright):
            self._x, self.view_range.cursor = {}, None
        if not (same and before and picture and before.kind == picture.kind):
            self._y, self.first = {}, 0
        if self.view_range.cursor is None:
            self._place_cursor()
        self.draw()

    @property
    def curve_styles(self) -> CurveStyles:
        """The styles that distinguish curves on this terminal."""
        plain = bool(getattr(self.app, "plain", False))
        return CurveStyles(self.app.current_theme.dark, self.app.no_color or plain)

    def panels(self) -> list[tuple[int, PlotPanel]]:
        """Return the panels that fit, with their indices."""
        fitting = max(1, min(MAX_PANELS, self.size.height // MIN_PANEL_ROWS))
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
        x = self._x.get(panel.axis) or _full_x_span([trace for of in alike for trace in self._visible_traces(of)])
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
        core = finite_span([line.y for line in lines]) or finite_span([trace.y for trace in traces]) or (0.0, 1.0)
        low, high = _widen(core, AXIS_MARGIN)
        edges = finite_span([line.band for line in lines if line.band is not None])
        if edges and self.view_range.bands:
            room = BAND_MARGIN * (high - low)
            low, high = min(low, max(low - room, edges[0])), max(high, min(high + room, edges[1]))
        return low, high

    def _equal_scales(self, x: Span, y: Span) -> tuple[Span, Span]:
        """Return wider spans with equal scales in both directions."""
        columns, rows = self.size.width - LEFT_CELLS - RIGHT_CELLS - 2, self.size.height - 3
        if columns < 1 or rows < 1:
            return x, y
        across, down = (x[1] - x[0]) / (DOTS_ACROSS * columns), (y[1] - y[0]) / (DOTS_DOWN * rows)
        return _widen(x, (max(down / across, 1) - 1) / 2), _widen(y, (max(across / down, 1) - 1) / 2)

    def zoom(self, x: float = 1.0, y: float = 1.0) -> None:
        """Zoom in by factors: x around the cursor, y around the middle."""
        zoomed = set()
        for index, panel in self.panels():
            left, right, bottom, top = self.window(index)
            if x != 1 and panel.axis not in zoomed:
                zoomed.add(panel.axis)
                around = self._cursor_x(panel)
                middle = around if around is not None and left < around < right else (left + right) / 2
                self._x[panel.axis] = middle - (middle - left) / x, middle + (right - middle) / x
            if y != 1:
                middle = (bottom + top) / 2
                self._y[index] = middle - (middle - bottom) / y, middle + (top - middle) / y
        self.draw()

    def pan(self, x: float = 0.0, y: float = 0.0) -> None:
        """Move the visible range by fractions of it."""
        moved = set()
        for index, panel in self.panels():
            left, right, bottom, top = self.window(index)
            if x and panel.axis not in moved:
                moved.add(panel.axis)
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

    @on(PlotWidget.ScaleChanged)
    def _follow_zoom(self, event: PlotWidget.ScaleChanged) -> None:
        """Follow the mouse: plots with a shared axis move together."""
        event.stop()
        for (index, panel), plot in zip(self.panels(), self.query(Plot), strict=False):
            if plot is event.plot:
                before = self.window(index)
                if (event.x_min, event.x_max) != before[:2]:
                    self._x[panel.axis] = event.x_min, event.x_max
                if (event.y_min, event.y_max) != before[2:]:
                    self._y[index] = event.y_min, event.y_max
        self.draw()

    @on(Plot.Pointed)
    def _handle_click(self, event: Plot.Pointed) -> None:
        panel = event.plot.panel
        if panel and self.picture and self.picture.upright:
            self.place(10**event.x if panel.spectral else event.x)

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
        cell = (right - left) / max(self.size.width - LEFT_CELLS - RIGHT_CELLS - 2, 1)
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

    def _cursor_x(self, panel: PlotPanel) -> float | None:
        cursor = self.view_range.cursor
        if cursor is None or self.picture is None or not self.picture.upright or (panel.spectral and cursor <= 0):
            return None
        return float(np.log10(cursor)) if panel.spectral else cursor


class BodeView(PlotStack):
    """Magnitude and phase of responses over frequency."""

    def show(self, responses: Sequence[tuple[str, FrequencyResponse]], reference: Reference | None = None) -> None:
        """Show labelled responses, which must share a unit, and a reference."""
        self.run_worker(self._show(list(responses), reference), exclusive=True, exit_on_error=True)

    async def _show(self, responses: list[tuple[str, FrequencyResponse]], reference: Reference | None) -> None:
        shown = [ShownResult(label, Result(Outcome.OK, response=response)) for label, response in responses]
        having = [of for of in shown if of.response is not None]
        picture = await asyncio.to_thread(bode_picture, having, reference) if having else None
        self.display_picture(picture)


def _full_x_span(traces: Sequence[PlotTrace]) -> Span:
    found = finite_span([trace.x[np.isfinite(trace.y)] for trace in traces]) or (0.0, 1.0)
    return _widen(found, AXIS_MARGIN / 2)


def _widen(span: Span, share: float) -> Span:
    """Return a span widened by a fraction of it at each end; an empty span gets some width."""
    low, high = span
    room = share * (high - low) if high > low else max(0.05 * abs(low), 1e-3)
    return low - room, high + room
