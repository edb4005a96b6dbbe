"""A plot drawn with characters: two dots across and four down in each cell, one colour in each."""

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from rich.segment import Segment
from rich.style import Style
from textual.color import Color
from textual.strip import Strip

from fraexp.tui.plotting.braille import BLANK_CODE, DOTS_ACROSS, DOTS_DOWN, Window, dash_dots, dot_bits, line_dots

Points = tuple[NDArray[np.float64], NDArray[np.float64]]
"""x and y, each of shape (n,)."""
Limits = tuple[NDArray[np.float64], NDArray[np.float64] | None]
"""x of shape (n,), and lower and upper limits of y, shape (2, n)."""
HATCH_STEP, HATCH_OPACITY = 4, 0.55
"""Every how many dots a row of a hatched band has one, and the opacity of their colour over the background."""
RUN_CELLS = 4
"""Cells for which one of the curves that share them keeps its colour."""
GRID_DASH = 2
"""Every how many dots a grid line has one."""
Dots = tuple[NDArray[np.uint8], str]
"""Codes of the characters of cells, shape (rows, columns), and their colour."""
Cache = dict[tuple[Hashable, ...], NDArray[np.uint8]]
"""Codes of lines that were drawn before, valid for one window and size."""


@dataclass
class CellCanvas:
    """The area within the axes of a plot, and the labels around it.

    Where curves overlap, they are one line whose colour alternates, so that each of them stays visible. Bands are
    hatched behind them, exact to the dot.
    """

    size: tuple[int, int]
    """Columns and rows of the whole plot."""
    inner: tuple[int, int, int, int]
    """Column, row, columns and rows of the area within the axes."""
    window: Window
    background: str
    cache: Cache = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._layers: tuple[list[Dots], ...] = ([], [], [])
        """Grid, bands and curves: in a cell, the dots of a layer replace those of the layers before."""
        self._texts: dict[tuple[int, int], tuple[str, str]] = {}
        """Character and style by column and row; later ones replace earlier ones."""

    @property
    def cells(self) -> tuple[int, int]:
        """Columns and rows within the axes."""
        return self.inner[2:]

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Return column and row of a point within the axes; outside of the window they are out of range."""
        left, right, bottom, top = self.window
        columns, rows = self.cells
        column, row = (x - left) / (right - left) * columns, (top - y) / (top - bottom) * rows
        return int(np.floor(column - 1e-9 * (x == right))), int(np.floor(row - 1e-9 * (y == bottom)))

    def grid(self, x: Iterable[float], y: Iterable[float], colour: str) -> None:
        """Draw dotted grid lines, exact to the dot."""
        left, right, bottom, top = self.window
        dots = np.zeros((DOTS_DOWN * self.cells[1], DOTS_ACROSS * self.cells[0]), dtype=bool)
        for at in x:
            upright = line_dots(np.full(2, at), np.array([bottom, top]), self.window, self.cells)
            dots |= dash_dots(upright.T, 1, GRID_DASH).T
        for at in y:
            dots |= dash_dots(
                line_dots(np.array([left, right]), np.full(2, at), self.window, self.cells), 1, 2 * GRID_DASH
            )
        self._layers[0].append((dot_bits(dots), colour))

    def line(self, key: Hashable, points: Callable[[], Points], colour: str, dash: tuple[int, int] = (1, 1)) -> None:
        """Draw a line, of which `dash` gives the dots drawn and the dots of a period; `points` are asked for once."""
        self._layers[2].append((self._cached((key, dash), lambda: self._dashed(points(), dash)), colour))

    def _cached(self, key: tuple[Hashable, ...], make: Callable[[], NDArray[np.uint8]]) -> NDArray[np.uint8]:
        if key not in self.cache:
            self.cache[key] = make()
        return self.cache[key]

    def _dashed(self, points: Points, dash: tuple[int, int]) -> NDArray[np.uint8]:
        return dot_bits(dash_dots(line_dots(*points, self.window, self.cells), *dash))

    def band(self, key: Hashable, limits: Callable[[], Limits], colour: str) -> None:
        """Hatch the area between lower and upper limits."""
        dots = self._cached((key, "band"), lambda: self._hatched(*limits()))
        mixed = Color.parse(self.background).blend(Color.parse(colour), HATCH_OPACITY)
        self._layers[1].append((dots, mixed.hex))

    def _hatched(self, x: NDArray[np.float64], limits: NDArray[np.float64] | None) -> NDArray[np.uint8]:
        size = DOTS_ACROSS * self.cells[0], DOTS_DOWN * self.cells[1]
        if limits is None:
            return dot_bits(np.zeros(size[::-1], dtype=bool))
        return dot_bits(
            band_mask(x, limits, self.window, size) & (np.add.outer(*map(np.arange, size[::-1])) % HATCH_STEP == 0)
        )

    def signs(self, x: NDArray[np.float64], y: NDArray[np.float64], sign: str, colour: str) -> None:
        """Draw a sign at each point within the window."""
        columns, rows = self.cells
        for at, value in zip(x.tolist(), y.tolist(), strict=True):
            if np.isfinite(at) and np.isfinite(value):
                column, row = self.cell(at, value)
                if 0 <= column < columns and 0 <= row < rows:
                    self._texts[self.inner[0] + column, self.inner[1] + row] = sign, colour

    def note(self, x: float, y: float, text: str, colour: str) -> None:
        """Write a text whose first character is above a point within the window; without room, only that one."""
        column, row = self.cell(x, y)
        if 0 <= column < self.cells[0] and 0 <= row < self.cells[1]:
            left, above = self.inner[0] + column, self.inner[1] + max(row - 1, 0)
            room = [(left + offset, above) for offset in range(-1, len(text) + 1)]
            free = not any(place in self._texts for place in room)
            self.write(left, above, text if free else text[:1], colour)

    def upright(self, x: float, colour: str) -> None:
        """Draw a vertical line through all cells without a curve."""
        column = self.cell(x, self.window[2])[0]
        if 0 <= column < self.cells[0]:
            for row in range(self.cells[1]):
                self._texts.setdefault((self.inner[0] + column, self.inner[1] + row), ("│", colour))

    def write(self, column: int, row: int, text: str, style: str) -> None:
        """Write a text at a place of the whole plot."""
        for offset, character in enumerate(text):
            if 0 <= column + offset < self.size[0] and 0 <= row < self.size[1]:
                self._texts[column + offset, row] = character, style

    def strips(self) -> list[Strip]:
        """Return the rows of the whole plot."""
        columns, rows = self.size
        codes, styles = np.full((rows, columns), ord(" ")), np.zeros((rows, columns), dtype=np.int64)
        names = [""]
        left, top, width, height = self.inner
        inside = slice(top, top + height), slice(left, left + width)
        codes[inside], styles[inside] = self._merge(names)
        curves = {colour for _, colour in self._layers[2]}
        for (column, row), (character, style) in self._texts.items():
            if character == "│" and names[styles[row, column]] in curves:
                continue  # the cursor does not cover curves
            codes[row, column], styles[row, column] = ord(character), _index_of(names, style)
        return [self._strip(codes[row], styles[row], names) for row in range(rows)]

    def _merge(self, names: list[str]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the codes of all cells within the axes, and the indices of their styles, which go into `names`."""
        columns, rows = self.cells
        codes, styles = np.full((rows, columns), ord(" ")), np.zeros((rows, columns), dtype=np.int64)
        for layer in self._layers:
            if not layer:
                continue
            bits = np.stack([of for of, _ in layer])
            style_of = np.array([_index_of(names, colour) for _, colour in layer])
            order = np.cumsum(bits > 0, axis=0)
            count = order[-1]
            turn = (np.arange(columns)[None, :] // RUN_CELLS % np.maximum(count, 1)) + 1
            chosen = np.argmax((order == turn) & (bits > 0), axis=0)
            codes = np.where(count > 0, BLANK_CODE + np.bitwise_or.reduce(bits, axis=0).astype(np.int64), codes)
            styles = np.where(count > 0, style_of[chosen], styles)
        return codes, styles

    def _strip(self, codes: NDArray[np.int64], styles: NDArray[np.int64], names: list[str]) -> Strip:
        text = "".join(map(chr, codes.tolist()))
        ends = [0, *(np.flatnonzero(np.diff(styles)) + 1).tolist(), len(text)]
        base = Style(bgcolor=self.background)
        segments = [Segment(text[a:b], base + _style(names[styles[a]])) for a, b in pairwise(ends) if b > a]
        return Strip(segments, len(text))


def band_mask(
    x: NDArray[np.float64], limits: NDArray[np.float64], window: Window, size: tuple[int, int]
) -> NDArray[np.bool_]:
    """Return which points of a grid lie between limits, shape (height, width); NaN leaves a gap.

    `x` ascends, or the band cannot be drawn.
    """
    width, height = size
    known = np.isfinite(x)
    left, right, bottom, top = window
    column = left + (np.arange(width) + 0.5) / width * (right - left)
    row = top - (np.arange(height) + 0.5) / height * (top - bottom)
    if known.sum() < 2 or (np.diff(x[known]) < 0).any():
        return np.zeros((height, width), dtype=bool)
    low, high = (
        _interpolate(column, x[known], edge[known], end) for edge, end in zip(limits, (-1e9, 1e9), strict=True)
    )
    return np.asarray((row[:, None] >= low[None, :]) & (row[:, None] <= high[None, :]))


def _interpolate(
    at: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], infinite: float
) -> NDArray[np.float64]:
    """Return values between points, NaN outside of them and beside NaN; an infinite limit is far away."""
    filled = np.where(np.isinf(y), infinite, y)
    unknown = np.isnan(filled)
    found = np.interp(at, x, np.where(unknown, 0.0, filled), left=np.nan, right=np.nan)
    return np.where(np.interp(at, x, unknown.astype(float), left=1.0, right=1.0) > 0, np.nan, found)


def _index_of(names: list[str], name: str) -> int:
    if name not in names:
        names.append(name)
    return names.index(name)


@lru_cache
def _style(name: str) -> Style:
    return Style.parse(name or "none")
