"""Lines over frequency: settled points near each other are joined, unsettled ones hollow; models; confidence bands."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import Curve
from fraexp.figures.elements.bands import (
    BAND_OPACITY,
    TINT_SHARE,
    Bundle,
    Colour,
    DrawnBand,
    add_quantile_legend,
    draw_bands,
    draw_bundles,
    isolated_points,
    mix_grey,
    stack_padded,
)
from fraexp.figures.elements.canvas import LineStyle
from fraexp.figures.elements.facets import is_explained
from fraexp.figures.elements.grouping import CurvePlace, point_indices
from fraexp.figures.elements.labels import drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LIMIT_COLUMNS = ("lower 95 %", "upper 95 %")
"""Columns of a curve that are the 95 % limits of its first ordinate."""
POINT_SIZE = 3.2
"""Size of the points through which a model is drawn."""
LONE_POINT_SIZE = 5.5
"""Size of those that are too far apart for a line."""
MODEL_LINE_WIDTH = 1.1
"""Width of the line of a model."""
EXTREMUM_SIZE, EXTREMUM_OFFSET = 5.0, 5.0
"""Size of the mark of a resonance or antiresonance, and its distance from the line, in points."""
MAX_JOINED_RATIO = 1.25
"""Ratio of neighbouring frequencies up to which a line joins them.

A mode of 10 % damping has a width of about this ratio: between points farther apart a line would hide one.
"""
LEGEND_GREY = "0.35"
"""Colour of legend entries that stand for all curves."""
Fill = Literal["full", "none"]


@dataclass(frozen=True)
class PhasedCurve:
    """A complex quantity over frequency as it is drawn."""

    label: str
    frequency: NDArray[np.float64]
    """Ascending frequency [Hz], shape (n,)."""
    magnitude: NDArray[np.float64]
    """Magnitude [dB], shape (n,)."""
    phase: NDArray[np.float64]
    """Phase [deg], shape (n,)."""
    settled: NDArray[np.bool_]
    """Whether the point had settled, shape (n,); lines join settled points only."""
    magnitude_band: NDArray[np.float64]
    """Lower and upper 95 % limit of the magnitude [dB], shape (2, n); NaN where unknown; may be infinite."""
    phase_band: NDArray[np.float64]
    """Lower and upper 95 % limit of the phase [deg], shape (2, n); NaN where unknown; may be infinite."""

    def with_gaps(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of shape (..., n) with NaN, a gap in the line, where the response was not settled."""
        return with_gaps(values, self.settled)


def with_gaps(values: NDArray[np.float64], settled: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return values of shape (..., n) with NaN, a gap in the line, where the response was not settled."""
    return np.where(settled, values, np.nan)


def near_neighbours(frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each frequency is so near to the next one that a line may join them, shape (n - 1,)."""
    return np.asarray(frequency[1:] <= MAX_JOINED_RATIO * frequency[:-1])


def split_line(
    frequency: NDArray[np.float64], values: NDArray[np.float64], joined: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies (n,) and values (..., n) with a NaN value between neighbours that are not joined."""
    gaps = np.flatnonzero(~joined) + 1
    between = np.sqrt(frequency[gaps] * frequency[gaps - 1])
    return np.insert(frequency, gaps, between), np.insert(values, gaps, np.nan, axis=-1)


def draw_line(
    axes: "Axes",
    frequency: NDArray[np.float64],
    values: NDArray[np.float64],
    settled: NDArray[np.bool_],
    label: str,
    style: LineStyle,
    joined: NDArray[np.bool_] | None = None,
) -> None:
    """Draw values of shape (n,): a line through settled points, hollow points for the others.

    `joined` says which neighbours the line joins, shape (n - 1,); all if it is not given. Points that it does not
    reach are drawn, and stand in the legend if there is no line at all.
    """
    line, alone = with_gaps(values, settled), isolated_points(settled, joined)
    x, y = (frequency, line) if joined is None else split_line(frequency, line, joined)
    has_line = joined is None or not alone.any() or bool((settled & ~alone).any())
    if has_line:
        axes.plot(x, y, label=drawable(label), **style)
    _draw_points(axes, frequency, values, alone, str(style["color"]), "full", label="" if has_line else label)
    _draw_points(axes, frequency, values, ~settled, str(style["color"]), "none")


def _draw_points(
    axes: "Axes",
    x: NDArray[np.float64],
    values: NDArray[np.float64],
    chosen: NDArray[np.bool_],
    colour: str | Colour,
    fill: Fill,
    size: float = 5,
    label: str = "",
) -> None:
    if chosen.any():
        look: LineStyle = {"color": colour, "fillstyle": fill, "markersize": size, "mew": 0.24 * size}
        axes.plot(x[chosen], values[chosen], "o", label=drawable(label) or None, **look)


def draw_points_and_model(
    axes: "Axes",
    points: tuple[NDArray[np.float64], NDArray[np.float64]],
    settled: NDArray[np.bool_],
    model: tuple[NDArray[np.float64], ...],
    style: LineStyle,
    joined: NDArray[np.bool_] | None = None,
) -> None:
    """Draw points x, y of shape (n,), those that are not settled hollow, and a model x, y as a thin line over them.

    Points that a line would not reach if it joined these neighbours (see `draw_line`) are larger: they are few.
    NaN is a gap in the line. The legend takes its entry from `add_fitted_legend`.
    """
    colour = str(style["color"])
    alone, tint = isolated_points(settled, joined) & (joined is not None), mix_grey(colour, 1.0, TINT_SHARE)
    _draw_points(axes, *points, settled & ~alone, tint, "full", POINT_SIZE)
    _draw_points(axes, *points, alone, tint, "full", LONE_POINT_SIZE)
    _draw_points(axes, *points, ~settled & np.isfinite(points[1]), colour, "none")
    axes.plot(*model, color=colour, linestyle=style["linestyle"], linewidth=MODEL_LINE_WIDTH, zorder=3.5)


def draw_extrema(
    axes: "Axes",
    frequency: NDArray[np.float64],
    magnitude: NDArray[np.float64],
    extremum: NDArray[np.float64],
    style: LineStyle,
) -> None:
    """Mark the resonances (1) above and the antiresonances (-1) of a model below its line; all of shape (n,)."""
    from matplotlib.transforms import ScaledTranslation

    inches = axes.figure.dpi_scale_trans
    for sign, marker in ((1, "v"), (-1, "^")):
        chosen = extremum == sign
        if chosen.any():
            shifted = axes.transData + ScaledTranslation(0, sign * EXTREMUM_OFFSET / 72, inches)
            look: LineStyle = {"color": str(style["color"]), "markersize": EXTREMUM_SIZE, "mew": 0.0, "zorder": 3.6}
            axes.plot(frequency[chosen], magnitude[chosen], marker, transform=shifted, **look)


def add_fitted_legend(axes: "Axes", label: str, style: LineStyle) -> None:
    """Add points and the line of their model to the legend."""
    tinted = mix_grey(str(style["color"]), 1.0, TINT_SHARE)
    look = {"color": style["color"], "linestyle": style["linestyle"], "linewidth": MODEL_LINE_WIDTH}
    axes.plot([], [], marker="o", markersize=POINT_SIZE, mec=tinted, mfc=tinted, label=drawable(label), **look)


def add_model_legend(axes: "Axes", label: str) -> None:
    """Add one legend entry for all thin lines."""
    axes.plot([], [], color=LEGEND_GREY, linewidth=MODEL_LINE_WIDTH, label=label)


def add_band_legend(axes: "Axes", lines: Iterable["GroupedLine"]) -> None:
    """Add one legend entry for the bands of all lines, if there are any."""
    if any(line.band is not None for line in lines):
        axes.fill_between([], [], color=LEGEND_GREY, alpha=BAND_OPACITY, linewidth=0, label="95 %")


def curve_limits(curve: Curve) -> NDArray[np.float64] | None:
    """Return the 95 % limits of a curve's first ordinate, shape (2, n); None if they are unknown."""
    if not all(name in curve.columns for name in LIMIT_COLUMNS):
        return None
    limits = np.stack([curve.columns[name] for name in LIMIT_COLUMNS])
    return None if np.isnan(limits).all() else limits


@dataclass(frozen=True)
class GroupedLine:
    """A line as it is drawn."""

    name: str
    """Name in the legend; empty for none."""
    place: CurvePlace
    """Where it belongs; lines with the same point are a sample."""
    x: NDArray[np.float64]
    """Shape (n,)."""
    y: NDArray[np.float64]
    """Shape (n,); NaN leaves a gap."""
    settled: NDArray[np.bool_] | None = None
    """Whether the point had settled, shape (n,); the others are hollow. None for all."""
    band: NDArray[np.float64] | None = None
    """Lower and upper 95 % limit, shape (2, n); None if they are unknown."""
    model: NDArray[np.float64] | None = None
    """Values of a model, shape (n,), through which the line goes in place of the points; None without one."""
    key: str = ""
    """Key of its sweep."""

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Whether the line goes through each point, shape (n,)."""
        return np.ones(len(self.x), dtype=bool) if self.settled is None else self.settled


def draw_grouped_lines(axes: "Axes", lines: Sequence[GroupedLine], styles: Mapping[str, LineStyle]) -> None:
    """Draw lines in the styles of their groups, and samples as bundles.

    Lines of a scale of amounts, and those that are named by the title of their panel, have no legend entries.
    """
    points = [[lines[index] for index in of] for of in point_indices([line.place for line in lines]).values()]
    bundles = [_bundle(of) for of in points if len(of) > 1]
    explained = is_explained([line.place for line in lines])
    colours = {name: str(style["color"]) for name, style in styles.items()}
    draw_bundles(axes, bundles, any(line.name for line in lines) and not explained, colours)
    if explained and any(of.quantiles is not None for of in bundles):
        add_quantile_legend(axes)
    singles = [of[0] for of in points if len(of) == 1]
    for line in singles:
        style, name = styles[line.place.group], "" if explained or not line.name else line.place.group or line.name
        if line.model is None:
            draw_line(axes, line.x, line.y, line.usable, name, style)
            continue
        draw_points_and_model(axes, (line.x, line.y), np.isfinite(line.y), (line.x, line.model), style)
        if name:
            add_fitted_legend(axes, name, style)
    if any(line.model is not None for line in singles):
        add_model_legend(axes, "model")
    bands = [
        DrawnBand(of.x, of.y, with_gaps(of.band, of.usable), colours[of.place.group])
        for of in singles
        if of.band is not None
    ]
    draw_bands(axes, bands)


def _bundle(sample: Sequence[GroupedLine]) -> Bundle:
    place = sample[0].place
    y = [with_gaps(of.y, of.usable) for of in sample]
    return Bundle(place.group, stack_padded([of.x for of in sample]), stack_padded(y), place.sample)


def frequency_span(lines: Iterable[GroupedLine | PhasedCurve]) -> tuple[float, float]:
    """Return the lowest and the highest frequency of lines over frequency."""
    everything = np.concatenate([of.x if isinstance(of, GroupedLine) else of.frequency for of in lines])
    return float(everything.min()), float(everything.max())
