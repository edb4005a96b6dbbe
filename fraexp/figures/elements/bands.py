"""Bands of uncertainty around curves, and the range of an ordinate: the curves decide it, the bands are clipped."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.figures.elements.canvas import LineStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BAND_MARGIN = 0.25
"""Fraction of the curves' span by which an axis may extend beyond them for their bands."""
BAND_OPACITY = 0.22
"""Opacity of a band."""
BAR_OPACITY, BAR_WIDTH = 0.55, 1.6
"""Opacity of a bar, and its width in points."""
OUT_OF_SIGHT = 100.0
"""Distance beyond the axis, in its spans, at which a band without a limit ends."""
Band = tuple[NDArray[np.float64], NDArray[np.float64]]
"""A curve of shape (n,) and its limits, shape (2, n): NaN where unknown, infinite where there is none."""


def finite_span(values: Sequence[NDArray[np.float64]]) -> tuple[float, float] | None:
    """Return minimum and maximum of all finite values; None without one."""
    known = np.concatenate([np.ravel(of) for of in values]) if values else np.zeros(0)
    known = known[np.isfinite(known)]
    return (float(known.min()), float(known.max())) if known.size else None


def ordinate_limits(curves: Sequence[NDArray[np.float64]], bands: Sequence[Band] = ()) -> tuple[float, float] | None:
    """Return the least and greatest value that an axis has to show; None without a finite value of a curve.

    It holds all curves. Bands get what they need up to a fraction of the curves' span, or up to their typical half
    width where that is more: in dB a lower limit near 0 lies arbitrarily far below, and must not flatten the curves.
    """
    span = finite_span(curves)
    if span is None or not bands:
        return span
    low, high = span
    edges = np.concatenate([limits[:, np.isfinite(y)].ravel() for y, limits in bands])
    edges = edges[~np.isnan(edges)]
    if not edges.size:
        return span
    room = max(BAND_MARGIN * (high - low), _typical_half_width(bands))
    return min(low, max(low - room, float(edges.min()))), max(high, min(high + room, float(edges.max())))


def _typical_half_width(bands: Sequence[Band]) -> float:
    """Return the median distance from a curve to the nearer limit; 0 if most points have no limit."""
    distances = np.concatenate([np.minimum(y - limits[0], limits[1] - y) for y, limits in bands])
    distances = distances[~np.isnan(distances)]
    middle = float(np.median(distances)) if distances.size else 0.0
    return middle if np.isfinite(middle) else 0.0


def isolated_points(settled: NDArray[np.bool_], joined: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Return whether a settled point is joined to no neighbour, shape (n,): it is drawn as a point.

    `joined` says whether each point may be joined to the next one, shape (n - 1,); all may if it is not given.
    """
    links = np.zeros(settled.size + 1, dtype=bool)  # before each point, and after the last one
    links[1:-1] = settled[:-1] & settled[1:] & (True if joined is None else joined)
    return settled & ~links[:-1] & ~links[1:]


class DrawnBand(NamedTuple):
    """The 95 % limits of a curve."""

    x: NDArray[np.float64]
    """Shape (n,)."""
    y: NDArray[np.float64]
    """The curve, shape (n,)."""
    limits: NDArray[np.float64]
    """Lower and upper limit, shape (2, n); NaN leaves a gap."""
    colour: str


def draw_bands(axes: "Axes", bands: Sequence[DrawnBand], opacity: float = BAND_OPACITY, zorder: float = 1.0) -> None:
    """Draw bands; the curves must have been drawn, and decide how far the axis follows the bands.

    A band that is infinite, or reaches far beyond, ends at the edge of the axis. A point between gaps has a bar.
    """
    from matplotlib.collections import FillBetweenPolyCollection, LineCollection

    known = [band for band in bands if not np.isnan(band.limits).all()]
    span = ordinate_limits([axes.dataLim.intervaly], [(of.y, of.limits) for of in known])
    if not known or span is None:
        return
    beyond = OUT_OF_SIGHT * max(span[1] - span[0], abs(span[0]), abs(span[1]))
    for x, _, limits, colour in known:
        low, high = np.clip(limits, span[0] - beyond, span[1] + beyond)
        given = np.asarray(~np.isnan(limits).any(axis=0))
        look: LineStyle = {"where": given, "color": colour, "alpha": opacity, "linewidth": 0, "zorder": zorder}
        axes.add_collection(FillBetweenPolyCollection("x", x, low, high, **look), autolim=False)
        alone = isolated_points(given)
        if alone.any():
            bars = [
                [(at, bottom), (at, top)] for at, bottom, top in zip(x[alone], low[alone], high[alone], strict=True)
            ]
            lines = LineCollection(bars, colors=colour, alpha=BAR_OPACITY, linewidths=BAR_WIDTH)
            axes.add_collection(lines, autolim=False)
    axes.update_datalim([(axes.dataLim.x0, edge) for edge in span], updatex=False)
    axes.autoscale_view()
