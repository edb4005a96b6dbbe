"""Curves: each column over the first one in a panel of its own; hysteresis loops and moves to a target otherwise.

A column ``model`` is drawn as a line through the points of the first ordinate; ``lower 95 %`` and ``upper 95 %`` are
its band. Curves with other columns follow below.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.facets import by_facet, facet_panels, group_styles
from fraexp.figures.elements.frequency_lines import LIMIT_COLUMNS, GroupedLine, add_band_legend, curve_limits
from fraexp.figures.elements.grouping import CurvePlace
from fraexp.figures.elements.panel_figure import MARK_STYLE, Panel, PanelFamily, PanelFigure, draw_panel
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS, FORCE_NAMES, displacement_unit, readable_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LabelledCurve = tuple[str, Curve, CurvePlace]
"""Label, curve and place."""
MAX_STROKE_RATIO = 5.0
"""Ratio of strokes up to which loops share a panel."""


def is_hysteresis(curve: Curve) -> bool:
    """Say whether a curve is friction force [N] over displacement [m], or torque [N m] over angle [rad]."""
    return curve.units.get("displacement") in DISPLACEMENT_UNITS and curve.units.get("force") in FORCE_NAMES


def hysteresis_info(
    curves: Sequence[tuple[str, Curve]], title: str = "", places: Sequence[CurvePlace] = ()
) -> PanelFigure:
    """Return the loops of labelled curves with the columns displacement and force, by facet and size of stroke.

    Curves with the same point in their `places` are a sample; without places each has its own colour.
    """
    for label, curve in curves:
        if not is_hysteresis(curve):
            found = ", ".join(f"{name} [{unit}]" for name, unit in curve.units.items())
            raise FraexpError(f"hysteresis figure, {label}: found {found}; expected displacement [m], force [N]")
    if not curves:
        raise FraexpError("hysteresis figure: there is no curve to draw; choose sweeps of a driven friction model")
    if len({(curve.units["displacement"], curve.units["force"]) for _, curve in curves}) > 1:
        raise FraexpError("hysteresis figure: found straight and rotary axes; choose sweeps of one kind")
    alone = [CurvePlace(group=label, point=str(index)) for index, (label, _) in enumerate(curves)]
    placed = [(label, curve, place) for (label, curve), place in zip(curves, places or alone, strict=True)]
    groups = [group for group in _group_by_stroke(placed) if group]
    names = ("",) if len(groups) == 1 else ("(a) Small strokes", "(b) Large strokes")
    families = tuple(family for of in zip(names, groups, strict=True) for family in _families(*of))
    force = FORCE_NAMES[curves[0][1].units["force"]]
    return PanelFigure(families, title or f"Friction {force} over displacement", is_loop=True)


def _amplitude(curve: Curve) -> float:
    return float(np.ptp(curve.columns["displacement"])) / 2


def _group_by_stroke(curves: Sequence[LabelledCurve]) -> list[list[LabelledCurve]]:
    amplitudes = np.array([_amplitude(curve) for _, curve, _ in curves])
    ordered = np.sort(amplitudes[amplitudes > 0])
    if len(ordered) == 0 or ordered[-1] <= MAX_STROKE_RATIO * ordered[0]:
        return [list(curves)]
    gap = int(np.argmax(np.diff(np.log(ordered))))
    small = amplitudes <= ordered[gap]
    return [[curves[index] for index in np.flatnonzero(chosen).tolist()] for chosen in (small, ~small)]


def _families(title: str, curves: Sequence[LabelledCurve]) -> list[PanelFamily]:
    """Return a family of one panel for each facet; all share their unit."""
    largest = max(float(np.max(np.abs(curve.columns["displacement"]))) for _, curve, _ in curves)
    factor, unit = displacement_unit(largest, curves[0][1].units["displacement"])
    loops = [
        GroupedLine(label, place, factor * of.columns["displacement"], of.columns["force"], band=curve_limits(of))
        for label, of, place in curves
    ]
    force_unit = curves[0][1].units["force"]
    force = f"Friction {FORCE_NAMES[force_unit]} [{force_unit}]"
    return [
        PanelFamily(
            f"Displacement [{unit}]",
            (Panel(force, force_unit, tuple(of), marks=(0.0,)),),
            " ".join(filter(None, (title, name))),
        )
        for name, of in by_facet(loops, [loop.place for loop in loops]).items()
    ]


def draw_hysteresis(info: PanelFigure) -> "Figure":
    """Draw hysteresis loops, small and large strokes, and facets, side by side; of similar strokes on the same axes."""
    loops, styles = [panel.lines for panel in info.panels], group_styles(info.places)
    reach = [max(float(np.abs(loop.x).max()) for loop in of) for of in loops]
    alike = len({family.unit for family in info.families}) == 1 and max(reach) <= MAX_STROKE_RATIO * min(reach)
    with canvas.figure_style():
        names = [family.name for family in info.families]
        panels = facet_panels(names, (6.6, 4.6), facet_height=3.9, is_shared=alike)
        for axes, panel in zip(panels.all, info.panels, strict=True):
            axes.axvline(0, **MARK_STYLE)
            draw_panel(axes, panel, panel.lines, styles)
        add_band_legend(panels.all[-1], [loop for of in loops for loop in of])
        x_titles = [family.abscissa for family in info.families]
        return panels.finish(info.title, x_titles, [info.panels[0].title], info.places)


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


MODEL_COLUMN = "model"
LOG_AXIS_RATIO = 10.0
"""Ratio of largest to smallest value over frequency above which an axis is logarithmic."""
GEOMETRIC_TOLERANCE = 1e-6
"""Relative difference of the ratios of neighbours up to which an abscissa is spaced by ratios."""
MIN_BRANCH_GAP = 5.0
"""Gap between positive and negative values, relative to the span of either, from which each gets its own panel."""
ANGLE_UNITS = ("deg", "rad")


class _ShownUnit(NamedTuple):
    """The unit in which a column is drawn."""

    factor: float
    """Factor from the stored unit."""
    name: str
    stored: str
    """Name of the stored unit."""


def curves_info(curves: Sequence[tuple[str, Curve]], title: str = "", places: Sequence[CurvePlace] = ()) -> PanelFigure:
    """Return the families of labelled curves, by their names and columns; FraexpError if there is no curve.

    Curves of a family with the same point in their `places` are a sample; without places each has its own.
    """
    alone = [CurvePlace(group=label, point=str(index)) for index, (label, _) in enumerate(curves)]
    found: list[list[LabelledCurve]] = []
    for (label, curve), place in zip(curves, places or alone, strict=True):
        if len(curve.columns) < 2:  # a single column has no abscissa
            continue
        family = next((of for of in found if _share_panels(of[0][1], curve)), None)
        if family is None:
            found.append(family := [])
        family.append((label, curve, place))
    if not found:
        raise FraexpError("curves figure: there is no curve to draw; choose sweeps that have one")
    has_labels = len({label for label, _ in curves}) > 1
    families = tuple(_curve_family(alike, has_labels) for alike in found)
    return PanelFigure(families, title or (families[0].name if len(families) == 1 else "") or "Curves")


def _share_panels(one: Curve, other: Curve) -> bool:
    """Return whether two curves share their panels."""
    shared = [name for name in one.columns if name in other.columns]
    same = one.name == other.name or list(one.columns) == list(other.columns)
    abscissa = next(iter(one.columns)) == next(iter(other.columns))
    return same and abscissa and all(one.units[name] == other.units[name] for name in shared)


def _curve_family(alike: Sequence[LabelledCurve], has_labels: bool) -> PanelFamily:
    names = list(dict.fromkeys(curve.name for _, curve, _ in alike))
    if len(names) > 1:
        alike = [
            (
                _full_name(label, curve, has_labels),
                curve,
                place._replace(
                    group=_full_name(place.group, curve, bool(place.group) and has_labels),
                    point=f"{place.point}, {curve.name}",
                ),
            )
            for label, curve, place in alike
        ]
    abscissa, *others = dict.fromkeys(name for _, curve, _ in alike for name in curve.columns)
    ordinates = others[:1] + [name for name in others[1:] if name not in (MODEL_COLUMN, *LIMIT_COLUMNS)]
    stored = np.concatenate([curve.columns[abscissa] for _, curve, _ in alike])
    units = _shown_units(alike, (abscissa,)) | _shown_units(alike, ordinates)
    x = units[abscissa].factor * stored
    is_spectral = units[abscissa].name == "Hz" and x.size > 0 and bool((x > 0).all())
    is_logarithmic = is_spectral or all(_is_geometric(curve.columns[abscissa]) for _, curve, _ in alike)
    whole = [_curve_panel(alike, abscissa, name, units, name == others[0]) for name in ordinates]
    panels = [part for panel in whole for part in _split_branches(panel)]
    return PanelFamily(
        _axis_title(abscissa, units),
        tuple(_with_log_axes(panels) if is_spectral else panels),
        _capitalised(_force_name(names[0], units[others[0]].stored)) if len(names) == 1 else "",
        is_logarithmic,
        (float(x.min()), float(x.max())) if is_logarithmic else None,
    )


def _is_geometric(x: NDArray[np.float64]) -> bool:
    """Return whether values rise by one ratio, to more than ten times the first."""
    if x.size < 3 or not (np.isfinite(x) & (x > 0)).all():
        return False
    steps = np.diff(np.log(x))
    return bool(x[-1] > LOG_AXIS_RATIO * x[0] and np.ptp(steps) < GEOMETRIC_TOLERANCE * steps.mean())


def _full_name(name: str, curve: Curve, also: bool) -> str:
    """Return a curve's name, after another name if `also`."""
    return f"{name}, {curve.name}" if also else curve.name


def _shown_units(alike: Sequence[LabelledCurve], columns: Sequence[str]) -> dict[str, _ShownUnit]:
    """Return the units in which columns are shown; displacements in a unit that suits the largest of them."""
    stored = {name: unit for _, curve, _ in alike for name, unit in curve.units.items() if name in columns}
    known = {unit: _largest_value(alike, columns, unit) for unit in DISPLACEMENT_UNITS}
    return {
        name: _ShownUnit(*(displacement_unit(known[unit], unit) if unit in known else readable_unit(unit)), unit)
        for name, unit in stored.items()
    }


def _largest_value(alike: Sequence[LabelledCurve], columns: Sequence[str], unit: str) -> float:
    """Return the largest finite size of the columns that have a unit."""
    having = [curve.columns[name] for _, curve, _ in alike for name in columns if curve.units.get(name) == unit]
    sizes = np.abs(np.concatenate([[0.0], *having]))
    return float(sizes[np.isfinite(sizes)].max())


def _curve_panel(
    alike: Sequence[LabelledCurve], abscissa: str, ordinate: str, units: Mapping[str, _ShownUnit], first: bool
) -> Panel:
    having = [(label, curve, place) for label, curve, place in alike if ordinate in curve.columns]
    shown = {name: units[name] for name in (abscissa, ordinate)}
    traces = tuple(_curve_trace(label, curve, place, shown, first) for label, curve, place in having)
    return Panel(_axis_title(ordinate, units), units[ordinate].name, traces)


def _split_branches(panel: Panel) -> list[Panel]:
    """Return a panel as two, for positive and negative values, if the gap between these hides how each one rises."""
    known = np.concatenate([trace.y[np.isfinite(trace.y)] for trace in panel.lines])
    above, below = known[known > 0], known[known < 0]
    if not above.size or not below.size or above.size + below.size < known.size:
        return [panel]
    if above.min() - below.max() < MIN_BRANCH_GAP * max(np.ptp(above), np.ptp(below)):
        return [panel]
    return [replace(panel, lines=tuple(_branch(trace, sign) for trace in panel.lines)) for sign in (1.0, -1.0)]


def _branch(trace: GroupedLine, sign: float) -> GroupedLine:
    """Return the part of a trace whose values have a sign."""
    inside = sign * trace.y > 0
    model = None if trace.model is None else np.where(inside, trace.model, np.nan)
    band = None if trace.band is None else np.where(inside, trace.band, np.nan)
    y = np.where(inside, trace.y, np.nan)
    return replace(trace, y=y, settled=np.isfinite(y), model=model, band=band)


def _with_log_axes(panels: Sequence[Panel]) -> list[Panel]:
    """Return panels over frequency; amplitudes in one unit share a logarithmic axis if they span a decade."""
    sizes = {panel.ordinate: _positive_values(panel) for panel in panels}
    found = []
    for panel in panels:
        alike = [sizes[of.ordinate] for of in panels if of.unit == panel.unit and sizes[of.ordinate].size]
        wide = sizes[panel.ordinate].size and np.ptp(np.log(np.concatenate(alike))) >= np.log(LOG_AXIS_RATIO)
        found.append(replace(panel, is_log=bool(wide)))
    return found


def _positive_values(panel: Panel) -> NDArray[np.float64]:
    """Return the values of a panel if they are amplitudes, all above 0; otherwise none."""
    known = np.concatenate([trace.y[np.isfinite(trace.y)] for trace in panel.lines])
    limited = any(trace.band is not None for trace in panel.lines)
    sizes = panel.unit.lstrip("mµn") not in ANGLE_UNITS and not limited and bool((known > 0).all())
    return known if sizes else np.empty(0)


def _curve_trace(
    label: str, curve: Curve, place: CurvePlace, shown: Mapping[str, _ShownUnit], first: bool
) -> GroupedLine:
    """Return a column over the abscissa, which is first in `shown`; the first ordinate has model and limits."""
    x, y = (unit.factor * curve.columns[name] for name, unit in shown.items())
    factor, model, limits = list(shown.values())[1].factor, curve.columns.get(MODEL_COLUMN), curve_limits(curve)
    return GroupedLine(
        label,
        place,
        x,
        y,
        settled=np.isfinite(y),
        band=factor * limits if first and limits is not None else None,
        model=factor * model if first and model is not None else None,
    )


def _axis_title(name: str, units: Mapping[str, _ShownUnit]) -> str:
    return f"{_capitalised(_force_name(name, units[name].stored))} [{units[name].name}]"


def _force_name(name: str, unit: str) -> str:
    """Return a name with "force" called by its unit: a torque in N m."""
    return name.replace(FORCE_NAMES["N"], FORCE_NAMES.get(unit, FORCE_NAMES["N"]))


def _capitalised(name: str) -> str:
    return name[:1].upper() + name[1:]
