"""Random draws at one point of the grid: thin lines in one colour, with their median and the band of 5…95 %."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.figures.elements.bands import DrawnBand, draw_bands
from fraexp.figures.elements.canvas import OKABE_ITO
from fraexp.figures.elements.labels import drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Scalar = TypeVar("Scalar", bound=np.generic)
MAX_SINGLE_CURVES = 20
"""Maximum number of curves, each with its own name, that a figure distinguishes."""
MIN_QUANTILE_CURVES = 10
"""Number of curves in a bundle from which its quantiles are drawn."""
QUANTILE_LEVELS = (0.05, 0.5, 0.95)
"""Quantiles that are drawn: lower limit of the band, median, upper limit of the band."""
MAX_VECTOR_LINES = 500
"""Number of lines above which a bundle is rasterised even in SVG and PDF, which would open slowly."""
BAND_OPACITY = 0.4
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
    draw_bands(axes, bands, BAND_OPACITY, zorder=2.5)
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
