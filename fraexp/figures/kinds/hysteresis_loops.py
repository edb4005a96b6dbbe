"""Hysteresis loops: friction force over displacement of friction models and machines."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.facets import by_facet, facet_panels, group_styles
from fraexp.figures.elements.frequency_lines import GroupedLine, add_band_legend, curve_limits, draw_grouped_lines
from fraexp.figures.elements.grouping import CurvePlace
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS, FORCE_NAMES, displacement_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PlacedCurve = tuple[str, Curve, CurvePlace]
"""Label, curve and place."""
MAX_STROKE_RATIO = 5.0
"""Ratio of strokes up to which loops share a panel."""


@dataclass(frozen=True)
class HysteresisPanel:
    """Loops of similar stroke."""

    title: str
    unit: str
    """Unit of the displacement: ``nm``, ``µm`` or ``mm``."""
    loops: tuple[GroupedLine, ...]
    """Friction force over displacement."""


@dataclass(frozen=True)
class HysteresisInfo:
    """Contents of a hysteresis figure: a panel for each facet, twice if there are small and large strokes."""

    panels: tuple[HysteresisPanel, ...]
    force_unit: str
    """``N``, or ``N m`` of a rotary axis."""
    title: str

    @property
    def is_alike(self) -> bool:
        """Whether the panels have similar strokes, so that they share their axes."""
        reach = [max(float(np.abs(loop.x).max()) for loop in panel.loops) for panel in self.panels]
        return len({panel.unit for panel in self.panels}) == 1 and max(reach) <= MAX_STROKE_RATIO * min(reach)

    @property
    def force_title(self) -> str:
        """Name of the force, with its unit."""
        return f"Friction {FORCE_NAMES[self.force_unit]} [{self.force_unit}]"


def is_hysteresis(curve: Curve) -> bool:
    """Say whether a curve is friction force [N] over displacement [m], or torque [N m] over angle [rad]."""
    return curve.units.get("displacement") in DISPLACEMENT_UNITS and curve.units.get("force") in FORCE_NAMES


def hysteresis_info(
    curves: Sequence[tuple[str, Curve]], title: str = "", places: Sequence[CurvePlace] = ()
) -> HysteresisInfo:
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
    panels = tuple(panel for of in zip(names, groups, strict=True) for panel in _hysteresis_panels(*of))
    force_unit = curves[0][1].units["force"]
    return HysteresisInfo(panels, force_unit, title or f"Friction {FORCE_NAMES[force_unit]} over displacement")


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


def _hysteresis_panels(title: str, curves: Sequence[PlacedCurve]) -> list[HysteresisPanel]:
    """Return a panel for each facet; all share their unit."""
    largest = max(float(np.max(np.abs(curve.columns["displacement"]))) for _, curve, _ in curves)
    factor, unit = displacement_unit(largest, curves[0][1].units["displacement"])
    loops = [
        GroupedLine(label, place, factor * of.columns["displacement"], of.columns["force"], band=curve_limits(of))
        for label, of, place in curves
    ]
    facets = by_facet(loops, [loop.place for loop in loops])
    return [HysteresisPanel(" ".join(filter(None, (title, name))), unit, tuple(of)) for name, of in facets.items()]


def draw_hysteresis(info: HysteresisInfo) -> "Figure":
    """Draw hysteresis loops, small and large strokes, and facets, side by side."""
    loops = [loop for panel in info.panels for loop in panel.loops]
    places = [loop.place for loop in loops]
    with canvas.figure_style():
        titles, styles = [panel.title for panel in info.panels], group_styles(places)
        panels = facet_panels(titles, (6.6, 4.6), facet_height=3.9, is_shared=info.is_alike)
        for axes, panel in zip(panels.all, info.panels, strict=True):
            axes.axhline(0, color="0.55", linewidth=0.8, zorder=1)
            axes.axvline(0, color="0.55", linewidth=0.8, zorder=1)
            draw_grouped_lines(axes, panel.loops, styles)
        if any(loop.band is not None for loop in loops):
            add_band_legend(panels.all[-1])
        x_titles = [f"Displacement [{panel.unit}]" for panel in info.panels]
        return panels.finish(info.title, x_titles, [info.force_title], places)
