"""Positioning: deviation of the position from its target over the time since the move began, and the thrust."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.canvas import LineStyle
from fraexp.figures.elements.facets import by_facet, facet_panels, group_styles
from fraexp.figures.elements.frequency_lines import GroupedLine, draw_grouped_lines
from fraexp.figures.elements.grouping import CurvePlace
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REQUIRED_COLUMNS = ("time", "position", "reference", "target", "band")
"""Columns of a positioning curve, beside an optional ``thrust``."""
MIN_HEIGHT_RATIO, MAX_LINEAR_RATIO = 2.5, 6.0
"""Least height of the axis, and greatest height of a linear axis, in half widths of the band."""
AXIS_MARGIN = 1.15
"""Height of the axis relative to the largest residual."""
REST_TOLERANCE = 1e-9
"""Change of the reference per sample, relative to its range, up to which it is at rest."""


@dataclass(frozen=True)
class MoveCurve:
    """A positioning move as it is drawn."""

    label: str
    place: CurvePlace
    """Where it belongs; moves with the same point are a sample."""
    time: NDArray[np.float64]
    """Time since the reference began to move [ms], shape (n,)."""
    deviation: NDArray[np.float64]
    """Position less target [unit of the figure], shape (n,)."""
    thrust: NDArray[np.float64] | None
    """Thrust [its unit], shape (n,); None if it is unknown."""
    residual: float
    """Largest deviation from the target while the reference rests there [unit of the figure]."""


@dataclass(frozen=True)
class PositioningInfo:
    """Contents of a figure of positioning."""

    moves: tuple[MoveCurve, ...]
    bands: tuple[float, ...]
    """Half widths of the settling windows [unit of the figure], ascending."""
    height: float
    """Deviation [unit of the figure] at which the axis ends."""
    unit: str
    thrust_unit: str
    """Unit of the thrust; empty if it is unknown."""
    title: str


def is_positioning(curve: Curve) -> bool:
    """Return whether a curve is a move to targets with settling windows."""
    lengths = {curve.units.get(name) for name in REQUIRED_COLUMNS[1:]}
    return (
        all(name in curve.columns for name in REQUIRED_COLUMNS) and curve.units.get("time") == "s" and len(lengths) == 1
    )


def positioning_info(curves: Sequence[tuple[str, Curve, CurvePlace]], title: str = "") -> PositioningInfo:
    """Return the moves in labelled curves with their places; FraexpError if there is none."""
    found = [(label, curve, place) for label, curve, place in curves if is_positioning(curve)]
    if not found:
        raise FraexpError("positioning figure: there is no positioning motion; use estimator 'positioning_metrics'")
    length = found[0][1].units["position"]
    if any(curve.units["position"] != length for _, curve, _ in found):
        raise FraexpError("positioning figure: found positions in several units; choose sweeps that share one")
    factor, unit = (1e6, f"µ{length}") if length in DISPLACEMENT_UNITS else (1.0, length)
    moves = tuple(_move_curve(label, curve, place, factor) for label, curve, place in found)
    bands = tuple(sorted({factor * float(band) for _, curve, _ in found for band in np.unique(curve.columns["band"])}))
    height = max(AXIS_MARGIN * max(move.residual for move in moves), MIN_HEIGHT_RATIO * bands[-1])
    thrust_unit = next((of.units["thrust"] for _, of, _ in found if "thrust" in of.units), "")
    return PositioningInfo(moves, bands, height, unit, thrust_unit, title or "Position relative to its target")


def _move_curve(label: str, curve: Curve, place: CurvePlace, factor: float) -> MoveCurve:
    time, position, reference, target = (curve.columns[name] for name in ("time", "position", "reference", "target"))
    moving = np.flatnonzero(np.abs(np.diff(reference)) > REST_TOLERANCE * np.ptp(reference))
    begin = time[moving[0]] if moving.size else time[0]
    deviation = factor * (position - target)
    resting = np.abs(reference - target) <= REST_TOLERANCE * np.ptp(reference)
    residual = float(np.abs(deviation[resting]).max()) if resting.any() else 0.0
    return MoveCurve(label, place, 1e3 * (time - begin), deviation, curve.columns.get("thrust"), residual)


def draw_positioning(info: PositioningInfo) -> "Figure":
    """Draw the deviation from the target above the thrust; random draws are drawn as bundles."""
    places = [move.place for move in info.moves]
    with canvas.figure_style():
        heights = (2.2, 1.0) if info.thrust_unit else (1.0,)
        facets = by_facet(info.moves, places)
        panels = facet_panels(list(facets), (9.0, 2.9 + 2.0 * len(heights)), heights, 1.6 + 1.5 * len(heights))
        styles = group_styles(places)
        for moves, axes in zip(facets.values(), panels.facets.values(), strict=True):
            _draw_facet(axes, moves, styles)
            _draw_bands(axes[0], info)
        upper = panels.first[0]
        if info.height > MAX_LINEAR_RATIO * info.bands[-1]:
            canvas.set_error_axis(upper, 10.0 ** np.ceil(np.log10(info.bands[-1])))
        upper.set_ylim(-info.height, info.height)
        times = [move.time for move in info.moves]
        upper.set_xlim(min(time[0] for time in times), max(time[-1] for time in times))
        canvas.draw_grid(*panels.all)
        y_titles = [canvas.error_axis_title(upper, "Position − target", info.unit), f"Thrust [{info.thrust_unit}]"]
        panels.label(info.title, ["Time since the move began [ms]"], y_titles[: len(heights)])
        panels.add_legend(places)
    return panels.figure


def _draw_facet(axes: Sequence["Axes"], moves: Sequence[MoveCurve], styles: Mapping[str, LineStyle]) -> None:
    """Draw the deviations, and below them the thrusts that are known."""
    draw_grouped_lines(axes[0], [GroupedLine(of.label, of.place, of.time, of.deviation) for of in moves], styles)
    if len(axes) > 1:
        thrusts = [GroupedLine("", of.place, of.time, of.thrust) for of in moves if of.thrust is not None]
        draw_grouped_lines(axes[1], thrusts, styles)


def _draw_bands(axes: "Axes", info: PositioningInfo) -> None:
    for band in info.bands:
        for limit in (-band, band):
            axes.axhline(limit, **canvas.REFERENCE_STYLE)
    style = {**canvas.REFERENCE_STYLE, "label": " and ".join(f"±{band:g} {info.unit}" for band in info.bands)}
    axes.plot([], [], **style)
