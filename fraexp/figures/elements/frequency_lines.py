"""Lines over frequency: settled points are joined, the others hollow; models through points; bands beyond the axis."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fraexp.data.results import Curve
from fraexp.figures.elements.bundles import TINT, mixed
from fraexp.figures.elements.labels import drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OPACITY = 0.22
"""Of a band."""
ROOM = 0.25
"""Share of its span by which an axis grows at each end for bands that go beyond the lines."""
LIMITS = ("lower 95 %", "upper 95 %")
"""Columns of a curve that are the limits of its first ordinate."""
SIZE = 3.2
"""Of the points that a model goes through."""
THIN = 1.1
"""Width of the model's line."""
GREY = "0.35"
"""Of what the legend names once for all curves."""
Fill = Literal["full", "none"]
Style = dict[str, Any]


def joined(values: np.ndarray, settled: np.ndarray) -> np.ndarray:
    """Return values of shape (..., n) with NaN, a gap in the line, where the response was not settled."""
    return np.where(settled, values, np.nan)


def alone(settled: np.ndarray) -> np.ndarray:
    """Return which settled points no line reaches, shape (n,) of bool: these too are drawn as points."""
    neighbours = np.zeros(len(settled) + 2, dtype=bool)
    neighbours[1:-1] = settled
    return settled & ~neighbours[:-2] & ~neighbours[2:]


def draw_line(
    axes: "Axes", frequency: np.ndarray, values: np.ndarray, settled: np.ndarray, label: str, style: Style
) -> None:
    """Draw values of shape (n,): a line through settled points, hollow points for the others."""
    axes.plot(frequency, joined(values, settled), label=drawable(label), **style)
    _draw_points(axes, frequency, values, alone(settled), str(style["color"]), "full")
    _draw_points(axes, frequency, values, ~settled, str(style["color"]), "none")


def _draw_points(
    axes: "Axes", x: np.ndarray, values: np.ndarray, chosen: np.ndarray, colour: Any, fill: Fill, size: float = 5
) -> None:
    if chosen.any():
        axes.plot(x[chosen], values[chosen], "o", color=colour, fillstyle=fill, markersize=size, mew=0.24 * size)


def draw_fitted(
    axes: "Axes",
    points: tuple[np.ndarray, np.ndarray],
    settled: np.ndarray,
    model: tuple[np.ndarray, ...],
    style: Style,
) -> None:
    """Draw points x, y of shape (n,), those that are not settled hollow, and a model x, y as a thin line over them.

    NaN is a gap in the line. The legend takes its entry from `name_fitted`.
    """
    colour = str(style["color"])
    _draw_points(axes, *points, settled, mixed(colour, 1.0, TINT), "full", SIZE)
    _draw_points(axes, *points, ~settled & np.isfinite(points[1]), colour, "none")
    axes.plot(*model, color=colour, linestyle=style["linestyle"], linewidth=THIN, zorder=3.5)


def name_fitted(axes: "Axes", label: str, style: Style) -> None:
    """Add points and the line of their model to the legend."""
    tinted = mixed(str(style["color"]), 1.0, TINT)
    look = {"color": style["color"], "linestyle": style["linestyle"], "linewidth": THIN}
    axes.plot([], [], marker="o", markersize=SIZE, mec=tinted, mfc=tinted, label=drawable(label), **look)


def name_model(axes: "Axes", label: str) -> None:
    """Tell in the legend, once, what the thin lines are."""
    axes.plot([], [], color=GREY, linewidth=THIN, label=label)


def name_band(axes: "Axes") -> None:
    """Tell in the legend, once, what the bands are."""
    axes.fill_between([], [], color=GREY, alpha=OPACITY, linewidth=0, label="95 %")


def limits_of(curve: Curve) -> np.ndarray | None:
    """Return the 95 % limits of a curve's first ordinate, shape (2, n); None if they are not known."""
    if not all(name in curve.columns for name in LIMITS):
        return None
    limits = np.stack([curve.columns[name] for name in LIMITS])
    return None if np.isnan(limits).all() else limits


def draw_bands(axes: "Axes", bands: list[tuple[np.ndarray, np.ndarray, str]], opacity: float = OPACITY) -> None:
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
