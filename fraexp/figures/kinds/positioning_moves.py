"""Positioning: deviation of the position from its target over the time since the move began, and the thrust."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.frequency_lines import GroupedLine, draw_rows
from fraexp.figures.elements.grouping import CurvePlace
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS

if TYPE_CHECKING:
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
class PositioningInfo:
    """Contents of a figure of positioning."""

    deviations: tuple[GroupedLine, ...]
    """Position less target [unit of the figure] over the time since the reference began to move [ms]."""
    thrusts: tuple[GroupedLine, ...]
    """Thrust [its unit] over that time, of the moves of which it is known."""
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


def positioning_info(
    curves: Sequence[tuple[str, Curve]], title: str = "", places: Sequence[CurvePlace] = ()
) -> PositioningInfo:
    """Return the moves in labelled curves, each at its place; FraexpError if there is none."""
    pairs = zip(curves, places or [CurvePlace()] * len(curves), strict=True)
    found = [(label, curve, place) for (label, curve), place in pairs if is_positioning(curve)]
    if not found:
        raise FraexpError("positioning figure: there is no positioning motion; use estimator 'positioning_metrics'")
    length = found[0][1].units["position"]
    if any(curve.units["position"] != length for _, curve, _ in found):
        raise FraexpError("positioning figure: found positions in several units; choose sweeps that share one")
    factor, unit = (1e6, f"µ{length}") if length in DISPLACEMENT_UNITS else (1.0, length)
    moves = [_deviation(label, curve, place, factor) for label, curve, place in found]
    bands = tuple(sorted({factor * float(band) for _, curve, _ in found for band in np.unique(curve.columns["band"])}))
    height = max(AXIS_MARGIN * max(residual for _, residual in moves), MIN_HEIGHT_RATIO * bands[-1])
    deviations = tuple(line for line, _ in moves)
    with_thrust = [(line, curve.columns.get("thrust")) for line, (_, curve, _) in zip(deviations, found, strict=True)]
    thrusts = tuple(replace(line, name="", y=thrust) for line, thrust in with_thrust if thrust is not None)
    thrust_unit = next((of.units["thrust"] for _, of, _ in found if "thrust" in of.units), "")
    heading = title or "Position relative to its target"
    return PositioningInfo(deviations, thrusts, bands, height, unit, thrust_unit, heading)


def _deviation(label: str, curve: Curve, place: CurvePlace, factor: float) -> tuple[GroupedLine, float]:
    """Return the deviation from the target, and its largest value while the reference rests there."""
    time, position, reference, target = (curve.columns[name] for name in ("time", "position", "reference", "target"))
    moving = np.flatnonzero(np.abs(np.diff(reference)) > REST_TOLERANCE * np.ptp(reference))
    begin = time[moving[0]] if moving.size else time[0]
    deviation = factor * (position - target)
    resting = np.abs(reference - target) <= REST_TOLERANCE * np.ptp(reference)
    residual = float(np.abs(deviation[resting]).max()) if resting.any() else 0.0
    return GroupedLine(label, place, 1e3 * (time - begin), deviation), residual


def draw_positioning(info: PositioningInfo) -> "Figure":
    """Draw the deviation from the target above the thrust; random draws are drawn as bundles."""
    rows = [info.deviations, *([info.thrusts] if info.thrust_unit else [])]
    with canvas.figure_style():
        size, heights = (9.0, 2.9 + 2.0 * len(rows)), (2.2, 1.0)[: len(rows)]
        panels = draw_rows(rows, size, heights, 1.6 + 1.5 * len(rows))
        for axes in (facet[0] for facet in panels.facets.values()):
            for limit in (sign * band for band in info.bands for sign in (-1, 1)):
                axes.axhline(limit, **canvas.REFERENCE_STYLE)
            axes.plot(
                [], [], label=" and ".join(f"±{band:g} {info.unit}" for band in info.bands), **canvas.REFERENCE_STYLE
            )
        upper = panels.first[0]
        if info.height > MAX_LINEAR_RATIO * info.bands[-1]:
            canvas.set_error_axis(upper, 10.0 ** np.ceil(np.log10(info.bands[-1])))
        upper.set_ylim(-info.height, info.height)
        upper.set_xlim(min(line.x[0] for line in info.deviations), max(line.x[-1] for line in info.deviations))
        y_titles = [canvas.error_axis_title(upper, "Position − target", info.unit), f"Thrust [{info.thrust_unit}]"]
        places = [line.place for line in info.deviations]
        return panels.finish(info.title, ["Time since the move began [ms]"], y_titles[: len(rows)], places)
