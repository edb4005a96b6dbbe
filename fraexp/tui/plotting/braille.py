"""Lines as the dots of braille characters: two across and four down in each cell."""

import numpy as np
from numpy.typing import NDArray

DOTS_ACROSS, DOTS_DOWN = 2, 4
DOT_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint8)
"""Bit of each dot in the code of its character."""
BLANK_CODE = 0x2800
EDGE_TOLERANCE = 1e-9
"""Tolerance at the edge of a window, relative to its length."""
Window = tuple[float, float, float, float]
"""Left, right, bottom and top of the visible range."""


def line_dots(
    x: NDArray[np.float64], y: NDArray[np.float64], window: Window, cells: tuple[int, int]
) -> NDArray[np.bool_]:
    """Return the dots of a line through points of shape (n,), of bool, shape (4 rows, 2 columns).

    `cells` are columns and rows. NaN leaves a gap. All extremes are drawn, however many points there are.
    """
    width, height = DOTS_ACROSS * cells[0], DOTS_DOWN * cells[1]
    drawn = np.zeros((height, width), dtype=bool)
    drawn[line_points(x, y, window, (width, height))] = True
    return drawn


def line_points(
    x: NDArray[np.float64], y: NDArray[np.float64], window: Window, size: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns, each of shape (k,), that a line through points of shape (n,) meets on a grid.

    `size` is its width and height.
    """
    width, height = size
    left, right, bottom, top = window
    nothing = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    if x.size < 2:
        return nothing
    with np.errstate(over="ignore"):
        across, down = _reduce_points((x - left) / (right - left) * width, (top - y) / (top - bottom) * height)
    known = np.isfinite(across) & np.isfinite(down)
    joined = np.flatnonzero(known[:-1] & known[1:])
    if not joined.size:
        return nothing
    start = np.stack([across[joined], down[joined]])
    step = np.stack([across[joined + 1], down[joined + 1]]) - start
    first, last = _clip_segments(start, step, np.array([width, height], dtype=float))
    seen = first <= last
    start, step, first, last = start[:, seen], step[:, seen], first[seen], last[seen]
    count = np.ceil(np.abs(step * (last - first)).max(axis=0)).astype(int) + 1
    place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    along = np.repeat(first, count) + place * np.repeat((last - first) / np.maximum(count - 1, 1), count)
    found = np.repeat(start, count, axis=1) + along * np.repeat(step, count, axis=1)
    column, row = np.floor(found + EDGE_TOLERANCE).astype(int)
    return np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)


def _reduce_points(
    across: NDArray[np.float64], down: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the first, lowest, highest and last of successive points in the same column of dots."""
    known = np.isfinite(across) & np.isfinite(down)
    column = np.where(known, np.floor(np.where(known, np.clip(across, -1e6, 1e6), 0)), np.inf)
    starts = np.flatnonzero(np.concatenate([[True], column[1:] != column[:-1]]))
    if 8 * starts.size > column.size:
        return across, down
    down = np.where(known, down, np.nan)
    ends = np.concatenate([starts[1:], [column.size]]) - 1
    low, high = np.minimum.reduceat(down, starts), np.maximum.reduceat(down, starts)
    middle = across[starts]
    few = np.stack([middle, middle, middle, across[ends]], axis=1).ravel()
    return few, np.stack([down[starts], low, high, down[ends]], axis=1).ravel()


def _clip_segments(
    start: NDArray[np.float64], step: NDArray[np.float64], size: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the fractions of their length between which segments lie within 0 and `size`; first > last if outside.

    Y.-D. Liang and B. A. Barsky, ACM Transactions on Graphics 3 (1984).
    """
    first, last = np.zeros(start.shape[1]), np.ones(start.shape[1])
    for axis in range(2):
        still = np.abs(step[axis]) < EDGE_TOLERANCE
        ends = np.stack([-start[axis], size[axis] * (1 + EDGE_TOLERANCE) - start[axis]]) / np.where(
            still, 1.0, step[axis]
        )
        within = (start[axis] >= 0) & (start[axis] <= size[axis] * (1 + EDGE_TOLERANCE))
        first = np.maximum(first, np.where(still, np.where(within, 0.0, 2.0), ends.min(axis=0)))
        last = np.minimum(last, np.where(still, 1.0, ends.max(axis=0)))
    return first, last


def dot_bits(dots: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the code of each cell's character less `BLANK_CODE`, shape (rows, columns)."""
    rows, columns = dots.shape[0] // DOTS_DOWN, dots.shape[1] // DOTS_ACROSS
    cells = dots.reshape(rows, DOTS_DOWN, columns, DOTS_ACROSS) * DOT_BITS[None, :, None, :]
    return np.asarray(cells.sum(axis=(1, 3)), dtype=np.uint8)


def dash_dots(dots: NDArray[np.bool_], on: int, of: int) -> NDArray[np.bool_]:
    """Return the dots of the first `on` columns in every `of`, which makes a dashed line."""
    return dots & (np.arange(dots.shape[1]) % of < on)[None, :]
