"""A plot of curves in a terminal: axes with exact ticks around the curves, and the mouse."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import ceil, floor, log10
from typing import ClassVar

from textual import events
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from fraexp.data.texts import printable
from fraexp.tui.plotting.braille import Window
from fraexp.tui.plotting.cell_canvas import Cache, CellCanvas
from fraexp.tui.plotting.curve_styles import CurveStyles
from fraexp.tui.plotting.panel_drawing import PanelDrawing, ViewRange
from fraexp.tui.plotting.plotted_curves import PlotPanel

MANTISSAS = ((1, 2, 3, 4, 5, 6, 7, 8, 9), (1, 2, 3, 5, 7), (1, 2, 5), (1,))
"""Mantissas of the ticks within a decade, finest first."""
ANGLE_STEPS_DEG = (0.1, 0.2, 0.5, 1, 2, 5, 15, 30, 45, 90, 180, 360, 720, 1440, 3600)
"""Tick spacings of an angle [deg]."""


def tick_text(value: float) -> str:
    """Return the label of a tick: short, with k for thousands and so on."""
    for factor, letter in ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= factor:
            return f"{value / factor:.6g}{letter}"
    return f"{value:.6g}"


class TickFormatter:
    """Ticks of an axis that is `room` cells long; horizontal labels must not touch."""

    def __init__(self, room: int, upright: bool = False, logarithmic: bool = False, angle: bool = False) -> None:
        """Make ticks; `logarithmic` axes have log10 of their quantity, an `angle` is in degrees."""
        self.room, self.upright, self.logarithmic, self.angle = max(room, 1), upright, logarithmic, angle

    def ticks(self, low: float, high: float) -> list[tuple[float, str]]:
        """Return the finest ticks that fit, each with its label."""
        found: list[float] = []
        for ticks in self._candidates(low, high):
            if len(ticks) > len(found) and self._has_room(ticks, low, high):
                found = ticks
        return [(tick, self._label(tick)) for tick in found]

    def _label(self, tick: float) -> str:
        return tick_text(self._value(tick))

    def _value(self, tick: float) -> float:
        """Return the value at a tick, free of rounding."""
        return float(f"{10**tick if self.logarithmic else tick:.9g}") + 0.0

    def _candidates(self, low: float, high: float) -> Iterator[list[float]]:
        if not self.logarithmic:
            yield from _multiples(low, high, ANGLE_STEPS_DEG if self.angle else (), self.room)
            return
        for mantissas in MANTISSAS:
            decades = range(floor(low), ceil(high) + 1)
            yield [tick for of in decades for m in mantissas if low <= (tick := of + log10(m)) <= high]
        for step in (2, 3, 5, 10):
            yield [float(of) for of in range(ceil(low), floor(high) + 1) if of % step == 0]
        if high - low < 1:
            for ticks in _multiples(10**low, 10**high, (), self.room):
                yield [log10(tick) for tick in ticks if tick > 0]

    def _has_room(self, ticks: Sequence[float], low: float, high: float) -> bool:
        if len(ticks) > self.room:
            return False
        cell = (high - low) / self.room
        gaps = [(after - before) / cell for before, after in pairwise(ticks)]
        if self.upright:
            return all(gap >= min(2, self.room / 4) for gap in gaps)
        widths = [len(self._label(tick)) for tick in ticks]
        return all(gap >= width + 2 for gap, width in zip(gaps, widths[1:], strict=True))


def _multiples(low: float, high: float, steps: Sequence[float], most: int) -> Iterator[list[float]]:
    """Yield the multiples of each step between two values, if they are at most `most`; without steps, use 1, 2 and 5
    times powers of ten.
    """
    if not steps or high - low < 2 * steps[0]:
        power = floor(log10(high - low))
        steps = [mantissa * 10.0**of for of in range(power - 2, power + 1) for mantissa in (1, 2, 5)]
    for step in steps:
        if (high - low) / step < most + 1:
            yield [float(f"{index * step:.12g}") for index in range(ceil(low / step), floor(high / step) + 1)]


LEFT_CELLS, RIGHT_CELLS = 9, 2
"""Cells beside the curves: for tick labels and the axis, and for the end of the last label."""
TOP_CELLS = 1
"""Rows above the curves: the title."""
MIN_COLUMNS, MIN_ROWS = 4, 1
WHEEL_FACTOR = 1.25
"""Factor of the zoom by one step of the mouse wheel."""


class Plot(Widget, can_focus=False):
    """One pair of axes. The wheel zooms around the pointer, with Shift in y; dragging moves the curves."""

    DEFAULT_CSS: ClassVar[str] = "Plot { height: 1fr; }"

    class Pointed(Message):
        """The plot was clicked."""

        def __init__(self, plot: "Plot", x: float, y: float) -> None:
            super().__init__()
            self.plot, self.x, self.y = plot, x, y

    class Reached(Message):
        """The mouse has chosen another window."""

        def __init__(self, plot: "Plot", window: Window) -> None:
            super().__init__()
            self.plot, self.window = plot, window

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - as Textual calls it
        super().__init__(id=id)
        self.drawing: PanelDrawing | None = None
        self.window: Window = (0.0, 1.0, 0.0, 1.0)
        """The visible range."""
        self._labelled = True
        self._grabbed: tuple[tuple[int, int], Window] | None = None
        self._cache: Cache = {}
        self._cache_key: tuple[object, ...] = ()
        self._strips: list[Strip] = []
        self._drawn: object = None

    @property
    def panel(self) -> PlotPanel | None:
        """What is shown."""
        return self.drawing.panel if self.drawing else None

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
        self.drawing = PanelDrawing(panel, view_range, curve_styles, upright)
        self.window, self._labelled = window, labelled
        before, self._strips = self._strips, self._draw()
        self._drawn = self.size, self.background_colors[1]
        if len(before) != len(self._strips):
            self.refresh()
            return
        rows = enumerate(zip(before, self._strips, strict=True))
        changed = [_changed_region(row, old, new) for row, (old, new) in rows if old != new]
        if changed:  # without regions all rows would be sent, which takes time over a slow line
            self.refresh(*changed)

    @property
    def cells(self) -> tuple[int, int]:
        """Columns and rows within the axes."""
        return (
            max(self.size.width - LEFT_CELLS - RIGHT_CELLS, 1),
            max(self.size.height - TOP_CELLS - int(self._labelled), 1),
        )

    def column(self, x: float) -> int:
        """Return the column within the axes at which a value of x lies."""
        return self._canvas().cell(x, self.window[2])[0]

    def _canvas(self) -> CellCanvas:
        ground = self.background_colors[1].hex6
        return CellCanvas(self.size, (LEFT_CELLS, TOP_CELLS, *self.cells), self.window, ground)

    def render_line(self, y: int) -> Strip:
        """Return one line; the whole plot is drawn with the first one after a change."""
        if self._drawn != (self.size, self.background_colors[1]):
            self._strips = self._draw()
            self._drawn = self.size, self.background_colors[1]
        return self._strips[y] if y < len(self._strips) else Strip.blank(self.size.width, self.rich_style)

    def _draw(self) -> list[Strip]:
        drawing, (columns, rows) = self.drawing, self.cells
        if drawing is None or columns < MIN_COLUMNS or rows < MIN_ROWS:
            return []
        panel = drawing.panel
        made_for = (id(panel), self.window, self.cells, drawing.wrapped)
        if made_for != self._cache_key:
            self._cache_key, self._cache = made_for, {}
        canvas = self._canvas()
        canvas.cache = self._cache
        across = TickFormatter(columns, logarithmic=panel.spectral).ticks(*self.window[:2])
        up = TickFormatter(rows, upright=True, logarithmic=panel.decades, angle=panel.angle).ticks(*self.window[2:])
        drawing.draw(canvas, ([at for at, _ in across], [at for at, _ in up]))
        self._draw_axes(canvas, drawing, across, up)
        return canvas.strips()

    def _draw_axes(
        self, canvas: CellCanvas, drawing: PanelDrawing, across: list[tuple[float, str]], up: list[tuple[float, str]]
    ) -> None:
        axis, (columns, rows) = drawing.styles.axis, self.cells
        title = printable(drawing.panel.title)[: max(columns, 0)]
        canvas.write(LEFT_CELLS, 0, title, f"bold {axis}")
        for row in range(rows):
            canvas.write(LEFT_CELLS - 1, TOP_CELLS + row, "│", axis)
        for at, label in up:
            row = TOP_CELLS + min(max(canvas.cell(self.window[0], at)[1], 0), rows - 1)
            canvas.write(LEFT_CELLS - 1, row, "┤", axis)
            canvas.write(LEFT_CELLS - 2 - len(label), row, label, axis)
        if self._labelled:
            bottom = TOP_CELLS + rows
            canvas.write(1, bottom, printable(drawing.panel.abscissa)[: LEFT_CELLS - 2], axis)
            for at, label in across:
                column = LEFT_CELLS + min(max(canvas.cell(at, self.window[2])[0], 0), columns - 1)
                canvas.write(min(column - len(label) // 2, self.size.width - len(label)), bottom, label, axis)

    def _value(self, event: events.MouseEvent) -> tuple[float, float]:
        """Return x and y at the pointer."""
        left, right, bottom, top = self.window
        columns, rows = self.cells
        across, down = (event.x - LEFT_CELLS + 0.5) / columns, (event.y - TOP_CELLS + 0.5) / rows
        return left + across * (right - left), top - down * (top - bottom)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Zoom out."""
        self._zoom(event, 1 / WHEEL_FACTOR)

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Zoom in."""
        self._zoom(event, WHEEL_FACTOR)

    def _zoom(self, event: events.MouseEvent, factor: float) -> None:
        event.stop()
        (x, y), (left, right, bottom, top) = self._value(event), self.window
        fx, fy = (
            (1.0, factor) if event.shift else (factor, factor) if event.ctrl or not self._is_upright else (factor, 1.0)
        )
        window = x - (x - left) / fx, x + (right - x) / fx, y - (y - bottom) / fy, y + (top - y) / fy
        self.post_message(self.Reached(self, window))

    @property
    def _is_upright(self) -> bool:
        return self.drawing is None or self.drawing.upright

    def on_mouse_down(self, event: events.MouseDown) -> None:
        """Take hold of the curves."""
        self._grabbed = (event.screen_x, event.screen_y), self.window
        self.capture_mouse()

    def on_mouse_move(self, event: events.MouseMove) -> None:
        """Move the curves with the mouse."""
        if self._grabbed is None or not event.button:
            return
        (x, y), (left, right, bottom, top) = self._grabbed
        columns, rows = self.cells
        dx, dy = (event.screen_x - x) / columns * (right - left), (event.screen_y - y) / rows * (top - bottom)
        if dx or dy:
            self.post_message(self.Reached(self, (left - dx, right - dx, bottom + dy, top + dy)))

    def on_mouse_up(self, event: events.MouseUp) -> None:
        """Let go of the curves; without a movement it was a click."""
        self.release_mouse()
        grabbed, self._grabbed = self._grabbed, None
        columns, rows = self.cells
        inside = LEFT_CELLS <= event.x < LEFT_CELLS + columns and TOP_CELLS <= event.y < TOP_CELLS + rows
        if grabbed and grabbed[0] == (event.screen_x, event.screen_y) and inside:
            self.post_message(self.Pointed(self, *self._value(event)))


def _changed_region(row: int, old: Strip, new: Strip) -> Region:
    """Return the region in which two strips of a row differ."""
    pair = [[(character, of.style) for of in strip for character in of.text] for strip in (old, new)]
    if any(len(cells) != new.cell_length for cells in pair):  # other widths, or wide characters
        return Region(0, row, new.cell_length, 1)
    differ = [column for column, (was, now) in enumerate(zip(*pair, strict=True)) if was != now] or [0]
    return Region(differ[0], row, differ[-1] - differ[0] + 1, 1)
