"""The readout: names of the curves and their values at the cursor, a line for each."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len, set_cell_size
from rich.text import Text

from fraexp.data.texts import printable
from fraexp.figures.elements.view import wrap_phase
from fraexp.tui.plotting.curve_styles import DASHES, CurveStyles, curve_digit
from fraexp.tui.plotting.panel_drawing import ViewRange, nearest_point
from fraexp.tui.plotting.plotted_curves import REFERENCE, Picture, PlotPanel, PlotTrace

SAMPLES = {DASHES[0]: "━━━", DASHES[1]: "━╸━", DASHES[2]: "╍╍╍"}
"""Samples of the dashes of curves."""
DECIMALS = {"dB": 2, "deg": 1}
VALUE_ROUNDING = 1e-12
"""Values below this fraction of the greatest one are rounding."""
MIN_NAME_WIDTH, MIN_NAME_DIVISOR = 12, 6
"""Minimum width of a curve's name, in a narrow line this part of it; values that do not fit beside it are dropped from
the right."""


def readout(
    picture: Picture, labels: dict[int, str], view_range: ViewRange, curve_styles: CurveStyles, size: tuple[int, int]
) -> Text:
    """Return a line for each curve that fits, always including the focused one; `labels` are names by place, `size` is
    columns and rows.
    """
    columns, rows = size
    places = _visible_places(list(labels), view_range.focus, max(rows, 1))
    lines = {of: [] if of in view_range.hidden else _values(picture, of, view_range) for of in places}
    widths = [max(len(texts[index]) for texts in lines.values() if index < len(texts))
              for index in range(max((len(texts) for texts in lines.values()), default=0))]  # fmt: skip
    while widths and sum(widths) + 2 * len(widths) + min(MIN_NAME_WIDTH, columns // MIN_NAME_DIVISOR) + 7 > columns:
        widths.pop()
    named = columns - 7 - sum(widths) - 2 * len(widths)
    longest = max((cell_len(printable(label)) for label in labels.values()), default=0)
    text = Text(no_wrap=True, end="")
    for number, of in enumerate(places):
        text.append("\n" if number else "")
        text.append(_line(of, labels[of], lines[of], widths, min(named, longest), view_range, curve_styles))
    return text


def _line(
    of: int,
    label: str,
    values: Sequence[str],
    widths: Sequence[int],
    named: int,
    view_range: ViewRange,
    curve_styles: CurveStyles,
) -> Text:
    hidden, focused = of in view_range.hidden, of == view_range.focus
    sign = " " if of == REFERENCE else curve_digit(of)
    sample = "off" if hidden else "┄┄┄" if of == REFERENCE else SAMPLES[curve_styles.dash(of)]
    line = Text(f"{'>' if focused else ' '}{sign} ", style="bold" if focused else "dim" if hidden else "")
    line.append(sample, style=curve_styles.style(of))
    name = printable(label)
    line.append(" " + shorten_name(name, named), style="bold" if focused else "dim" if hidden else "")
    for width, value in zip(widths, values, strict=False):
        line.append(f"  {value:>{width}}")
    return line


def shorten_name(name: str, cells: int) -> str:
    """Return a name in a number of cells; a longer name keeps both ends, which identify it."""
    if cell_len(name) <= cells:
        return set_cell_size(name, cells)
    tail = name[-1:]
    while len(tail) < len(name) and cell_len(name[-len(tail) - 1 :]) <= (cells - 1) // 2:
        tail = name[-len(tail) - 1 :]
    return set_cell_size(set_cell_size(name, max(cells - 1 - cell_len(tail), 0)) + "…" + tail, cells)


def _visible_places(places: Sequence[int], focus: int, rows: int) -> list[int]:
    """Return as many places as rows, including the focused one."""
    if len(places) <= rows:
        return list(places)
    at = places.index(focus) if focus in places else 0
    start = min(max(0, at - rows // 2), len(places) - rows)
    return list(places[start : start + rows])


def _values(picture: Picture, of: int, view_range: ViewRange) -> list[str]:
    """Return the position of the point nearest to the cursor, and its value with 95 % limits in each panel."""
    if view_range.cursor is None:
        return []
    texts: list[str] = []
    unsettled = False
    for panel in picture.panels:
        trace = next((of_panel for of_panel in panel.traces if of_panel.curve == of and not of_panel.model), None)
        index = nearest_point(trace, view_range.cursor) if trace else None
        if trace is None or index is None:
            texts += [""] * (len(_cells(panel, None, 0, view_range, picture)) + (not texts))
            continue
        unsettled |= not trace.settled[index]
        if not texts or not texts[0]:
            texts[:1] = [f"{trace.at[index]:.4g} {picture.cursor.partition(' ')[0]}"]
        texts += _cells(panel, trace, index, view_range, picture)
    return [*texts, "not settled" if unsettled else ""]


def _cells(panel: PlotPanel, trace: PlotTrace | None, index: int, view_range: ViewRange, picture: Picture) -> list[str]:
    """Return value and limits of a panel's quantity; in the complex plane, both parts."""
    if trace is None:
        return [""] * 2
    if not picture.upright:
        parts = ((trace.x, panel.abscissa), (trace.y, panel.unit))
        return [f"{_number_text(_round_to_zero(values, index))} {unit}" for values, unit in parts]
    value = float(trace.y[index])
    low, high = (np.nan, np.nan) if trace.band is None else trace.band[:, index].tolist()
    if panel.angle and view_range.wrapped:
        turn = float(wrap_phase(np.array(value))) - value
        value, low, high = value + turn, low + turn, high + turn
    if panel.decades:
        value, low, high = 10.0**value, 10.0**low, 10.0**high
    decimals = DECIMALS.get(panel.unit)
    text = _number_text(value) if decimals is None else f"{value:.{decimals}f}"
    half = max(value - low, high - value)
    digit = 0.0 if decimals is None else 10.0**-decimals  # the last one shown: limits are no finer, and rounded up
    return [f"{text} {panel.unit}".rstrip(), "" if half < 0.5 * digit else _band_text(max(half, digit))]


def _round_to_zero(values: NDArray[np.float64], index: int) -> float:
    """Return a value, or 0 if it is within the rounding of the others."""
    value = float(values[index])
    return 0.0 if abs(value) < VALUE_ROUNDING * np.nanmax(np.abs(values)) else value


def _band_text(half: float) -> str:
    return "" if np.isnan(half) else "±∞" if np.isinf(half) else f"±{half:.2g}"


def _number_text(value: float) -> str:
    return f"{value:.4g}"
