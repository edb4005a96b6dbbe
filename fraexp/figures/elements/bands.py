"""Bands of uncertainty around curves, and bundles of random draws with their median and the band of 5…95 %."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.figures.elements.canvas import OKABE_ITO, LineStyle
from fraexp.figures.elements.labels import drawable

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


Scalar = TypeVar("Scalar", bound=np.generic)
MAX_SINGLE_CURVES = 20
"""Maximum number of curves, each with its own name, that a figure distinguishes."""
MIN_QUANTILE_CURVES = 10
"""Number of curves in a bundle from which its quantiles are drawn."""
QUANTILE_LEVELS = (0.05, 0.5, 0.95)
"""Quantiles that are drawn: lower limit of the band, median, upper limit of the band."""
MAX_VECTOR_LINES = 500
"""Number of lines above which a bundle is rasterised even in SVG and PDF, which would open slowly."""
BUNDLE_OPACITY = 0.4
"""Opacity of a band, under which the lines remain visible."""
TINT_SHARE = 0.5
"""Share of white in the lines under a band."""
SHADE_SHARE = 0.3
"""Share of black in a median."""
GREY = "0.35"
Colour = tuple[float, ...]


@dataclass(frozen=True)
class Bundle:
    """Curves of one point of the grid as they are drawn, each a row, all of shape (m, n)."""

    label: str
    """Name of its group; empty if there is one."""
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    """NaN leaves a gap in the line."""
    sample: str = "sweep"
    """What its curves are, such as a draw."""

    @property
    def title(self) -> str:
        """Its name and how many curves it has."""
        count = len(self.x)
        return f"{self.label}, {count} {self.sample}{'' if count == 1 else 's'}".removeprefix(", ")

    @property
    def quantiles(self) -> NDArray[np.float64] | None:
        """Quantiles of y, shape (3, n), NaN where most curves have no value; None without a common x."""
        shared = bool((self.x == self.x[0]).all() and (np.diff(self.x[0]) >= 0).all())
        if len(self.x) < MIN_QUANTILE_CURVES or not shared:
            return None
        known = 2 * np.isfinite(self.y).sum(axis=0) > len(self.y)
        found = np.full((len(QUANTILE_LEVELS), self.y.shape[1]), np.nan)
        if known.any():
            found[:, known] = np.nanquantile(self.y[:, known], QUANTILE_LEVELS, axis=0)
        return found


def stack_padded(rows: Sequence[NDArray[Scalar]], missing: float = np.nan) -> NDArray[Scalar]:
    """Return arrays of shape (n,) as the rows of one array; shorter ones are padded with `missing`."""
    lengths = [len(row) for row in rows]
    if min(lengths) == max(lengths):
        return np.stack(rows)
    filled = np.full((len(rows), max(lengths)), missing, dtype=np.result_type(*{row.dtype for row in rows}))
    for target, row in zip(filled, rows, strict=True):
        target[: len(row)] = row
    return filled


def draw_bundles(
    axes: "Axes", bundles: Sequence[Bundle], has_legend: bool, colours: Mapping[str, str] | None = None
) -> None:
    """Draw bundles, each in the colour of its name; with `has_legend` they have legend entries.

    The lines under a band are drawn only if it is alone: those of several would tangle.
    """
    names = dict.fromkeys(bundle.label for bundle in bundles)
    chosen = [(colours or dict(zip(names, cycle(OKABE_ITO), strict=False)))[bundle.label] for bundle in bundles]
    quantiles = [bundle.quantiles for bundle in bundles]
    bands: list[DrawnBand] = []
    for bundle, levels, colour in zip(bundles, quantiles, chosen, strict=True):
        if levels is None or len(bundles) == 1:
            _draw_lines(axes, bundle, mix_grey(colour, 1.0, 0.0 if levels is None else TINT_SHARE))
        if levels is not None:
            axes.plot(bundle.x[0], levels[1], color=mix_grey(colour, 0.0, SHADE_SHARE), linewidth=1.8, zorder=3)
            bands.append(DrawnBand(bundle.x[0], levels[1], levels[[0, 2]], colour))
    draw_bands(axes, bands, BUNDLE_OPACITY, zorder=2.5)
    if has_legend:
        _add_legend_entries(axes, bundles, chosen, any(levels is not None for levels in quantiles))


def _draw_lines(axes: "Axes", bundle: Bundle, colour: Colour) -> None:
    from matplotlib.collections import LineCollection

    drawn = np.isfinite(bundle.x) & np.isfinite(bundle.y)
    if not drawn.any():
        return
    count = len(bundle.x)
    # The more lines, the fainter each: together they are no darker than their tint, under band and median.
    alpha = float(np.clip(100 / count, 0.12, 0.8))
    lines = LineCollection(
        list(np.stack([bundle.x, bundle.y], axis=-1)),
        colors=colour, linewidths=0.8, alpha=alpha, zorder=2, rasterized=count > MAX_VECTOR_LINES,
    )  # fmt: skip
    lines.set_in_layout(False)  # they lie inside the axes, and measuring them takes time
    axes.add_collection(lines, autolim=False)
    x, y = bundle.x[drawn], bundle.y[drawn]
    axes.update_datalim([(x.min(), y.min()), (x.max(), y.max())])
    axes.autoscale_view()


def mix_grey(colour: str, grey: float, share: float) -> Colour:
    """Return a colour mixed with a share of a grey: 0 is black and 1 is white."""
    from matplotlib.colors import to_rgb

    return tuple((1 - share) * part + share * grey for part in to_rgb(colour))


def _add_legend_entries(axes: "Axes", bundles: Sequence[Bundle], colours: Sequence[str], quantiles: bool) -> None:
    """Add legend entries with artists of their own: the lines themselves are too faint for a legend."""
    alone = len(bundles) == 1
    for title, colour in dict(zip([bundle.title for bundle in bundles], colours, strict=True)).items():
        width, shown = (0.8, mix_grey(colour, 1.0, TINT_SHARE)) if alone else (1.8, mix_grey(colour, 0.0, SHADE_SHARE))
        axes.plot([], [], color=shown, linewidth=width, label=drawable(title))
    if quantiles:
        add_quantile_legend(axes, colours[0] if alone else GREY)


def add_quantile_legend(axes: "Axes", colour: str = GREY) -> None:
    """Add legend entries for all medians and bands of quantiles."""
    axes.plot([], [], color=mix_grey(colour, 0.0, SHADE_SHARE), linewidth=1.8, label="median")
    axes.fill_between([], [], color=mix_grey(colour, 1.0, 0.4), linewidth=0, label="5…95 %")
