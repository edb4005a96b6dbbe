"""The Bode plot: magnitude and phase of frequency responses over frequency, with 95 % bands."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import Curve, FrequencyResponse
from fraexp.errors import FraexpError
from fraexp.figures.elements.branches import continuous_phases
from fraexp.figures.elements.bundles import MAX_SINGLE_CURVES, Bundle, draw_bundles, group_indices, stack_padded
from fraexp.figures.elements.frequency_lines import (
    add_fitted_legend,
    add_model_legend,
    draw_bands,
    draw_line,
    draw_points_and_model,
    with_gaps,
)
from fraexp.figures.elements.line_style import LineStyle
from fraexp.figures.elements.scales import continuous_phase, decibel, decibel_limits, degrees, readable_unit
from fraexp.figures.elements.view import wrap_phase

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Reference = tuple[str, NDArray[np.float64], NDArray[np.complex128]]
"""Label, frequency [Hz] and complex response, both of shape (n,), in the unit of the curves."""


@dataclass(frozen=True)
class BodeCurve:
    """A response as it is drawn in a Bode plot, in ascending frequency."""

    label: str
    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    magnitude: NDArray[np.float64]
    """Magnitude [dB], shape (n,)."""
    phase: NDArray[np.float64]
    """Continuous phase [deg], shape (n,)."""
    settled: NDArray[np.bool_]
    """Whether the point had settled, shape (n,); lines join settled points only."""
    magnitude_band: NDArray[np.float64]
    """Lower and upper 95 % limit of the magnitude [dB], shape (2, n); NaN where unknown; may be infinite."""
    phase_band: NDArray[np.float64]
    """Lower and upper 95 % limit of the phase [deg], shape (2, n); NaN where unknown."""
    model: "BodeModel | None" = None
    """The plant that was fitted to it; None without a fit."""

    def with_gaps(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of shape (..., n) with NaN, a gap in the line, where the response was not settled."""
        return with_gaps(values, self.settled)


@dataclass(frozen=True)
class BodeModel:
    """A fitted plant as it is drawn in a Bode plot, over the frequency range of the fit."""

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    magnitude: NDArray[np.float64]
    """Magnitude [dB], shape (n,)."""
    phase: NDArray[np.float64]
    """Phase [deg] on the branch of the response, shape (n,); NaN if only the magnitude was fitted."""

    @property
    def has_phase(self) -> bool:
        """Whether the phase was fitted too."""
        return not np.isnan(self.phase).all()


@dataclass(frozen=True)
class BodeGroup:
    """Many responses as they are drawn in a Bode plot, each a row in ascending frequency, all of shape (m, n).

    The rows of responses with fewer points than others end in NaN.
    """

    label: str
    """Name of the group; empty if there is one group."""
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
        return Bundle(self.label, self.frequency, np.where(self.settled, values, np.nan))


@dataclass(frozen=True)
class BodeInfo:
    """Contents of a Bode plot: curves, or groups of curves if there are many."""

    curves: tuple[BodeCurve, ...]
    groups: tuple[BodeGroup, ...]
    reference: BodeCurve | None
    unit: str
    """Unit that is 0 dB, such as ``mm/N``."""
    title: str


def bode_info(
    curves: Sequence[tuple[str, FrequencyResponse]],
    reference: Reference | None = None,
    title: str = "",
    groups: Sequence[str] = (),
    fitted: Sequence[Curve | None] = (),
    wrapped: bool = False,
) -> BodeInfo:
    """Return the numbers of a Bode plot of labelled responses; FraexpError if their units differ.

    The phases lie on the branch nearest to the reference, or without one to the first curve. More than
    `MAX_SINGLE_CURVES` responses are distinguished only by the names of their `groups`; without names they are one
    group. `fitted` are the plants that were fitted to the responses (see `ShownResult.fitted`), which are drawn with
    few responses. `wrapped` phases lie within ±180°.
    """
    unit = _common_unit(curves)
    factor, shown = readable_unit(unit)
    drawn_reference = _reference_curve(reference, factor) if reference else None
    heading = title or _default_title(curves)
    if len(curves) > MAX_SINGLE_CURVES:
        many = _bode_groups(curves, groups, factor, drawn_reference)
        return _wrap_phase(BodeInfo((), many, drawn_reference, shown, heading), wrapped)
    anchor, drawn = drawn_reference, []
    for (label, response), model in zip(curves, fitted or [None] * len(curves), strict=True):
        curve = _bode_curve(label, response, factor, anchor)
        drawn.append(replace(curve, model=_bode_model(model, factor, curve)) if model else curve)
        anchor = anchor or drawn[0]
    return _wrap_phase(BodeInfo(tuple(drawn), (), drawn_reference, shown, heading), wrapped)


def _wrap_phase(info: BodeInfo, wanted: bool) -> BodeInfo:
    if not wanted:
        return info
    groups = tuple(replace(of, phase=wrap_phase(of.phase)) for of in info.groups)
    reference = _wrapped_curve(info.reference) if info.reference else None
    return replace(info, curves=tuple(map(_wrapped_curve, info.curves)), groups=groups, reference=reference)


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
    order = np.argsort(source.frequency, kind="stable")
    frequency, response, settled = source.frequency[order], source.response[order], source.settled[order]
    target = _phase_at(anchor, frequency) if anchor else None
    phase = continuous_phase(degrees(response), settled, target)
    band, turn = (each[:, order] for each in confidence_limits(source))
    spread = np.clip(np.degrees(turn), -180, 180)
    magnitude = decibel(factor * response)
    return BodeCurve(
        label, frequency, magnitude, phase, settled, magnitude + decibel_limits(band), phase + spread
    )  # fmt: skip


def _bode_model(of: Curve, factor: float, anchor: BodeCurve) -> BodeModel:
    frequency = of.columns["frequency"]
    phase = of.columns.get("phase", np.full(len(frequency), np.nan))
    phase = continuous_phase(phase, np.ones(len(frequency), dtype=bool), _phase_at(anchor, frequency))
    return BodeModel(frequency, decibel(factor * of.columns["magnitude"]), phase)


def _bode_groups(
    curves: Sequence[tuple[str, FrequencyResponse]],
    groups: Sequence[str],
    factor: float,
    reference: BodeCurve | None,
) -> tuple[BodeGroup, ...]:
    responses = [response for _, response in curves if len(response.frequency)]
    names = [name for name, (_, of) in zip(groups or [""] * len(curves), curves, strict=True) if len(of.frequency)]
    first = next((response for response in responses if response.settled.any()), None)
    anchor = reference or (_bode_curve("", first, factor, None) if first else None)
    return tuple(
        _bode_group(name, [responses[index] for index in indices], factor, anchor)
        for name, indices in group_indices(names).items()
    )


def _bode_group(
    label: str, responses: Sequence[FrequencyResponse], factor: float, anchor: BodeCurve | None
) -> BodeGroup:
    orders = [np.argsort(of.frequency, kind="stable") for of in responses]
    pairs = list(zip(responses, orders, strict=True))
    frequency = stack_padded([of.frequency[order] for of, order in pairs])
    response = stack_padded([of.response[order] for of, order in pairs])
    settled = stack_padded([of.settled[order] for of, order in pairs], missing=False)
    target = _phase_at(anchor, frequency) if anchor else None
    phase = continuous_phases(degrees(response), settled, target)
    return BodeGroup(label, frequency, decibel(factor * response), phase, settled)


def _phase_at(anchor: BodeCurve, frequency: NDArray[np.float64]) -> NDArray[np.float64] | None:
    usable = anchor.settled & np.isfinite(anchor.phase)
    if not usable.any():
        return None
    phase: NDArray[np.float64] = np.interp(np.log(frequency), np.log(anchor.frequency[usable]), anchor.phase[usable])
    return phase


def draw_bode(info: BodeInfo) -> "Figure":
    """Draw a Bode plot; unsettled points are hollow and not joined, the reference is dashed and dark.

    A response to which a plant was fitted is points, the plant a thin line. Groups of curves are drawn as bundles.
    """
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    with canvas.figure_style():
        figure = canvas.new_figure(width=9.0, height=6.2)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1))
        if info.groups:
            _draw_groups(upper, lower, info.groups)
        _draw_curves(upper, info, "magnitude")
        _draw_curves(lower, info, "phase")
        upper.set_title(canvas.wrapped_title(figure, info.title))
        upper.set_ylabel(f"Magnitude [dB re 1 {info.unit}]")
        lower.set_ylabel("Phase [deg]")
        lower.set_xlabel("Frequency [Hz]")
        canvas.set_frequency_axis(lower, _frequency_span(info))
        canvas.set_phase_ticks(lower)
        canvas.draw_grid(upper, lower)
        figure.align_ylabels((upper, lower))
        canvas.add_legend_below(figure, upper)
    return figure


def _draw_curves(axes: "Axes", info: BodeInfo, part: str) -> None:
    """Draw one part of all curves, ``magnitude`` or ``phase``, with their bands."""
    from fraexp.figures.elements import canvas

    bands = []
    for curve, style in zip(info.curves, canvas.line_styles(len(info.curves)), strict=True):
        values, model = getattr(curve, part), curve.model
        if model is None:
            draw_line(axes, curve.frequency, values, curve.settled, curve.label, style)
        else:
            draw_points_and_model(
                axes, (curve.frequency, values), curve.settled, (model.frequency, getattr(model, part)), style
            )
            add_fitted_legend(axes, curve.label if model.has_phase else f"{curve.label} (fit of the magnitude)", style)
        bands.append((curve.frequency, curve.with_gaps(getattr(curve, f"{part}_band")), str(style["color"])))
    if any(curve.model for curve in info.curves):
        add_model_legend(axes, "fitted plant")
    if info.reference is not None:
        of = info.reference
        draw_line(axes, of.frequency, getattr(of, part), of.settled, of.label, canvas.REFERENCE_STYLE)
    draw_bands(axes, bands)


def _draw_groups(upper: "Axes", lower: "Axes", groups: Sequence[BodeGroup]) -> None:
    draw_bundles(upper, [group.bundle(group.magnitude) for group in groups], has_legend=True)
    draw_bundles(lower, [group.bundle(group.phase) for group in groups], has_legend=False)
    frequency = np.concatenate([group.frequency[~group.settled] for group in groups])
    if np.isfinite(frequency).any():
        style: LineStyle = {
            "color": "0.3",
            "fillstyle": "none",
            "markersize": 2.5,
            "mew": 0.4,
            "zorder": 1.9,
            "rasterized": True,
        }
        for axes, values in ((upper, "magnitude"), (lower, "phase")):
            points = np.concatenate([getattr(group, values)[~group.settled] for group in groups])
            axes.plot(frequency, points, "o", alpha=0.3, **style)
        upper.plot([], [], "o", label="not settled", **style)


def _frequency_span(info: BodeInfo) -> tuple[float, float]:
    curves, groups = (of.frequency for of in info.curves), (of.frequency.ravel() for of in info.groups)
    everything = np.concatenate([*curves, *groups])
    return float(np.nanmin(everything)), float(np.nanmax(everything))
