"""Hysteresis loops: friction force over displacement of friction models and machines."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements.frequency_lines import add_band_legend, curve_limits, draw_bands
from fraexp.figures.elements.labels import drawable
from fraexp.figures.elements.line_style import LineStyle
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS, FORCE_NAMES, displacement_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_STROKE_RATIO = 5.0
"""Ratio of strokes up to which loops share a panel."""


@dataclass(frozen=True)
class HysteresisLoop:
    """A loop as it is drawn."""

    label: str
    displacement: NDArray[np.float64]
    """Displacement [unit of its panel], shape (n,)."""
    force: NDArray[np.float64]
    """Friction force [N], shape (n,)."""
    limits: NDArray[np.float64] | None
    """Lower and upper 95 % limit of the force [N], shape (2, n); None if they are unknown."""


@dataclass(frozen=True)
class HysteresisPanel:
    """Loops of similar stroke."""

    title: str
    unit: str
    """Unit of the displacement: ``nm``, ``µm`` or ``mm``."""
    loops: tuple[HysteresisLoop, ...]


@dataclass(frozen=True)
class HysteresisInfo:
    """Contents of a hysteresis figure: one panel, or two panels for small and large strokes."""

    panels: tuple[HysteresisPanel, ...]
    force_unit: str
    """``N``, or ``N m`` of a rotary axis."""
    title: str

    @property
    def force_title(self) -> str:
        """Name of the force, with its unit."""
        return f"Friction {FORCE_NAMES[self.force_unit]} [{self.force_unit}]"


def is_hysteresis(curve: Curve) -> bool:
    """Say whether a curve is friction force [N] over displacement [m], or torque [N m] over angle [rad]."""
    return curve.units.get("displacement") in DISPLACEMENT_UNITS and curve.units.get("force") in FORCE_NAMES


def hysteresis_info(curves: Sequence[tuple[str, Curve]], title: str = "") -> HysteresisInfo:
    """Return the loops of labelled curves with the columns displacement and force, by size of stroke."""
    for label, curve in curves:
        if not is_hysteresis(curve):
            found = ", ".join(f"{name} [{unit}]" for name, unit in curve.units.items())
            raise FraexpError(f"hysteresis figure, {label}: found {found}; expected displacement [m], force [N]")
    if not curves:
        raise FraexpError("hysteresis figure: there is no curve to draw; choose sweeps of a driven friction model")
    if len({(curve.units["displacement"], curve.units["force"]) for _, curve in curves}) > 1:
        raise FraexpError("hysteresis figure: found straight and rotary axes; choose sweeps of one kind")
    groups = _group_by_stroke(curves)
    names = ("",) if len(groups) == 1 else ("(a) Small strokes", "(b) Large strokes")
    panels = tuple(_hysteresis_panel(name, group) for name, group in zip(names, groups, strict=True))
    force_unit = curves[0][1].units["force"]
    return HysteresisInfo(panels, force_unit, title or f"Friction {FORCE_NAMES[force_unit]} over displacement")


def _amplitude(curve: Curve) -> float:
    return float(np.ptp(curve.columns["displacement"])) / 2


def _group_by_stroke(curves: Sequence[tuple[str, Curve]]) -> list[list[tuple[str, Curve]]]:
    amplitudes = np.array([_amplitude(curve) for _, curve in curves])
    ordered = np.sort(amplitudes[amplitudes > 0])
    if len(ordered) == 0 or ordered[-1] <= MAX_STROKE_RATIO * ordered[0]:
        return [list(curves)]
    gap = int(np.argmax(np.diff(np.log(ordered))))
    small = amplitudes <= ordered[gap]
    return [[curves[index] for index in np.flatnonzero(chosen).tolist()] for chosen in (small, ~small)]


def _hysteresis_panel(title: str, curves: list[tuple[str, Curve]]) -> HysteresisPanel:
    largest = max(float(np.max(np.abs(curve.columns["displacement"]))) for _, curve in curves)
    factor, unit = displacement_unit(largest, curves[0][1].units["displacement"])
    loops = (
        HysteresisLoop(label, factor * curve.columns["displacement"], curve.columns["force"], curve_limits(curve))
        for label, curve in curves
    )
    return HysteresisPanel(title, unit, tuple(loops))


def draw_hysteresis(info: HysteresisInfo) -> "Figure":
    """Draw hysteresis loops, small and large strokes side by side."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    with canvas.figure_style():
        wide = len(info.panels) > 1
        figure = canvas.new_figure(width=9.0 if wide else 6.6, height=4.6)
        styles = iter(canvas.line_styles(sum(len(panel.loops) for panel in info.panels)))
        panels = figure.subplots(1, len(info.panels), squeeze=False)[0]
        for axes, panel in zip(panels, info.panels, strict=True):
            _draw_panel(axes, panel, styles)
            axes.set_ylabel(info.force_title)
        canvas.draw_grid(*panels)
        (figure.suptitle if wide else panels[0].set_title)(canvas.wrapped_title(figure, info.title))
        if any(loop.limits is not None for panel in info.panels for loop in panel.loops):
            add_band_legend(panels[-1])
        canvas.add_legend_below(figure, *panels)
    return figure


def _draw_panel(axes: "Axes", panel: HysteresisPanel, styles: Iterator[LineStyle]) -> None:
    bands = []
    for loop, style in zip(panel.loops, styles, strict=False):
        axes.plot(loop.displacement, loop.force, label=drawable(loop.label), **style)
        if loop.limits is not None:
            bands.append((loop.displacement, loop.limits, str(style["color"])))
    axes.axhline(0, color="0.55", linewidth=0.8, zorder=1)
    axes.axvline(0, color="0.55", linewidth=0.8, zorder=1)
    draw_bands(axes, bands)
    axes.set_xlabel(f"Displacement [{panel.unit}]")
    axes.set_title(panel.title, fontsize=11, loc="left")
