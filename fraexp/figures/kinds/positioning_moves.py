"""Positioning: deviation of the position from its target over the time since the move began, and the thrust."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements.frequency_lines import GroupedLine
from fraexp.figures.elements.grouping import CurvePlace
from fraexp.figures.elements.panel_figure import Panel, PanelFamily, PanelFigure
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS

REQUIRED_COLUMNS = ("time", "position", "reference", "target", "band")
"""Columns of a positioning curve, beside an optional ``thrust``."""
MIN_HEIGHT_RATIO, MAX_LINEAR_RATIO = 2.5, 6.0
"""Least height of the axis, and greatest height of a linear axis, in half widths of the band."""
AXIS_MARGIN = 1.15
"""Height of the axis relative to the largest residual."""
REST_TOLERANCE = 1e-9
"""Change of the reference per sample, relative to its range, up to which it is at rest."""


def is_positioning(curve: Curve) -> bool:
    """Return whether a curve is a move to targets with settling windows."""
    lengths = {curve.units.get(name) for name in REQUIRED_COLUMNS[1:]}
    return (
        all(name in curve.columns for name in REQUIRED_COLUMNS) and curve.units.get("time") == "s" and len(lengths) == 1
    )


def positioning_info(
    curves: Sequence[tuple[str, Curve]], title: str = "", places: Sequence[CurvePlace] = ()
) -> PanelFigure:
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
    deviation = Panel(
        f"Position − target [{unit}]",
        unit,
        deviations,
        linear_range=10.0 ** np.ceil(np.log10(bands[-1])) if height > MAX_LINEAR_RATIO * bands[-1] else None,
        span=(-height, height),
        marks=tuple(sign * band for band in bands for sign in (-1, 1)),
        mark_name=" and ".join(f"±{band:g} {unit}" for band in bands),
        height=3.4,
    )
    panels = (deviation, *([Panel(f"Thrust [{thrust_unit}]", thrust_unit, thrusts, height=1.6)] if thrust_unit else []))
    span = min(line.x[0] for line in deviations), max(line.x[-1] for line in deviations)
    family = PanelFamily("Time since the move began [ms]", panels, span=span)
    return PanelFigure((family,), title or "Position relative to its target")


def _deviation(label: str, curve: Curve, place: CurvePlace, factor: float) -> tuple[GroupedLine, float]:
    """Return the deviation from the target, and its largest value while the reference rests there."""
    time, position, reference, target = (curve.columns[name] for name in ("time", "position", "reference", "target"))
    moving = np.flatnonzero(np.abs(np.diff(reference)) > REST_TOLERANCE * np.ptp(reference))
    begin = time[moving[0]] if moving.size else time[0]
    deviation = factor * (position - target)
    resting = np.abs(reference - target) <= REST_TOLERANCE * np.ptp(reference)
    residual = float(np.abs(deviation[resting]).max()) if resting.any() else 0.0
    return GroupedLine(label, place, 1e3 * (time - begin), deviation), residual
