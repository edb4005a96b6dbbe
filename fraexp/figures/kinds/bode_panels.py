"""The drawing of a Bode plot: magnitude above phase, once, or for each facet of a grid."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fraexp.figures.elements.asymptotes import mass_text, stiffness_text
from fraexp.figures.elements.bands import DrawnBand, draw_bands
from fraexp.figures.elements.bundles import draw_bundles
from fraexp.figures.elements.facets import facet_panels
from fraexp.figures.elements.frequency_lines import (
    EXTREMUM_SIZE,
    LEGEND_GREY,
    add_fitted_legend,
    add_model_legend,
    draw_extrema,
    draw_line,
    draw_points_and_model,
    near_neighbours,
    split_line,
)
from fraexp.figures.elements.line_style import LineStyle
from fraexp.figures.elements.view import PHASE_LABEL
from fraexp.figures.kinds.bode import BodeInfo, BodeModel, BodeSample

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UNSETTLED_STYLE: LineStyle = {
    "color": "0.3", "fillstyle": "none", "markersize": 2.5, "mew": 0.4, "zorder": 1.9, "rasterized": True,
}  # fmt: skip
"""Style of the points of a sample that had not settled."""
RIGID_BODY_STYLE: LineStyle = {"color": "0.5", "linestyle": (0, (1, 2)), "linewidth": 0.9, "zorder": 1.8}
"""Style of the line of the apparent mass."""
SPRING_STYLE: LineStyle = {**RIGID_BODY_STYLE, "linestyle": (0, (5, 2, 1, 2))}
"""Style of the line of a constant stiffness."""


def draw_bode(info: BodeInfo) -> "Figure":
    """Draw a Bode plot; unsettled points are hollow and not joined, the reference is dashed and dark.

    Neighbours between which a mode could hide are not joined, and their band is a bar at each point. A response
    to which a plant was fitted is points, the plant a thin line. Samples are drawn as bundles.
    """
    return draw_bode_facets({"": info})


def draw_bode_facets(facets: Mapping[str, BodeInfo]) -> "Figure":
    """Draw a Bode plot for each facet, by its name; all share their axes, and the colours of their curves."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    infos = list(facets.values())
    with canvas.figure_style():
        panels = facet_panels(list(facets), (9.0, 6.2), (1.25, 1.0), facet_height=4.6)
        styles = _curve_styles(infos)
        for info, (upper, lower) in zip(infos, panels.facets.values(), strict=True):
            _draw_part(upper, info, "magnitude", styles)
            _draw_part(lower, info, "phase", styles)
            lower.set_label(PHASE_LABEL)
        lower = panels.first[1]
        canvas.set_log_abscissa(lower, _frequency_span(infos))
        canvas.set_phase_ticks(lower)
        canvas.draw_grid(*panels.all)
        panels.label(infos[0].title, ["Frequency [Hz]"], (f"Magnitude [dB re 1 {infos[0].unit}]", "Phase [deg]"))
        canvas.add_legend_below(panels.figure, *(upper for upper, _ in panels.facets.values()))
    return panels.figure


def _curve_styles(infos: Sequence[BodeInfo]) -> dict[str, LineStyle]:
    """Return the style of each name of a curve, which all facets share."""
    from fraexp.figures.elements import canvas

    labels = [[of.label for of in info.curves] + [of.label for of in info.samples] for info in infos]
    names = list(dict.fromkeys(label for of in labels for label in of))
    return dict(zip(names, canvas.line_styles(len(names)), strict=True))


def _draw_part(axes: "Axes", info: BodeInfo, part: str, styles: Mapping[str, LineStyle]) -> None:
    """Draw one part, ``magnitude`` or ``phase``, of all curves and samples."""
    from fraexp.figures.elements import canvas

    if info.samples:
        colours = {name: str(style["color"]) for name, style in styles.items()}
        bundles = [of.bundle(getattr(of, part)) for of in info.samples]
        draw_bundles(axes, bundles, part == "magnitude", colours)
        _draw_unsettled(axes, info.samples, part)
    bands = []
    for curve in info.curves:
        values, model, style = getattr(curve, part), curve.model, styles[curve.label]
        joined = near_neighbours(curve.frequency)
        if model is None:
            draw_line(axes, curve.frequency, values, curve.settled, curve.label, style, joined)
        else:
            points, line = (curve.frequency, values), (model.frequency, getattr(model, part))
            draw_points_and_model(axes, points, curve.settled, line, style, joined)
            if part == "magnitude":
                draw_extrema(axes, model.frequency, model.magnitude, model.extremum, style)
                axes.plot(model.frequency, model.rigid_body, **RIGID_BODY_STYLE)
                if model.spring:
                    axes.plot(model.spring.frequency, [model.spring_level] * 2, **SPRING_STYLE)
            add_fitted_legend(axes, curve.label if model.has_phase else f"{curve.label} (fit of the magnitude)", style)
        band = curve.with_gaps(getattr(curve, f"{part}_band"))
        x, of_line = split_line(curve.frequency, np.vstack([values, band]), joined)
        bands.append(DrawnBand(x, of_line[0], of_line[1:], str(style["color"])))
    if any(curve.model for curve in info.curves):
        add_model_legend(axes, "fitted plant")
        _add_plant_legend(axes, [curve.model for curve in info.curves if curve.model], info.source_unit)
    if info.reference is not None:
        of = info.reference
        draw_line(axes, of.frequency, getattr(of, part), of.settled, of.label, canvas.REFERENCE_STYLE)
    draw_bands(axes, bands)


def _add_plant_legend(axes: "Axes", models: Sequence[BodeModel], unit: str) -> None:
    """Add the entries of what is marked: extrema, and the lines of apparent mass and stiffness."""
    for sign, marker, label in ((1, "v", "resonance"), (-1, "^", "antiresonance")):
        if any((model.extremum == sign).any() for model in models):
            axes.plot([], [], marker, color=LEGEND_GREY, markersize=EXTREMUM_SIZE, label=label)
    gains = [model.rigid_body_gain for model in models if np.isfinite(model.rigid_body_gain)]
    if gains:
        axes.plot([], [], label=mass_text(gains, unit), **RIGID_BODY_STYLE)
    springs = [model.spring for model in models if model.spring]
    if springs:
        axes.plot([], [], label=stiffness_text(springs, unit), **SPRING_STYLE)


def _draw_unsettled(axes: "Axes", samples: Sequence[BodeSample], part: str) -> None:
    frequency = np.concatenate([of.frequency[~of.settled] for of in samples])
    if np.isfinite(frequency).any():
        points = np.concatenate([getattr(of, part)[~of.settled] for of in samples])
        axes.plot(frequency, points, "o", alpha=0.3, **UNSETTLED_STYLE)
        axes.plot([], [], "o", label="not settled", **UNSETTLED_STYLE)


def _frequency_span(infos: Sequence[BodeInfo]) -> tuple[float, float]:
    curves = [of.frequency for info in infos for of in info.curves]
    everything = np.concatenate([*curves, *(of.frequency.ravel() for info in infos for of in info.samples)])
    return float(np.nanmin(everything)), float(np.nanmax(everything))
