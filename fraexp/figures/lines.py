"""Lines over frequency: settled points are joined, the others hollow; bands may go beyond the axis."""

from typing import TYPE_CHECKING, Literal

import numpy as np

from fraexp.figures.labels import drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROOM = 0.25
"""Share of its span by which an axis grows at each end for bands that go beyond the lines."""
Fill = Literal["full", "none"]


def joined(values: np.ndarray, settled: np.ndarray) -> np.ndarray:
    """Return values of shape (..., n) with NaN, a gap in the line, where the response was not settled."""
    return np.where(settled, values, np.nan)


def alone(settled: np.ndarray) -> np.ndarray:
    """Return which settled points no line reaches, shape (n,) of bool: these too are drawn as points."""
    neighbours = np.zeros(len(settled) + 2, dtype=bool)
    neighbours[1:-1] = settled
    return settled & ~neighbours[:-2] & ~neighbours[2:]


def draw_line(
    axes: "Axes", frequency: np.ndarray, values: np.ndarray, settled: np.ndarray, label: str, style: dict[str, object]
) -> None:
    """Draw values of shape (n,): a line through settled points, hollow points for the others."""
    axes.plot(frequency, joined(values, settled), label=drawable(label), **style)  # type: ignore[arg-type]
    _draw_points(axes, frequency, values, alone(settled), str(style["color"]), "full")
    _draw_points(axes, frequency, values, ~settled, str(style["color"]), "none")


def _draw_points(
    axes: "Axes", frequency: np.ndarray, values: np.ndarray, chosen: np.ndarray, colour: str, fill: Fill
) -> None:
    if chosen.any():
        axes.plot(frequency[chosen], values[chosen], "o", color=colour, fillstyle=fill, markersize=5, mew=1.2)


def draw_bands(axes: "Axes", bands: list[tuple[np.ndarray, np.ndarray, str]], opacity: float = 0.22) -> None:
    """Draw bands: frequency (n,), limits (2, n) and colour of each, once the lines are there.

    Limits may be infinite, or far from every line: the band then ends at the edge of the axis.
    """
    known = [band for band in bands if not np.isnan(band[1]).all()]
    if not known:
        return
    edges = _edges(axes.get_ylim(), np.concatenate([limits.ravel() for _, limits, _ in known]))
    for frequency, limits, colour in known:
        low, high = np.clip(limits, *edges)
        axes.fill_between(frequency, low, high, color=colour, alpha=opacity, linewidth=0)
    axes.set_ylim(edges)


def _edges(span: tuple[float, float], limits: np.ndarray) -> tuple[float, float]:
    """Return the limits of an axis that shows its lines, and as much of their bands as there is room for."""
    low, high = span
    room, known = ROOM * (high - low), limits[~np.isnan(limits)]
    return min(low, max(low - room, float(known.min()))), max(high, min(high + room, float(known.max())))
