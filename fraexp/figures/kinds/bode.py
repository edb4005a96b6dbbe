"""The Bode plot: magnitude and phase of frequency responses over frequency, with 95 % bands."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fraexp.analysis.confidence import limits
from fraexp.data.results import Curve, FrequencyResponse
from fraexp.errors import FraexpError
from fraexp.figures.elements.branches import continuous_phases
from fraexp.figures.elements.bundles import MANY, Bundle, draw_bundles, split, stacked
from fraexp.figures.elements.frequency_lines import draw_bands, draw_fitted, draw_line, joined, name_fitted, name_model
from fraexp.figures.elements.scales import continuous_phase, decibel, decibel_limits, degrees, readable_unit
from fraexp.figures.elements.view import wrap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Reference = tuple[str, np.ndarray, np.ndarray]
"""Label, frequency [Hz] and complex response, both of shape (n,), in the unit of the curves."""


@dataclass(frozen=True)
class BodeCurve:
    """One response in the numbers of its Bode plot, in ascending frequency."""

    label: str
    frequency: np.ndarray
    """Frequency [Hz], shape (n,)."""
    magnitude: np.ndarray
    """Magnitude [dB], shape (n,)."""
    phase: np.ndarray
    """Continuous phase [deg], shape (n,)."""
    settled: np.ndarray
    """Whether the point had become periodic, shape (n,) of bool; only such points are joined."""
    magnitude_band: np.ndarray
    """Lower and upper 95 % limit of the magnitude [dB], shape (2, n); NaN where unknown, or infinite."""
    phase_band: np.ndarray
    """Lower and upper 95 % limit of the phase [deg], shape (2, n); NaN where unknown."""
    model: "BodeModel | None" = None
    """The plant that was fitted to it; None if none was."""

    def joined(self, values: np.ndarray) -> np.ndarray:
        """Return values of shape (..., n) with NaN, a gap in the line, where the response was not settled."""
        return joined(values, self.settled)


@dataclass(frozen=True)
class BodeModel:
    """A fitted plant in the numbers of its Bode plot, over the band in which it was fitted."""

    frequency: np.ndarray
    """Frequency [Hz], shape (n,)."""
    magnitude: np.ndarray
    """Magnitude [dB], shape (n,)."""
    phase: np.ndarray
    """Phase [deg] on the branch of the response, shape (n,); NaN if the magnitude alone was fitted."""

    @property
    def has_phase(self) -> bool:
        """Whether the phase was fitted too."""
        return not np.isnan(self.phase).all()


@dataclass(frozen=True)
class BodeGroup:
    """Many responses in the numbers of their Bode plot, a row each in ascending frequency, all of shape (m, n).

    The rows of responses with fewer points than others end in NaN.
    """

    label: str
    """What they have in common; empty if there is one group."""
    frequency: np.ndarray
    """Frequency [Hz]."""
    magnitude: np.ndarray
    """Magnitude [dB]."""
    phase: np.ndarray
    """Continuous phase [deg]."""
    settled: np.ndarray
    """Whether the point had become periodic, of bool; only such points are joined."""

    def bundle(self, values: np.ndarray) -> Bundle:
        """Return values of shape (m, n) as a bundle with gaps where the responses were not settled."""
        return Bundle(self.label, self.frequency, np.where(self.settled, values, np.nan))


@dataclass(frozen=True)
class BodeInfo:
    """What a Bode plot shows: curves, or groups of curves if they are many."""

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

    The phases lie on the branch nearest to the reference, or to the first curve if there is none. More than `MANY`
    responses are told apart by the names of their `groups` alone; without names they are one group. `fitted` are the
    plants that were fitted to the responses (see `Shown.fitted`), which are drawn where the responses are few.
    `wrapped` phases lie within ±180°.
    """
    unit = _common_unit(curves)
    factor, shown = readable_unit(unit)
    drawn_reference = _reference_curve(reference, factor) if reference else None
    heading = title or _title(curves)
    if len(curves) > MANY:
        many = _groups(curves, groups, factor, drawn_reference)
        return _wrapped(BodeInfo((), many, drawn_reference, shown, heading), wrapped)
    anchor, drawn = drawn_reference, []
    for (label, response), model in zip(curves, fitted or [None] * len(curves), strict=True):
        curve = _curve(label, response, factor, anchor)
        drawn.append(replace(curve, model=_model(model, factor, curve)) if model else curve)
        anchor = anchor or drawn[0]
    return _wrapped(BodeInfo(tuple(drawn), (), drawn_reference, shown, heading), wrapped)


def _wrapped(info: BodeInfo, wanted: bool) -> BodeInfo:
    if not wanted:
        return info
    groups = tuple(replace(of, phase=wrap(of.phase)) for of in info.groups)
    reference = _wrapped_curve(info.reference) if info.reference else None
    return replace(info, curves=tuple(map(_wrapped_curve, info.curves)), groups=groups, reference=reference)


def _wrapped_curve(of: BodeCurve) -> BodeCurve:
    phase = wrap(of.phase)
    model = replace(of.model, phase=wrap(of.model.phase)) if of.model else None
    return replace(of, phase=phase, phase_band=of.phase_band + (phase - of.phase), model=model)


def _common_unit(curves: Sequence[tuple[str, FrequencyResponse]]) -> str:
    units = sorted({response.unit for _, response in curves})
    if len(units) != 1:
        found = " and ".join(units) or "nothing"
        raise FraexpError(f"Bode plot: found responses in {found}; curves of one plot share a unit")
    return units[0]


def _title(curves: Sequence[tuple[str, FrequencyResponse]]) -> str:
    paths = list(dict.fromkeys(f"{response.output}/{response.input}" for _, response in curves))
    return f"Frequency response {' and '.join(paths)}"


def _reference_curve(reference: Reference, factor: float) -> BodeCurve:
    label, frequency, response = reference
    order = np.argsort(frequency)
    everywhere, unknown = np.ones(len(order), dtype=bool), np.full((2, len(order)), np.nan)
    phase = continuous_phase(degrees(response[order]), everywhere)
    return BodeCurve(label, frequency[order], decibel(factor * response[order]), phase, everywhere, unknown, unknown)


def _curve(label: str, source: FrequencyResponse, factor: float, anchor: BodeCurve | None) -> BodeCurve:
    order = np.argsort(source.frequency, kind="stable")
    frequency, response, settled = source.frequency[order], source.response[order], source.settled[order]
    target = _at(anchor, frequency) if anchor else None
    phase = continuous_phase(degrees(response), settled, target)
    band, turn = (each[:, order] for each in limits(source))
    spread = np.clip(np.degrees(turn), -180, 180)
    magnitude = decibel(factor * response)
    return BodeCurve(
        label, frequency, magnitude, phase, settled, magnitude + decibel_limits(band), phase + spread
    )  # fmt: skip


def _model(of: Curve, factor: float, anchor: BodeCurve) -> BodeModel:
    frequency = of.columns["frequency"]
    phase = of.columns.get("phase", np.full(len(frequency), np.nan))
    phase = continuous_phase(phase, np.ones(len(frequency), dtype=bool), _at(anchor, frequency))
    return BodeModel(frequency, decibel(factor * of.columns["magnitude"]), phase)


def _groups(
    curves: Sequence[tuple[str, FrequencyResponse]],
    groups: Sequence[str],
    factor: float,
    reference: BodeCurve | None,
) -> tuple[BodeGroup, ...]:
    responses = [response for _, response in curves if len(response.frequency)]
    names = [name for name, (_, of) in zip(groups or [""] * len(curves), curves, strict=True) if len(of.frequency)]
    first = next((response for response in responses if response.settled.any()), None)
    anchor = reference or (_curve("", first, factor, None) if first else None)
    return tuple(
        _group(name, [responses[index] for index in indices], factor, anchor) for name, indices in split(names).items()
    )


def _group(label: str, responses: Sequence[FrequencyResponse], factor: float, anchor: BodeCurve | None) -> BodeGroup:
    orders = [np.argsort(of.frequency, kind="stable") for of in responses]
    pairs = list(zip(responses, orders, strict=True))
    frequency = stacked([of.frequency[order] for of, order in pairs])
    response = stacked([of.response[order] for of, order in pairs])
    settled = stacked([of.settled[order] for of, order in pairs], missing=False)
    target = _at(anchor, frequency) if anchor else None
    phase = continuous_phases(degrees(response), settled, target)
    return BodeGroup(label, frequency, decibel(factor * response), phase, settled)


def _at(anchor: BodeCurve, frequency: np.ndarray) -> np.ndarray | None:
    usable = anchor.settled & np.isfinite(anchor.phase)
    if not usable.any():
        return None
    phase: np.ndarray = np.interp(np.log(frequency), np.log(anchor.frequency[usable]), anchor.phase[usable])
    return phase


def draw_bode(info: BodeInfo) -> "Figure":
    """Draw a Bode plot; unsettled points are hollow and not joined, the reference is dashed and dark.

    A response to which a plant was fitted is points, the plant a thin line. Groups of curves are drawn as bundles.
    """
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    with canvas.styled():
        figure = canvas.new_figure(width=9.0, height=6.2)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1))
        if info.groups:
            _draw_groups(upper, lower, info.groups)
        _draw_curves(upper, info, "magnitude")
        _draw_curves(lower, info, "phase")
        upper.set_title(canvas.heading(figure, info.title))
        upper.set_ylabel(f"Magnitude [dB re 1 {info.unit}]")
        lower.set_ylabel("Phase [deg]")
        lower.set_xlabel("Frequency [Hz]")
        canvas.frequency_axis(lower, _span(info))
        canvas.phase_axis(lower)
        canvas.grid(upper, lower)
        figure.align_ylabels((upper, lower))
        canvas.legend_below(figure, upper)
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
            draw_fitted(axes, (curve.frequency, values), curve.settled, (model.frequency, getattr(model, part)), style)
            name_fitted(axes, curve.label if model.has_phase else f"{curve.label} (fit of the magnitude)", style)
        bands.append((curve.frequency, curve.joined(getattr(curve, f"{part}_band")), str(style["color"])))
    if any(curve.model for curve in info.curves):
        name_model(axes, "fitted plant")
    if info.reference is not None:
        of = info.reference
        draw_line(axes, of.frequency, getattr(of, part), of.settled, of.label, canvas.REFERENCE)
    draw_bands(axes, bands)


def _draw_groups(upper: "Axes", lower: "Axes", groups: Sequence[BodeGroup]) -> None:
    draw_bundles(upper, [group.bundle(group.magnitude) for group in groups], named=True)
    draw_bundles(lower, [group.bundle(group.phase) for group in groups], named=False)
    frequency = np.concatenate([group.frequency[~group.settled] for group in groups])
    if np.isfinite(frequency).any():
        style: dict[str, Any] = {
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


def _span(info: BodeInfo) -> tuple[float, float]:
    curves, groups = (of.frequency for of in info.curves), (of.frequency.ravel() for of in info.groups)
    everything = np.concatenate([*curves, *groups])
    return float(np.nanmin(everything)), float(np.nanmax(everything))
