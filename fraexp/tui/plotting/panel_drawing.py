"""What is drawn of a panel: grid, bands, curves, points, resonances and cursor."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.figures.elements.bands import isolated_points
from fraexp.figures.elements.view import wrap_phase
from fraexp.tui.plotting.cell_canvas import CellCanvas, Limits, Points
from fraexp.tui.plotting.curve_styles import CurveStyles, curve_digit
from fraexp.tui.plotting.plotted_curves import REFERENCE, PlotPanel, PlotTrace

UNSETTLED_SIGN, ISOLATED_SIGN, CURSOR_SIGN, RESONANCE_SIGN, ANTIRESONANCE_SIGN = "○", "•", "◉", "▼", "▲"
"""Signs of an unsettled point, an isolated point, the cursor on a curve, a resonance, and an antiresonance."""
DIGITS_PER_CURVE = 3
"""Number of digits along a curve where colours do not distinguish curves."""
MAX_POINTS = 2000
"""Maximum number of points drawn one by one; more than the columns of a terminal."""
RESONANCE_PROMINENCE_DB = 3.0
"""Height above both sides from which a maximum of the magnitude is marked as a resonance [dB]."""
MAX_RESONANCES = 6


@dataclass
class ViewRange:
    """The visible part of a picture: hidden curves, focus, cursor, bands and phase wrapping."""

    hidden: set[int] = field(default_factory=set)
    focus: int = 0
    cursor: float | None = None
    bands: bool = True
    wrapped: bool = False

    def order(self, traces: Iterable[PlotTrace]) -> list[PlotTrace]:
        """Return the visible traces; the focused one comes last, as its signs cover the others'."""
        seen = [trace for trace in traces if trace.curve not in self.hidden]
        return sorted(seen, key=lambda trace: (trace.curve == self.focus, trace.curve != REFERENCE))


class SettledLine(NamedTuple):
    """The line through the settled points of a trace; arrays of shape (n,)."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    """NaN at unsettled points."""
    band: NDArray[np.float64] | None
    """Lower and upper 95 % limit of y, shape (2, n); None if unknown."""


@dataclass(frozen=True)
class PanelDrawing:
    """A panel with all that decides how it looks."""

    panel: PlotPanel
    view_range: ViewRange
    styles: CurveStyles
    upright: bool
    """Whether the cursor is a vertical line; else it is a point on each curve."""

    @property
    def wrapped(self) -> bool:
        """Whether the panel shows a wrapped phase."""
        return self.panel.angle and self.view_range.wrapped

    def draw(self, canvas: CellCanvas, ticks: tuple[Sequence[float], Sequence[float]]) -> None:
        """Draw everything within the axes, with grid lines at `ticks` of x and y."""
        traces = self.view_range.order(self.panel.traces)
        if not self.styles.digits:
            canvas.grid(*ticks, self.styles.grid)
        across = np.array(canvas.window[:2])
        for mark in self.panel.marks:
            canvas.line(("mark", mark), lambda y=mark: (across, np.full(2, y)), self.styles.axis, (1, 2))  # type: ignore[misc]
        for trace in traces if self.view_range.bands else ():
            if trace.band is not None:
                canvas.band(trace, lambda of=trace: self._limits(of), self.styles.style(trace.curve))  # type: ignore[misc]
        for trace in traces:
            self._draw_trace(canvas, trace)
        self._draw_signs(canvas, traces)
        self._draw_cursor(canvas, traces)

    def _limits(self, trace: PlotTrace) -> Limits:
        x, _, band = settled_line(trace, self.wrapped)
        return x, band

    def _draw_trace(self, canvas: CellCanvas, trace: PlotTrace) -> None:
        def points() -> Points:
            x, y, _ = settled_line(trace, self.wrapped)
            return x, y

        style = self.styles.style(trace.curve)
        canvas.line(trace, points, style, self.styles.dash(trace.curve, trace.model))
        known = np.isfinite(trace.x) & np.isfinite(trace.y)
        left, right = canvas.window[:2]
        for chosen, sign in ((known & ~trace.settled, UNSETTLED_SIGN), (isolated_points(trace.settled), ISOLATED_SIGN)):
            seen = np.flatnonzero(chosen & (trace.x >= left) & (trace.x <= right))
            seen = seen[:: max(1, seen.size // MAX_POINTS)]
            if seen.size:
                y = wrap_phase(trace.y[seen]) if self.wrapped else trace.y[seen]
                canvas.signs(trace.x[seen], y, sign, style)

    def _draw_signs(self, canvas: CellCanvas, traces: Sequence[PlotTrace]) -> None:
        """Draw the resonances of the focused curve, and digits where colours do not distinguish curves."""
        focused = [trace for trace in traces if trace.curve == self.view_range.focus]
        fitted = [extremum for trace in focused for extremum in trace.extrema]
        for trace in focused:
            style = f"bold {self.styles.style(trace.curve)}"
            for extremum in trace.extrema:
                sign = RESONANCE_SIGN if extremum.is_peak else ANTIRESONANCE_SIGN
                canvas.note(extremum.x, extremum.y, f"{sign}{extremum.text}", style)
            for at in resonances(self.panel, trace) if not (trace.model or fitted) else ():
                canvas.note(trace.x[at], trace.y[at], f"{RESONANCE_SIGN}{trace.at[at]:.3g}", style)
        for place, trace in enumerate(traces):
            if self.styles.digits and trace.curve != REFERENCE and not trace.model:
                self._draw_digits(canvas, trace, (place + 0.5) / len(traces))

    def _draw_digits(self, canvas: CellCanvas, trace: PlotTrace, turn: float) -> None:
        """Draw the digit of a curve at some places along it, which differ between curves."""
        x, y, _ = settled_line(trace, self.wrapped)
        left, right, bottom, top = canvas.window
        seen = np.flatnonzero((x >= left) & (x <= right) & (y >= bottom) & (y <= top))
        if seen.size:
            wanted = left + (np.arange(DIGITS_PER_CURVE) + turn) / DIGITS_PER_CURVE * (right - left)
            found = seen[[int(np.argmin(np.abs(x[seen] - at))) for at in wanted]]
            canvas.signs(x[found], y[found], curve_digit(trace.curve), f"bold {self.styles.style(trace.curve)}")

    def _draw_cursor(self, canvas: CellCanvas, traces: Sequence[PlotTrace]) -> None:
        cursor = self.view_range.cursor
        if cursor is None or (self.upright and self.panel.spectral and cursor <= 0):
            return
        if self.upright:
            canvas.upright(float(np.log10(cursor)) if self.panel.spectral else cursor, self.styles.axis)
            return
        for trace in traces:
            nearest = nearest_point(trace, cursor)
            if nearest is not None:
                at = slice(nearest, nearest + 1)
                canvas.signs(trace.x[at], trace.y[at], CURSOR_SIGN, f"bold {self.styles.style(trace.curve)}")


def resonances(panel: PlotPanel, trace: PlotTrace) -> list[int]:
    """Return the indices of the highest maxima of a magnitude [dB] over frequency that stand out."""
    if not panel.resonant or trace.settled.sum() < 3:
        return []
    places = np.flatnonzero(trace.settled & np.isfinite(trace.y))
    heights = prominences(trace.y[places])
    found = sorted((at for at, height in heights.items() if height >= RESONANCE_PROMINENCE_DB), key=heights.__getitem__)
    return [int(places[at]) for at in sorted(found[-MAX_RESONANCES:])]


def prominences(y: NDArray[np.float64]) -> dict[int, float]:
    """Return the height of each maximum of y, of shape (n,), above the higher of the valleys at its sides, by index.

    A valley ends where y rises above the maximum, or ends. `scipy.signal` has this too, but its import takes half a
    second, for which the first picture would wait.
    """
    maxima = np.flatnonzero((y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:])) + 1
    return {int(at): float(y[at] - max(_valley(y[at::-1]), _valley(y[at:]))) for at in maxima}


def _valley(y: NDArray[np.float64]) -> np.float64:
    """Return the lowest value before one that is higher than the first."""
    higher = np.flatnonzero(y > y[0])
    return np.min(y[: higher[0]] if higher.size else y)


def settled_line(trace: PlotTrace, wrapped: bool = False) -> SettledLine:
    """Return the line through the settled points; `wrapped`, within ±180 and with gaps where the phase jumps."""
    y = np.where(trace.settled, trace.y, np.nan)
    band = None if trace.band is None else np.where(trace.settled, trace.band, np.nan)
    if not wrapped:
        return SettledLine(trace.x, y, band)
    inside = wrap_phase(y)
    jumps = np.flatnonzero(np.abs(np.diff(inside)) > 180) + 1
    band = None if band is None else np.insert(band + (inside - y), jumps, np.nan, axis=1)
    return SettledLine(np.insert(trace.x, jumps, np.nan), np.insert(inside, jumps, np.nan), band)


def nearest_point(trace: PlotTrace, cursor: float) -> int | None:
    """Return the index of the finite point nearest to the cursor; None without one."""
    known = np.flatnonzero(np.isfinite(trace.y))
    if not known.size:
        return None
    return int(known[np.argmin(np.abs(trace.at[known] - cursor))])
