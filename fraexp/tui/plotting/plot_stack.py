"""Plots above each other, with the axes that they share: zoom, pan and cursor; the view of responses is one."""

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
from fraexp.figures.elements.view import OVER_FREQUENCY, View
from fraexp.tui.plotting.braille import ACROSS, DOWN, Window
from fraexp.tui.plotting.plot_widget import LEFT, RIGHT, Look, Plot, Sight, line_of, nearest_point, span_of
from fraexp.tui.plotting.plotted_curves import Picture, PlotPanel, PlotTrace, Reference, bode

MOST = 4
"""Most panels at once."""
LEAST_ROWS = 5
"""Least height of a panel, with its frame."""
MARGIN = 0.02
"""Share of its span by which an axis goes beyond the curves."""
ROOM = 0.25
"""Share by which it goes further for bands that leave the curves."""
Span = tuple[float, float]


class PlotStack(Vertical):
    """The panels of a picture, as far as they fit."""

    DEFAULT_CSS = "PlotStack { width: 1fr; height: 1fr; }"

    class Moved(Message):
        """The cursor has moved."""

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)  # type: ignore[arg-type]
        self.picture: Picture | None = None
        self.sight = Sight()
        self.first = 0
        """Place of the first panel that is shown, if not all fit."""
        self._x: dict[int, Span] = {}
        self._y: dict[int, Span] = {}

    def compose(self) -> ComposeResult:
        """Make room for all panels."""
        for _ in range(MOST):
            yield Plot()

    def on_mount(self) -> None:
        """Draw again in other colours if the theme changes."""
        for plot in self.query(Plot):
            plot.display = False
        self.watch(self.app, "theme", self.draw, init=False)

    @on(Resize)
    def _resized(self) -> None:
        self.draw()

    def display_picture(self, picture: Picture | None) -> None:
        """Show another picture; what was zoomed stays where the axis is the same."""
        before, self.picture = self.picture, picture
        same = before and picture and before.panels[0].abscissa == picture.panels[0].abscissa
        if not (same and before and picture and before.upright == picture.upright):
            self._x, self.sight.cursor = {}, None
        if not (same and before and picture and before.kind == picture.kind):
            self._y, self.first = {}, 0
        if self.sight.cursor is None:
            self._begin()
        self.draw()

    @property
    def look(self) -> Look:
        """How curves are told apart on this terminal."""
        plain = bool(getattr(self.app, "plain", False))
        return Look(self.app.current_theme.dark, self.app.no_color or plain)

    def panels(self) -> list[tuple[int, PlotPanel]]:
        """Return the panels that fit, with their places."""
        fitting = max(1, min(MOST, self.size.height // LEAST_ROWS))
        every = list(enumerate(self.picture.panels if self.picture else ()))
        self.first = max(0, min(self.first, len(every) - fitting))
        return every[self.first : self.first + fitting]

    def beyond(self) -> tuple[int, int]:
        """Return how many panels are before and after those that fit."""
        shown, every = len(self.panels()), len(self.picture.panels if self.picture else ())
        return self.first, every - self.first - shown

    def turn(self, panels: int) -> None:
        """Show later panels, or earlier ones."""
        self.first += panels
        self.draw()

    def draw(self) -> None:
        """Draw what is to be seen."""
        plots = list(self.query(Plot))
        shown = self.panels() if self.picture else []
        for plot in plots[len(shown) :]:
            plot.display = False
        for place, ((index, panel), plot) in enumerate(zip(shown, plots, strict=False)):
            last = place + 1 == len(shown) or shown[place + 1][1].axis != panel.axis
            plot.display = True
            assert self.picture is not None
            plot.show(panel, self.window(index), self.sight, self.look, self.picture.upright, last)

    def window(self, index: int) -> Window:
        """Return what of a panel is seen: what was zoomed to, else all of the visible curves."""
        assert self.picture is not None
        panel = self.picture.panels[index]
        alike = [of for of in self.picture.panels if of.axis == panel.axis]
        x = self._x.get(panel.axis) or _home_x([trace for of in alike for trace in self._seen(of)])
        y = self._y.get(index) or self._home_y(panel)
        if self.picture.equal and panel.axis not in self._x and index not in self._y:
            x, y = self._equal(x, y)
        return *x, *y

    def _seen(self, panel: PlotPanel) -> list[PlotTrace]:
        return self.sight.order(panel.traces) or list(panel.traces)

    def _home_y(self, panel: PlotPanel) -> Span:
        if panel.span:
            return panel.span
        if panel.angle and self.sight.wrapped:
            return -190.0, 190.0
        traces = self._seen(panel)
        values = [line_of(trace)[1] for trace in traces]
        core = span_of(values) or span_of([trace.y for trace in traces]) or (0.0, 1.0)
        low, high = _wider(core, MARGIN)
        edges = span_of([line_of(trace)[2] for trace in traces if trace.band is not None])  # type: ignore[misc]
        if edges and self.sight.bands:
            room = ROOM * (high - low)
            low, high = min(low, max(low - room, edges[0])), max(high, min(high + room, edges[1]))
        return low, high

    def _equal(self, x: Span, y: Span) -> tuple[Span, Span]:
        """Return wider spans with as much in a dot across as in a dot down."""
        columns, rows = self.size.width - LEFT - RIGHT - 2, self.size.height - 3
        if columns < 1 or rows < 1:
            return x, y
        across, down = (x[1] - x[0]) / (ACROSS * columns), (y[1] - y[0]) / (DOWN * rows)
        return _wider(x, (max(down / across, 1) - 1) / 2), _wider(y, (max(across / down, 1) - 1) / 2)

    def zoom(self, x: float = 1.0, y: float = 1.0) -> None:
        """Show so many times less of the axes: of x around the cursor, of y around the middle."""
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
        """Move what is seen by shares of it."""
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
        """Return what of the figure is seen: of the axes the frequencies, and the phase."""
        if self.picture is None or self.picture.kind not in OVER_FREQUENCY:
            return View()
        zoomed = next((self._x[of.axis] for of in self.picture.panels if of.axis in self._x), None)
        band = (float(10 ** zoomed[0]), float(10 ** zoomed[1])) if zoomed else None
        return View(band, self.sight.wrapped and self.picture.kind == "bode")

    def home(self) -> None:
        """Show all again."""
        self._x, self._y = {}, {}
        self.draw()

    @on(PlotWidget.ScaleChanged)
    def _scaled(self, event: PlotWidget.ScaleChanged) -> None:
        """Follow the mouse: plots that share an axis move together."""
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
    def _pointed(self, event: Plot.Pointed) -> None:
        panel = event.plot.panel
        if panel and self.picture and self.picture.upright:
            self.place(10**event.x if panel.spectral else event.x)

    def place(self, cursor: float) -> None:
        """Put the cursor to a point of the focused curve near to a value."""
        trace = self._followed()
        if trace is not None:
            nearest = nearest_point(trace, cursor)
            self.sight.cursor = cursor if nearest is None else float(trace.at[nearest])
            self.draw()
            self.post_message(self.Moved())

    def step(self, towards: int) -> None:
        """Move the cursor to the next point of the focused curve that is another column away, or more columns."""
        trace = self._followed()
        if trace is None or self.sight.cursor is None or self.picture is None:
            return
        at = np.unique(trace.at[np.isfinite(trace.y)])
        axis = np.log10(at) if self.picture.upright and self.picture.panels[0].spectral else at
        here = np.log10(self.sight.cursor) if axis is not at else self.sight.cursor
        left, right = self.window(0)[:2] if self.picture.upright else (axis[0], axis[-1])
        cell = (right - left) / max(self.size.width - LEFT - RIGHT - 2, 1)
        away = (axis - here) * np.sign(towards)
        ahead, far = np.flatnonzero(away > 0), np.flatnonzero(away >= abs(towards) * cell)
        if far.size:
            self.place(float(at[far[np.argmin(away[far])]]))
        elif ahead.size:
            self.place(float(at[ahead[np.argmax(away[ahead])]]))

    def _begin(self) -> None:
        trace = self._followed()
        if trace is not None:
            at = np.sort(trace.at[np.isfinite(trace.y)])
            self.sight.cursor = float(at[len(at) // 2])

    def _followed(self) -> PlotTrace | None:
        """Return the line that the cursor follows: the focused curve's, else the first one."""
        traces = [trace for panel in (self.picture.panels if self.picture else ()) for trace in panel.traces]
        having = [trace for trace in traces if np.isfinite(trace.y).any() and not trace.model]
        return next((trace for trace in having if trace.of == self.sight.focus), having[0] if having else None)

    def _cursor_x(self, panel: PlotPanel) -> float | None:
        cursor = self.sight.cursor
        if cursor is None or self.picture is None or not self.picture.upright or (panel.spectral and cursor <= 0):
            return None
        return float(np.log10(cursor)) if panel.spectral else cursor


class BodeView(PlotStack):
    """Magnitude and phase of responses over frequency."""

    def show(self, responses: Sequence[tuple[str, FrequencyResponse]], reference: Reference | None = None) -> None:
        """Show labelled responses, which must share a unit, and what they are compared with."""
        self.run_worker(self._show(list(responses), reference), exclusive=True, exit_on_error=True)

    async def _show(self, responses: list[tuple[str, FrequencyResponse]], reference: Reference | None) -> None:
        shown = [ShownResult(label, Result(Outcome.OK, response=response)) for label, response in responses]
        having = [of for of in shown if of.response is not None]
        picture = await asyncio.to_thread(bode, having, reference) if having else None
        self.display_picture(picture)


def _home_x(traces: Sequence[PlotTrace]) -> Span:
    found = span_of([trace.x[np.isfinite(trace.y)] for trace in traces]) or (0.0, 1.0)
    return _wider(found, MARGIN / 2)


def _wider(span: Span, share: float) -> Span:
    """Return a span that is wider by a share of it at each end; one of nothing gets some width."""
    low, high = span
    room = share * (high - low) if high > low else max(0.05 * abs(low), 1e-3)
    return low - room, high + room
