"""Pictures of results: the panels and traces of a plot, with the numbers of the figures of the same kind."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import EXTREMUM_CURVES
from fraexp.errors import FraexpError
from fraexp.figures.elements.bands import Bundle
from fraexp.figures.elements.frequency_lines import GroupedLine
from fraexp.figures.elements.grouping import CurvePlace, ShownResult, point_indices
from fraexp.figures.elements.panel_figure import PanelFigure

REFERENCE = -1
"""Index of the reference, in place of the index of a sweep."""
Reference = tuple[str, NDArray[np.float64], NDArray[np.complex128]]
"""Label, frequency [Hz] and response of what all are compared with."""
CURVE_KINDS = {"positioning": "motions", "hysteresis": "hysteresis loops", "curves": "other curves"}
"""The kinds of figure that show curves, with the names of the curves."""


class PlotExtremum(NamedTuple):
    """A resonance or an antiresonance of a fitted plant."""

    x: float
    y: float
    text: str
    """Its frequency [Hz] with the 95 % interval."""
    is_peak: bool


@dataclass(frozen=True, eq=False)  # each is itself alone, and the key of what is drawn of it
class PlotTrace:
    """One line with what is shown of it at the cursor; all arrays are of shape (n,)."""

    curve: int
    """Place of its sweep among those compared."""
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    settled: NDArray[np.bool_]
    """Unsettled points are not joined."""
    at: NDArray[np.float64]
    """Positions of its points for the cursor, in the quantity of the picture, such as frequency [Hz]."""
    band: NDArray[np.float64] | None = None
    """Lower and upper 95 % limit of y, shape (2, n); None if unknown."""
    model: bool = False
    """Whether it is a fitted model instead of a measured result."""
    extrema: "tuple[PlotExtremum, ...]" = ()
    """Resonances and antiresonances of a fitted model."""


@dataclass(frozen=True)
class PlotPanel:
    """One pair of axes."""

    title: str
    unit: str
    """Unit of y in the readout."""
    abscissa: str
    """Unit of x."""
    traces: tuple[PlotTrace, ...]
    axis: int = 0
    """Panels with the same number share their x axis."""
    spectral: bool = False
    """Whether x is the log10 of a frequency."""
    decades: bool = False
    """Whether y is the log10 of its quantity."""
    angle: bool = False
    """Whether y is a phase [deg], which may be wrapped."""
    marks: tuple[float, ...] = ()
    """Values of y at which a horizontal line is drawn."""
    span: tuple[float, float] | None = None
    """Visible range of y; None for all."""
    resonant: bool = False
    """Whether y is a magnitude [dB] whose maxima are resonances."""


@dataclass(frozen=True)
class Picture:
    """All panels of one view."""

    kind: str
    """The kind of figure that shows the same."""
    title: str
    panels: tuple[PlotPanel, ...]
    cursor: str = "Hz"
    """Unit of the cursor's quantity."""
    upright: bool = True
    """Whether the cursor is a vertical line across the panels; else it is a point on each curve."""
    equal: bool = False
    """Whether both axes have the same scale."""
    note: str = ""
    """What was left out, and why."""


def bode_picture(
    shown: Sequence[ShownResult],
    reference: Reference | None,
    place_of: Callable[[ShownResult], CurvePlace] | None = None,
) -> Picture:
    """Return magnitude and phase of responses over frequency, with that of the plant where it is known.

    Results that `place_of` gives the same point are one curve, the first of them: their median, in a band of 5…95 %.
    """
    from fraexp.figures.kinds.bode import BodeCurve, bode_info  # which needs scipy

    of, found = _responses(shown)
    curves = [(one.label, one.response) for one in found if one.response is not None]
    places = [place_of(one) for one in found] if place_of else []
    info = bode_info(curves, reference, places=places, fitted=[one.fitted for one in found])
    points = list(point_indices(places).values()) if places else [[index] for index in range(len(found))]
    singles, samples = [of[at[0]] for at in points if len(at) == 1], [at for at in points if len(at) > 1]

    def traces(part: str) -> tuple[PlotTrace, ...]:
        drawn: list[tuple[int, BodeCurve]] = list(zip(singles, info.curves, strict=True))
        drawn += [(REFERENCE, info.reference)] if info.reference else []
        models = [(index, curve.model) for index, curve in drawn if curve.model is not None]
        lines = [
            replace(
                _line_trace(index, curve.frequency, getattr(curve, part), model=True),
                extrema=_extrema(shown[index], curve.frequency, curve.magnitude) if part == "magnitude" else (),
            )
            for index, curve in models
            if getattr(curve, part) is not None
        ]
        bundles = [
            (of[at[0]], sample.bundle(getattr(sample, part))) for at, sample in zip(samples, info.samples, strict=True)
        ]
        lines += [trace for index, bundle in bundles for trace in _bundle_traces(index, bundle)]
        return tuple(
            _line_trace(index, curve.frequency, getattr(curve, part), curve.settled, getattr(curve, f"{part}_band"))
            for index, curve in drawn
        ) + tuple(lines)

    return Picture("bode", info.title, (
        PlotPanel(f"Magnitude [dB re 1 {info.unit}]", "dB", "Hz", traces("magnitude"), spectral=True, resonant=True),
        PlotPanel("Phase [deg]", "deg", "Hz", traces("phase"), spectral=True, angle=True),
    ))  # fmt: skip


def _extrema(
    of: ShownResult, frequency: NDArray[np.float64], magnitude: NDArray[np.float64]
) -> tuple[PlotExtremum, ...]:
    """Return the extrema that a fit lists, on the line of its magnitude [dB]."""
    found = []
    for curve in of.result.curves:
        if curve.name in EXTREMUM_CURVES:
            half_widths = curve.columns.get("frequency, ± 95 %", np.full(len(curve.columns["frequency"]), np.nan))
            for at, half in zip(curve.columns["frequency"].tolist(), half_widths.tolist(), strict=True):
                text = f"{at:.4g}" + (f"±{half:.2g}" if np.isfinite(half) else "")
                level = float(np.interp(np.log(at), np.log(frequency), magnitude))
                found.append(PlotExtremum(float(np.log10(at)), level, text, EXTREMUM_CURVES[curve.name] > 0))
    return tuple(found)


def _bundle_traces(of: int, bundle: Bundle) -> list[PlotTrace]:
    """Return the median of a bundle with its band, or its lines if they are too few for quantiles."""
    levels = bundle.quantiles
    if levels is None:
        rows = zip(bundle.x, bundle.y, strict=True)
        return [_line_trace(of, x[np.isfinite(x)], y[np.isfinite(x)]) for x, y in rows]
    return [_line_trace(of, bundle.x[0], levels[1], band=levels[[0, 2]])]


def with_curves(picture: Picture, curve_of: Mapping[int, int]) -> Picture:
    """Return a picture whose traces belong to other curves: by the number of the present one."""
    panels = tuple(
        replace(panel, traces=tuple(replace(of, curve=curve_of.get(of.curve, of.curve)) for of in panel.traces))
        for panel in picture.panels
    )
    return replace(picture, panels=panels)


def difference_picture(shown: Sequence[ShownResult], first: int) -> Picture:
    """Return the differences of responses from the sweep at place `first`; with `REFERENCE`, from the plant."""
    from fraexp.figures.kinds.response_errors import difference_figure, difference_info, errors_figure, errors_info

    found = _numbered(shown)
    if first == REFERENCE:
        errors = errors_info(found)
        missing = [one.label for one in found if one.truth is None and one.response is not None]
        kind, figure, name = "errors", errors_figure(errors), "P(jω)"
    else:
        info = difference_info([found[first], *found[:first], *found[first + 1 :]])
        missing = list(info.left_out)
        kind, figure, name = "difference", difference_figure(info), info.reference
    note = f"left out, no common frequencies with {name}: {', '.join(missing)}" if missing else ""
    return _panel_picture(kind, figure, note)


def nyquist_picture(shown: Sequence[ShownResult], reference: Reference | None) -> Picture:
    """Return responses in the complex plane."""
    from fraexp.figures.kinds.nyquist import nyquist_info

    of, found = _responses(shown)
    info = nyquist_info(found, reference)
    drawn = list(zip(of, info.curves, strict=True)) + ([(REFERENCE, info.reference)] if info.reference else [])
    traces = tuple(
        PlotTrace(index, curve.x, curve.y, curve.usable & np.isfinite(curve.x), curve.frequency)
        for index, curve in drawn
    )
    title = f"Imaginary over real part [{info.unit}]"
    panel = PlotPanel(title, info.unit, info.unit, traces, marks=(0.0,))
    return Picture("nyquist", info.title, (panel,), upright=False, equal=True)


def coherence_picture(shown: Sequence[ShownResult]) -> Picture:
    """Return coherence and distortion of responses."""
    from fraexp.figures.kinds.response_quality import coherence_info

    found = _numbered(shown)
    info = coherence_info(found)
    telling = {place.point for place in info.places}
    missing = [one.label for index, one in enumerate(found) if one.response and str(index) not in telling]
    note = f"no coherence or distortion known: {', '.join(missing)}" if missing else ""
    return _panel_picture("coherence", info, note)


def curve_kinds(shown: ShownResult) -> list[str]:
    """Return the kinds of figure that show a result's curves; each curve is in one of them."""
    from fraexp.figures.kinds.curves import is_hysteresis, is_positioning

    found = {
        "positioning" if is_positioning(curve) else "hysteresis" if is_hysteresis(curve) else "curves"
        for curve in shown.result.curves
    }
    return [kind for kind in CURVE_KINDS if kind in found]


def curves_picture(shown: Sequence[ShownResult], kind: str) -> Picture:
    """Return the curves of a kind (see `curve_kinds`) of results."""
    from fraexp.figures.kinds.curves import (
        curves_info,
        hysteresis_info,
        is_hysteresis,
        is_positioning,
        positioning_info,
    )

    described = {"positioning": positioning_info, "hysteresis": hysteresis_info}.get(kind, curves_info)
    belongs = {"positioning": is_positioning, "hysteresis": is_hysteresis}.get(kind, lambda _: True)
    found = [
        (one.label, curve, _place(index))
        for index, one in enumerate(shown)
        for curve in one.result.curves
        if curve.name not in EXTREMUM_CURVES and belongs(curve)  # extrema are marks of a Bode plot
    ]
    if not found:
        raise FraexpError("curves: these sweeps have no curves")
    curves, places = [(label, curve) for label, curve, _ in found], [place for *_, place in found]
    return _panel_picture(kind, described(curves, places=places))


def _numbered(shown: Sequence[ShownResult]) -> list[ShownResult]:
    """Return results whose lines are known by their number, wherever a figure would place them."""
    return [replace(one, place=_place(index)) for index, one in enumerate(shown)]


def _place(index: int) -> CurvePlace:
    return CurvePlace(group=str(index), point=str(index))


def _panel_picture(kind: str, figure: PanelFigure, note: str = "") -> Picture:
    """Return what a figure shows of results that are known by their number."""
    panels = [
        PlotPanel(
            panel.ordinate if family.unit == "Hz" else f"{panel.ordinate} over {_begin_small(family.abscissa)}",
            panel.unit,
            family.unit,
            tuple(
                trace for line in panel.lines for trace in _traces(line, figure.is_loop, family.is_log, panel.is_log)
            ),
            axis,
            family.is_log,
            panel.is_log,
            marks=panel.marks,
            span=panel.span,
        )
        for axis, family in enumerate(figure.families)
        for panel in family.panels
    ]
    along = "% of the loop" if figure.is_loop else panels[0].abscissa
    cursor = along if figure.is_loop or len({panel.abscissa for panel in panels}) == 1 else "of x"
    return Picture(kind, figure.title, tuple(panels), cursor, upright=not figure.is_loop, note=note)


def _begin_small(text: str) -> str:
    return text[:1].lower() + text[1:]


def _traces(line: GroupedLine, is_loop: bool, spectral: bool, decades: bool) -> list[PlotTrace]:
    """Return a line, and its model if it has one; the cursor moves along a loop."""
    scale: Callable[[NDArray[np.float64]], NDArray[np.float64]] = _logarithm if decades else np.asarray
    of, band = int(line.place.point.partition(",")[0]), None if line.band is None else scale(line.band)
    trace = _line_trace(of, line.x, scale(line.y), line.usable, band, spectral=spectral)
    if is_loop:
        return [replace(trace, settled=trace.settled & np.isfinite(line.x), at=np.linspace(0.0, 100.0, len(line.x)))]
    models = [] if line.model is None else [scale(line.model)]
    return [trace, *(_line_trace(of, line.x, model, model=True, spectral=spectral) for model in models)]


def _responses(shown: Sequence[ShownResult]) -> tuple[list[int], list[ShownResult]]:
    """Return the places of the results that have a response, and these results."""
    having = [(index, one) for index, one in enumerate(shown) if one.response is not None]
    return [index for index, _ in having], [one for _, one in having]


def _line_trace(
    of: int,
    at: NDArray[np.float64],
    y: NDArray[np.float64],
    settled: NDArray[np.bool_] | None = None,
    band: NDArray[np.float64] | None = None,
    *,
    model: bool = False,
    spectral: bool = True,
) -> PlotTrace:
    """Return a line over the cursor's quantity."""
    known = np.isfinite(y)
    trusted = known if settled is None else settled & known
    limits = None if band is None or np.isnan(band).all() else band
    return PlotTrace(of, _logarithm(at) if spectral else at, y, trusted, at, limits, model)


def _logarithm(values: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm: NDArray[np.float64] = np.log10(values)
    return np.where(np.isfinite(logarithm), logarithm, np.nan)
