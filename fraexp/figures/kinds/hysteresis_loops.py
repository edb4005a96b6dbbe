"""Hysteresis loops: friction force over displacement of friction models and machines."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.facets import by_facet, facet_panels, group_styles
from fraexp.figures.elements.frequency_lines import GroupedLine, add_band_legend, curve_limits
from fraexp.figures.elements.grouping import CurvePlace
from fraexp.figures.elements.panel_figure import MARK_STYLE, Panel, PanelFamily, PanelFigure, draw_panel
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS, FORCE_NAMES, displacement_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PlacedCurve = tuple[str, Curve, CurvePlace]
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


def _group_by_stroke(curves: Sequence[PlacedCurve]) -> list[list[PlacedCurve]]:
    amplitudes = np.array([_amplitude(curve) for _, curve, _ in curves])
    ordered = np.sort(amplitudes[amplitudes > 0])
    if len(ordered) == 0 or ordered[-1] <= MAX_STROKE_RATIO * ordered[0]:
        return [list(curves)]
    gap = int(np.argmax(np.diff(np.log(ordered))))
    small = amplitudes <= ordered[gap]
    return [[curves[index] for index in np.flatnonzero(chosen).tolist()] for chosen in (small, ~small)]


def _families(title: str, curves: Sequence[PlacedCurve]) -> list[PanelFamily]:
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
