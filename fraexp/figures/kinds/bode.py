"""The Bode plot: magnitude and phase of frequency responses over frequency, with 95 % bands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import Curve, FrequencyResponse
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.bands import Bundle, DrawnBand, draw_bands, draw_bundles, stack_padded
from fraexp.figures.elements.canvas import LineStyle
from fraexp.figures.elements.facets import facet_panels
from fraexp.figures.elements.frequency_lines import (
    EXTREMUM_SIZE,
    LEGEND_GREY,
    PhasedCurve,
    add_fitted_legend,
    add_model_legend,
    draw_extrema,
    draw_line,
    draw_points_and_model,
    near_neighbours,
    split_line,
)
from fraexp.figures.elements.grouping import CurvePlace, point_indices
from fraexp.figures.elements.scales import (
    PLANT_UNITS,
    continuous_phase,
    decibel,
    decibel_limits,
    degree_limits,
    degrees,
    readable_unit,
)
from fraexp.figures.elements.view import PHASE_LABEL, wrap_phase

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_SPRING_PHASE = np.pi / 4
"""Phase [rad] up to which a response is that of a spring."""
MAX_STIFFNESS_RATIO = 1.5
"""Largest over smallest stiffness of the points that count as one."""
MIN_SPRING_POINTS = 3
"""Number of neighbouring points that show a stiffness."""
MASS_UNITS = {"m/N": "kg", "rad/(N m)": "kg m²"}
STIFFNESS_UNITS = {"m/N": (1e-6, "N/µm"), "rad/(N m)": (1.0, "N m/rad")}
"""Factor from SI, and unit, of a stiffness by the unit of a response."""


class Spring(NamedTuple):
    """The line of a constant stiffness."""

    frequency: NDArray[np.float64]
    """Ends of the line [Hz], shape (2,): the lowest point, and where it meets the line of the mass."""
    magnitude: float
    """1/K [unit of the response]."""


def spring_line(source: FrequencyResponse, rigid_body_gain: float) -> Spring | None:
    """Return the stiffness K that a response shows at its lowest frequencies; None if it shows none there.

    K = Re(1/G) + ω²/k0 with the rigid-body gain k0 is that of the spring beside the mass. At small amplitudes it is
    that of friction in presliding; a plant without friction moves freely, and has none.
    """
    source = source.ascending()
    usable = source.settled & np.isfinite(source.response) & (source.response != 0)
    if source.unit not in PLANT_UNITS or usable.sum() < MIN_SPRING_POINTS or not rigid_body_gain > 0:
        return None
    frequency, inverse = source.frequency[usable], 1 / source.response[usable]
    stiffness = inverse.real + (2 * np.pi * frequency) ** 2 / rigid_body_gain
    is_spring = np.abs(np.angle(inverse)) < MAX_SPRING_PHASE
    with np.errstate(invalid="ignore"):
        ratio = np.maximum.accumulate(stiffness) / np.minimum.accumulate(stiffness)
    is_spring &= (stiffness > 0) & (ratio < MAX_STIFFNESS_RATIO)
    count = int(np.argmin(is_spring)) if not is_spring.all() else is_spring.size
    if count < MIN_SPRING_POINTS:
        return None
    value = float(np.median(stiffness[:count]))
    corner = np.sqrt(value * rigid_body_gain) / (2 * np.pi)
    return Spring(np.array([frequency[0], max(corner, frequency[count - 1])]), 1 / value)


def mass_text(gains: Sequence[float], unit: str) -> str:
    """Return the legend of the line of the apparent mass, with its value or range if the unit tells it."""
    if unit not in MASS_UNITS:
        return "rigid body (apparent mass)"
    name = "inertia" if unit.startswith("rad") else "mass"
    return f"rigid body (apparent {name} {_range_text([1 / gain for gain in gains], 4)} {MASS_UNITS[unit]})"


def stiffness_text(springs: Sequence[Spring], unit: str) -> str:
    """Return the legend of the line of the stiffness, with its value or range."""
    factor, shown = STIFFNESS_UNITS[unit]
    return f"stiffness {_range_text([factor / spring.magnitude for spring in springs], 3)} {shown}"


def _range_text(values: Sequence[float], digits: int) -> str:
    low, high = (_plain_number(value, digits) for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _plain_number(value: float, digits: int) -> str:
    """Return a number with so many digits, without an exponent while it is short."""
    return f"{float(f'{value:.{digits}g}'):.{max(digits, 6)}g}"


Reference = tuple[str, NDArray[np.float64], NDArray[np.complex128]]
"""Label, frequency [Hz] and complex response, both of shape (n,), in the unit of the curves."""


@dataclass(frozen=True)
class BodeCurve(PhasedCurve):
    """A response as it is drawn in a Bode plot; its magnitude is in dB re the unit of the plot."""

    model: "BodeModel | None" = None
    """The plant that was fitted to it; None without a fit."""


@dataclass(frozen=True)
class BodeModel:
    """A fitted plant as it is drawn in a Bode plot, over the frequency range of the fit."""

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    magnitude: NDArray[np.float64]
    """Magnitude [dB], shape (n,)."""
    phase: NDArray[np.float64]
    """Phase [deg] on the branch of the response, shape (n,); NaN if only the magnitude was fitted."""
    extremum: NDArray[np.float64]
    """1 at a resonance, -1 at an antiresonance, otherwise 0, shape (n,)."""
    rigid_body: NDArray[np.float64]
    """Magnitude of the rigid body alone [dB], the line of its apparent mass, shape (n,); NaN if it is unknown."""
    rigid_body_gain: float = np.nan
    """Its gain k0 = 1/M [unit of the response/s²]; NaN if it is unknown."""
    spring: Spring | None = None
    """The stiffness that the response shows below; None if it shows none."""
    spring_level: float = np.nan
    """Magnitude of that spring [dB]."""

    @property
    def has_phase(self) -> bool:
        """Whether the phase was fitted too."""
        return not np.isnan(self.phase).all()


@dataclass(frozen=True)
class BodeSample:
    """Random draws at one point of the grid as they are drawn in a Bode plot, each a row, all of shape (m, n).

    The frequencies ascend; the rows of responses with fewer points than others end in NaN.
    """

    label: str
    """Name of its group; empty if there is one."""
    noun: str
    """What its rows are, such as a draw."""
    frequency: NDArray[np.float64]
    """Frequency [Hz]."""
    magnitude: NDArray[np.float64]
    """Magnitude [dB]."""
    phase: NDArray[np.float64]
    """Continuous phase [deg]."""
    settled: NDArray[np.bool_]
    """Whether the point had settled; lines join settled points only."""

    def bundle(self, values: NDArray[np.float64]) -> Bundle:
        """Return values of shape (m, n) as a bundle with gaps where the responses were not settled."""
        return Bundle(self.label, self.frequency, np.where(self.settled, values, np.nan), self.noun)


@dataclass(frozen=True)
class BodeInfo:
    """Contents of a Bode plot: a curve for each response, and a sample where random draws share a point of the grid."""

    curves: tuple[BodeCurve, ...]
    samples: tuple[BodeSample, ...]
    reference: BodeCurve | None
    unit: str
    """Unit that is 0 dB, such as ``mm/N``."""
    title: str
    source_unit: str = ""
    """Unit of the responses, such as ``m/N``."""


def bode_info(
    curves: Sequence[tuple[str, FrequencyResponse]],
    reference: Reference | None = None,
    title: str = "",
    places: Sequence[CurvePlace] = (),
    fitted: Sequence[Curve | None] = (),
    wrapped: bool = False,
) -> BodeInfo:
    """Return the numbers of a Bode plot of labelled responses; FraexpError if their units differ.

    The phases lie on the branch nearest to the reference, or without one to the first curve. Responses with the same
    point in their `places` are a sample; without places each is a curve. `fitted` are the plants that were fitted to
    the responses (see `ShownResult.fitted`), which are drawn with curves. `wrapped` phases lie within ±180°.
    """
    unit = _common_unit(curves)
    factor, shown = readable_unit(unit)
    drawn_reference = _reference_curve(reference, factor) if reference else None
    heading = title or _default_title(curves)
    known = [index for index, (_, of) in enumerate(curves) if len(of.frequency)]
    points = point_indices([places[index] for index in known]) if places else {}
    indices = [[known[at] for at in of] for of in points.values()] or [[index] for index in range(len(curves))]
    models = fitted or [None] * len(curves)
    singles = [of[0] for of in indices if len(of) == 1]
    anchor, drawn = drawn_reference or _first_curve(curves), []
    for (label, response), model in ((curves[index], models[index]) for index in singles):
        curve = _bode_curve(label, response, factor, anchor)
        drawn.append(replace(curve, model=_bode_model(model, factor, curve, response)) if model else curve)
    samples = tuple(
        _bode_sample([curves[index][1] for index in of], places[of[0]], factor, anchor) for of in indices if len(of) > 1
    )
    return _wrap_phase(BodeInfo(tuple(drawn), samples, drawn_reference, shown, heading, unit), wrapped)


def _first_curve(curves: Sequence[tuple[str, FrequencyResponse]]) -> BodeCurve | None:
    """Return the first response, on the branch of whose phase those of the others lie."""
    first = next((of for of in curves if of[1].settled.any()), None)
    return _bode_curve(*first, 1.0, None) if first is not None else None


def _wrap_phase(info: BodeInfo, wanted: bool) -> BodeInfo:
    if not wanted:
        return info
    samples = tuple(replace(of, phase=wrap_phase(of.phase)) for of in info.samples)
    reference = _wrapped_curve(info.reference) if info.reference else None
    return replace(info, curves=tuple(map(_wrapped_curve, info.curves)), samples=samples, reference=reference)


def _wrapped_curve(of: BodeCurve) -> BodeCurve:
    phase = wrap_phase(of.phase)
    model = replace(of.model, phase=wrap_phase(of.model.phase)) if of.model else None
    return replace(of, phase=phase, phase_band=of.phase_band + (phase - of.phase), model=model)


def _common_unit(curves: Sequence[tuple[str, FrequencyResponse]]) -> str:
    units = sorted({response.unit for _, response in curves})
    if len(units) != 1:
        found = " and ".join(units) or "nothing"
        raise FraexpError(f"Bode plot: found responses in {found}; curves of one plot share a unit")
    return units[0]


def _default_title(curves: Sequence[tuple[str, FrequencyResponse]]) -> str:
    paths = list(dict.fromkeys(f"{response.output}/{response.input}" for _, response in curves))
    return f"Frequency response {' and '.join(paths)}"


def _reference_curve(reference: Reference, factor: float) -> BodeCurve:
    label, frequency, response = reference
    order = np.argsort(frequency)
    everywhere, unknown = np.ones(len(order), dtype=bool), np.full((2, len(order)), np.nan)
    phase = continuous_phase(degrees(response[order]), everywhere)
    return BodeCurve(label, frequency[order], decibel(factor * response[order]), phase, everywhere, unknown, unknown)


def _bode_curve(label: str, source: FrequencyResponse, factor: float, anchor: BodeCurve | None) -> BodeCurve:
    source = source.ascending()
    frequency, settled = source.frequency, source.settled
    phase = continuous_phase(degrees(source.response), settled, _phase_at(anchor, frequency))
    band, turn = confidence_limits(source)
    magnitude = decibel(factor * source.response)
    return BodeCurve(
        label, frequency, magnitude, phase, settled, magnitude + decibel_limits(band), phase + degree_limits(turn)
    )  # fmt: skip


def _bode_model(of: Curve, factor: float, anchor: BodeCurve, source: FrequencyResponse) -> BodeModel:
    frequency = of.columns["frequency"]
    phase = of.columns.get("phase", np.full(len(frequency), np.nan))
    phase = continuous_phase(phase, np.ones(len(frequency), dtype=bool), _phase_at(anchor, frequency))
    rigid_body = of.columns.get("rigid body", np.full(len(frequency), np.nan))
    extremum = of.columns.get("extremum", np.zeros(len(frequency)))
    gain = float(rigid_body[0] * (2 * np.pi * frequency[0]) ** 2)
    spring = spring_line(source, gain)
    return BodeModel(
        frequency,
        decibel(factor * of.columns["magnitude"]),
        phase,
        extremum,
        decibel(factor * rigid_body),
        gain,
        spring,
        float(decibel(np.array([factor * spring.magnitude]))[0]) if spring else np.nan,
    )


def _bode_sample(
    responses: Sequence[FrequencyResponse], place: CurvePlace, factor: float, anchor: BodeCurve | None
) -> BodeSample:
    ordered = [of.ascending() for of in responses]
    frequency = stack_padded([of.frequency for of in ordered])
    response = stack_padded([of.response for of in ordered])
    settled = stack_padded([of.settled for of in ordered], missing=False)
    phase = continuous_phase(degrees(response), settled, _phase_at(anchor, frequency))
    return BodeSample(place.group, place.sample, frequency, decibel(factor * response), phase, settled)


def _phase_at(anchor: BodeCurve | None, frequency: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the phase [deg] of a curve at other frequencies; None without a curve, or if it has no settled point."""
    if anchor is None or not (usable := anchor.settled & np.isfinite(anchor.phase)).any():
        return None
    phase: NDArray[np.float64] = np.interp(np.log(frequency), np.log(anchor.frequency[usable]), anchor.phase[usable])
    return phase


UNSETTLED_STYLE: LineStyle = {
    "color": "0.3", "fillstyle": "none", "markersize": 2.5, "mew": 0.4, "zorder": 1.9, "rasterized": True,
}  # fmt: skip
"""Style of the points of a sample that had not settled."""
RIGID_BODY_STYLE: LineStyle = {"color": "0.5", "linestyle": (0, (1, 2)), "linewidth": 0.9, "zorder": 1.8}
"""Style of the line of the apparent mass."""
SPRING_STYLE: LineStyle = {**RIGID_BODY_STYLE, "linestyle": (0, (5, 2, 1, 2))}
"""Style of the line of a constant stiffness."""


def draw_bode(facets: Mapping[str, BodeInfo]) -> "Figure":
    """Draw a Bode plot for each facet, by its name; all share their axes, and the colours of their curves.

    Unsettled points are hollow and not joined, the reference is dashed and dark. Neighbours between which a mode could
    hide are not joined, and their band is a bar at each point. A response to which a plant was fitted is points, the
    plant a thin line. Samples are drawn as bundles.
    """
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
    labels = [[of.label for of in info.curves] + [of.label for of in info.samples] for info in infos]
    names = list(dict.fromkeys(label for of in labels for label in of))
    return dict(zip(names, canvas.line_styles(len(names)), strict=True))


def _draw_part(axes: "Axes", info: BodeInfo, part: str, styles: Mapping[str, LineStyle]) -> None:
    """Draw one part, ``magnitude`` or ``phase``, of all curves and samples."""
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
