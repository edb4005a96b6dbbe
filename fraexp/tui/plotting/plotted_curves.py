"""Pictures of results: the panels and traces of a plot, with the numbers of the figures of the same kind."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import EXTREMUM_CURVES, Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements.bands import Bundle
from fraexp.figures.elements.grouping import CurvePlace, ShownResult, point_indices

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
    from fraexp.figures.kinds.difference import difference_info
    from fraexp.figures.kinds.plant_errors import errors_info

    of, found = _responses(shown)
    places = {one.key: index for index, one in zip(of, found, strict=True)}
    if first == REFERENCE:
        errors = errors_info(found)
        missing = [one.label for one in found if one.truth is None]
        kind, title, curves, name = "errors", errors.title, errors.curves, "P(jω)"
    else:
        order = sorted(found, key=lambda one: places[one.key] != first)
        info = difference_info(order)
        missing = list(info.left_out)
        kind, title, curves, name = "difference", info.title, info.curves, info.reference

    def traces(part: str) -> tuple[PlotTrace, ...]:
        return tuple(
            _line_trace(places[curve.key], curve.frequency, getattr(curve, part), curve.settled,
                  getattr(curve, f"{part}_band"))
            for curve in curves
        )  # fmt: skip

    note = f"left out, no common frequencies with {name}: {', '.join(missing)}" if missing else ""
    return Picture(kind, title, (
        PlotPanel("Magnitude [dB]", "dB", "Hz", traces("magnitude"), spectral=True, marks=(0.0,)),
        PlotPanel("Phase [deg]", "deg", "Hz", traces("phase"), spectral=True, marks=(0.0,)),
    ), note=note)  # fmt: skip


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
    from fraexp.figures.kinds.coherence import AXIS_TITLES, coherence_info

    of, found = _responses(shown)
    places = {one.key: index for index, one in zip(of, found, strict=True)}
    info = coherence_info(found)
    panels = []
    for part, lines in info.rows.items():
        decades = part == "distortion" and info.is_logarithmic
        traces = tuple(
            _line_trace(places[line.key], line.x, _logarithm(line.y) if decades else line.y, line.settled)
            for line in lines
        )
        span = (0.0, 1.05) if part == "coherence" else None
        unit = "%" if part == "distortion" else ""
        panels.append(PlotPanel(AXIS_TITLES[part], unit, "Hz", traces, spectral=True, decades=decades, span=span))
    telling = {line.key for lines in info.rows.values() for line in lines}
    missing = [one.label for one in found if one.key not in telling]
    note = f"no coherence or distortion known: {', '.join(missing)}" if missing else ""
    return Picture("coherence", info.title, tuple(panels), note=note)


def curve_kinds(shown: ShownResult) -> list[str]:
    """Return the kinds of figure that show a result's curves; each curve is in one of them."""
    from fraexp.figures.kinds.hysteresis_loops import is_hysteresis
    from fraexp.figures.kinds.positioning_moves import is_positioning

    found = {
        "positioning" if is_positioning(curve) else "hysteresis" if is_hysteresis(curve) else "curves"
        for curve in shown.result.curves
    }
    return [kind for kind in CURVE_KINDS if kind in found]


def curves_picture(shown: Sequence[ShownResult], kind: str) -> Picture:
    """Return the curves of a kind (see `curve_kinds`) of results."""
    curves = [(str(index), curve) for index, one in enumerate(shown) for curve in one.result.curves]
    found = [(label, curve) for label, curve in curves if curve.name not in EXTREMUM_CURVES]  # marks, of a Bode plot
    if not found:
        raise FraexpError("curves: these sweeps have no curves")
    match kind:
        case "positioning":
            return _positioning_picture(found)
        case "hysteresis":
            return _hysteresis_picture(found)
    return _other_picture(found)


def _hysteresis_picture(found: Sequence[tuple[str, Curve]]) -> Picture:
    from fraexp.figures.kinds.hysteresis_loops import hysteresis_info, is_hysteresis

    info = hysteresis_info([(label, curve) for label, curve in found if is_hysteresis(curve)])
    panels = tuple(
        PlotPanel(f"{panel.title} {info.force_title} over displacement [{panel.unit}]".strip(), info.force_unit,
            panel.unit, tuple(
            _loop_trace(int(loop.name), loop.x, loop.y, loop.band) for loop in panel.loops
        ), axis, marks=(0.0,))
        for axis, panel in enumerate(info.panels)
    )  # fmt: skip
    return Picture("hysteresis", info.title, panels, "% of the loop", upright=False)


def _positioning_picture(found: Sequence[tuple[str, Curve]]) -> Picture:
    from fraexp.figures.kinds.positioning_moves import positioning_info

    info = positioning_info(found, places=[CurvePlace(point=label) for label, _ in found])
    marks = tuple(sign * band for band in info.bands for sign in (-1, 1))
    span = (-info.height, info.height)
    panels = [PlotPanel(f"Position less target [{info.unit}]", info.unit, "ms", tuple(
        _line_trace(int(line.place.point), line.x, line.y, spectral=False) for line in info.deviations
    ), marks=marks, span=span)]  # fmt: skip
    if info.thrust_unit:
        panels.append(PlotPanel(f"Thrust [{info.thrust_unit}]", info.thrust_unit, "ms", tuple(
            _line_trace(int(line.place.point), line.x, line.y, spectral=False) for line in info.thrusts
        )))  # fmt: skip
    return Picture("positioning", info.title, tuple(panels), "ms")


def _other_picture(found: Sequence[tuple[str, Curve]]) -> Picture:
    from fraexp.figures.kinds.other_curves import curves_info

    info = curves_info(found)
    panels = []
    for axis, family in enumerate(info.families):
        spectral = family.log_range is not None
        unit = family.abscissa.rpartition("[")[2].rstrip("]")
        for panel in family.panels:
            scale: Callable[[NDArray[np.float64]], NDArray[np.float64]] = _logarithm if panel.log_unit else np.asarray
            lines = []
            for trace in panel.traces:
                of = int(trace.place.group.partition(",")[0])
                band = None if trace.band is None else scale(trace.band)
                lines.append(_line_trace(of, trace.x, scale(trace.y), band=band, spectral=spectral))
                if trace.model is not None:
                    lines.append(_line_trace(of, trace.x, scale(trace.model), model=True, spectral=spectral))
            title = f"{panel.ordinate} over {family.abscissa}"
            panels.append(PlotPanel(title, panel.unit, unit, tuple(lines), axis, spectral, bool(panel.log_unit)))
    cursor = panels[0].abscissa if len({panel.abscissa for panel in panels}) == 1 else "of x"
    return Picture("curves", info.title, tuple(panels), cursor)


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


def _loop_trace(of: int, x: NDArray[np.float64], y: NDArray[np.float64], band: NDArray[np.float64] | None) -> PlotTrace:
    """Return a loop, along which the cursor moves."""
    at = np.linspace(0.0, 100.0, len(x))
    return PlotTrace(of, x, y, np.isfinite(x) & np.isfinite(y), at, band)


def _logarithm(values: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm: NDArray[np.float64] = np.log10(values)
    return np.where(np.isfinite(logarithm), logarithm, np.nan)
