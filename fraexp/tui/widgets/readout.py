"""What the curves are called, and what they are at the cursor: a line each."""

from collections.abc import Sequence

import numpy as np
from rich.cells import cell_len, set_cell_size
from rich.text import Text

from fraexp.figures.elements.labels import printable
from fraexp.tui.plotting.plot_widget import Look, Sight, digit, nearest_point, turned
from fraexp.tui.plotting.plotted_curves import REFERENCE, Picture, PlotPanel, PlotTrace

DECIMALS = {"dB": 2, "deg": 1}
ROUNDING = 1e-12
"""Values below this share of the greatest one are those of rounding."""
LEAST_NAME, SHARE = 12, 6
"""Least width of a curve's name, or this part of a narrow line; what does not fit beside it is left out from the
right."""


def readout(picture: Picture, labels: dict[int, str], sight: Sight, look: Look, size: tuple[int, int]) -> Text:
    """Return a line for each curve, as far as there are rows; `labels` name them by their place, `size` is columns
    and rows. The focused curve is always among them.
    """
    columns, rows = size
    places = _window(list(labels), sight.focus, max(rows, 1))
    lines = {of: [] if of in sight.hidden else _values(picture, of, sight) for of in places}
    widths = [max(len(texts[index]) for texts in lines.values() if index < len(texts))
              for index in range(max((len(texts) for texts in lines.values()), default=0))]  # fmt: skip
    while widths and sum(widths) + 2 * len(widths) + min(LEAST_NAME, columns // SHARE) + 7 > columns:
        widths.pop()
    named = columns - 7 - sum(widths) - 2 * len(widths)
    longest = max((cell_len(printable(label)) for label in labels.values()), default=0)
    text = Text(no_wrap=True, end="")
    for number, of in enumerate(places):
        text.append("\n" if number else "")
        text.append(_line(of, labels[of], lines[of], widths, min(named, longest), sight, look))
    return text


def _line(
    of: int, label: str, values: Sequence[str], widths: Sequence[int], named: int, sight: Sight, look: Look
) -> Text:
    hidden, focused = of in sight.hidden, of == sight.focus
    sign = " " if of == REFERENCE else digit(of)
    sample = "off" if hidden else "┄┄┄" if of == REFERENCE else "━━━"
    line = Text(f"{'>' if focused else ' '}{sign} ", style="bold" if focused else "dim" if hidden else "")
    line.append(sample, style=look.style(of))
    name = printable(label)
    line.append(" " + cut(name, named), style="bold" if focused else "dim" if hidden else "")
    for width, value in zip(widths, values, strict=False):
        line.append(f"  {value:>{width}}")
    return line


def cut(name: str, cells: int) -> str:
    """Return a name in so many cells; of one that is longer both ends are left, which tell what it is."""
    if cell_len(name) <= cells:
        return set_cell_size(name, cells)
    tail = name[-1:]
    while len(tail) < len(name) and cell_len(name[-len(tail) - 1 :]) <= (cells - 1) // 2:
        tail = name[-len(tail) - 1 :]
    return set_cell_size(set_cell_size(name, max(cells - 1 - cell_len(tail), 0)) + "…" + tail, cells)


def _window(places: Sequence[int], focus: int, rows: int) -> list[int]:
    """Return so many places that the focused one is among them."""
    if len(places) <= rows:
        return list(places)
    at = places.index(focus) if focus in places else 0
    start = min(max(0, at - rows // 2), len(places) - rows)
    return list(places[start : start + rows])


def _values(picture: Picture, of: int, sight: Sight) -> list[str]:
    """Return where a curve is nearest to the cursor, and its value with 95 % limits in each panel."""
    if sight.cursor is None:
        return []
    texts: list[str] = []
    unsettled = False
    for panel in picture.panels:
        trace = next((of_panel for of_panel in panel.traces if of_panel.of == of and not of_panel.model), None)
        index = nearest_point(trace, sight.cursor) if trace else None
        if trace is None or index is None:
            texts += [""] * (len(_cells(panel, None, 0, sight, picture)) + (not texts))
            continue
        unsettled |= not trace.settled[index]
        if not texts or not texts[0]:
            texts[:1] = [f"{trace.at[index]:.4g} {picture.cursor.partition(' ')[0]}"]
        texts += _cells(panel, trace, index, sight, picture)
    return [*texts, "not settled" if unsettled else ""]


def _cells(panel: PlotPanel, trace: PlotTrace | None, index: int, sight: Sight, picture: Picture) -> list[str]:
    """Return the texts of one panel's quantity: the value, and its limits; in the complex plane both parts."""
    if trace is None:
        return [""] * 2
    if not picture.upright:
        parts = ((trace.x, panel.abscissa), (trace.y, panel.unit))
        return [f"{_number(_rounded(values, index))} {unit}" for values, unit in parts]
    value = float(trace.y[index])
    low, high = (np.nan, np.nan) if trace.band is None else trace.band[:, index].tolist()
    if panel.angle and sight.wrapped:
        turn = turned(value) - value
        value, low, high = value + turn, low + turn, high + turn
    if panel.decades:
        value, low, high = 10.0**value, 10.0**low, 10.0**high
    decimals = DECIMALS.get(panel.unit)
    text = _number(value) if decimals is None else f"{value:.{decimals}f}"
    half = max(value - low, high - value)
    return [f"{text} {panel.unit}".rstrip(), _band(half)]


def _rounded(values: np.ndarray, index: int) -> float:
    """Return a value, or 0 where it is but the rounding of the others."""
    value = float(values[index])
    return 0.0 if abs(value) < ROUNDING * np.nanmax(np.abs(values)) else value


def _band(half: float) -> str:
    return "" if np.isnan(half) else "±∞" if np.isinf(half) else f"±{half:.2g}"


def _number(value: float) -> str:
    return f"{value:.4g}"
