"""Choice of the figure for results, and files of figures."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO

from matplotlib.figure import Figure

from fraexp.data.atomic_file import atomic_file
from fraexp.data.results import EXTREMUM_CURVES, Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements.canvas import figure_style
from fraexp.figures.elements.facets import panel_places
from fraexp.figures.elements.grouping import CurvePlace, ShownResult, curve_places, facet_indices
from fraexp.figures.elements.stamp import check_suffix, stamp_digest
from fraexp.figures.elements.view import FULL_VIEW, View, break_wrapped_lines, zoom_to_band
from fraexp.figures.kinds.amplitude_map import amplitude_map_info, draw_amplitude_map, response_map_info
from fraexp.figures.kinds.bode import Reference, bode_info, draw_bode_facets
from fraexp.figures.kinds.coherence import coherence_info, draw_coherence
from fraexp.figures.kinds.difference import difference_info, draw_difference
from fraexp.figures.kinds.distribution import distribution_info, draw_distribution
from fraexp.figures.kinds.hysteresis_loops import draw_hysteresis, hysteresis_info, is_hysteresis
from fraexp.figures.kinds.levels import draw_levels, levels_info
from fraexp.figures.kinds.nyquist import draw_nyquist, nyquist_info
from fraexp.figures.kinds.other_curves import curves_info, draw_curves
from fraexp.figures.kinds.plant_errors import draw_errors, errors_info
from fraexp.figures.kinds.positioning_moves import draw_positioning, is_positioning, positioning_info

FACET_KINDS = ("hysteresis", "positioning", "curves", "difference", "coherence", "nyquist")
"""Kinds of figures that have facets but no map."""


def draw_figure(
    shown: Sequence[ShownResult],
    reference: Reference | None = None,
    title: str = "",
    kind: str = "",
    view: View = FULL_VIEW,
) -> Figure:
    """Return a figure of results: of a kind in `FIGURES`, or of the default one.

    The default is a Bode plot if any result has a response, otherwise hysteresis loops if each result has one,
    otherwise positioning moves, otherwise curves. FraexpError if the kind does not support the `view`.
    """
    chosen = kind or _default_kind(shown)
    view.check(chosen, [of.response.frequency for of in shown if of.response is not None])
    if chosen in FACET_KINDS:
        places = panel_places(curve_places(shown), chosen)
        shown = [replace(of, place=place) for of, place in zip(shown, places, strict=True)]
    figure = DRAWING_FUNCTIONS[chosen](shown, reference, title, view.wrapped)
    if view.wrapped:
        break_wrapped_lines(figure)
    if view.band:
        zoom_to_band(figure, view.band)
    return figure


def _draw_bode(shown: Sequence[ShownResult], reference: Reference | None, title: str, wrapped: bool) -> Figure:
    """Draw responses as a Bode plot, or as a map if there are too many groups for lines."""
    shown = [of for of in shown if of.response is not None]
    if any(of.place and of.place.is_mapped for of in shown):
        return draw_amplitude_map(response_map_info(shown, title))
    places, infos = curve_places(shown), {}
    for name, indices in (facet_indices(places) or {"": []}).items():
        members = [shown[index] for index in indices]
        curves = [(of.name, of.response) for of in members if of.response is not None]
        of_facet = [places[index] for index in indices]
        infos[name] = bode_info(curves, reference, title, of_facet, [of.fitted for of in members], wrapped)
    return draw_bode_facets(infos)


def _default_kind(shown: Sequence[ShownResult]) -> str:
    if any(of.response is not None for of in shown):
        return "bode"
    found = _labelled_curves(shown)
    if not found:
        raise FraexpError("figure: no result has a frequency response or a curve to draw")
    with_curves = [of.result.curves for of in shown if of.result.curves]
    if all(any(is_hysteresis(curve) for curve in curves) for curves in with_curves):
        return "hysteresis"
    return "positioning" if any(is_positioning(curve) for _, curve, _ in found) else "curves"


def _labelled_curves(shown: Sequence[ShownResult]) -> list[tuple[str, Curve, CurvePlace]]:
    pairs = zip(shown, curve_places(shown), strict=True)
    return [
        (of.name, curve, place)
        for of, place in pairs
        for curve in of.result.curves
        if curve.name not in EXTREMUM_CURVES
    ]


def _draw_loops(found: Sequence[tuple[str, Curve, CurvePlace]], title: str) -> Figure:
    loops = [of for of in found if is_hysteresis(of[1])]
    info = hysteresis_info([(label, curve) for label, curve, _ in loops], title, [place for *_, place in loops])
    return draw_hysteresis(info)


def _draw_others(found: Sequence[tuple[str, Curve, CurvePlace]], title: str) -> Figure:
    info = curves_info([(label, curve) for label, curve, _ in found], title, [place for *_, place in found])
    return draw_curves(info)


DRAWING_FUNCTIONS: dict[str, Callable[[Sequence[ShownResult], Reference | None, str, bool], Figure]] = {
    "bode": _draw_bode,
    "errors": lambda shown, _, title, __: draw_errors(errors_info(shown, title)),
    "amplitude_map": lambda shown, _, title, __: draw_amplitude_map(amplitude_map_info(shown, title)),
    "difference": lambda shown, _, title, __: draw_difference(difference_info(shown, title)),
    "nyquist": lambda shown, reference, title, _: draw_nyquist(nyquist_info(shown, reference, title)),
    "coherence": lambda shown, _, title, __: draw_coherence(coherence_info(shown, title)),
    "levels": lambda shown, _, title, __: draw_levels(levels_info(shown, title)),
    "hysteresis": lambda shown, _, title, __: _draw_loops(_labelled_curves(shown), title),
    "positioning": lambda shown, _, title, __: draw_positioning(positioning_info(_labelled_curves(shown), title)),
    "distribution": lambda shown, _, title, __: draw_distribution(distribution_info(shown, title)),
    "curves": lambda shown, _, title, __: _draw_others(_labelled_curves(shown), title),
}
"""What draws each kind of figure: results, reference, title, and whether the phase lies within ±180°."""


def save_figure(figure: Figure, path: Path, keys: Sequence[str]) -> None:
    """Write a figure as PNG, SVG or PDF, by the file's suffix, with a stamp of its contents (see `stamp_digest`).

    The same figure gives the same bytes; the file appears complete or not at all.
    """
    suffix = check_suffix(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as draft, draft.open("wb") as stream:
            _write(figure, stream, suffix, stamp_digest(keys))
    except OSError as error:
        raise FraexpError(f"{path}: the figure cannot be written: {error.strerror or error}") from None


def _write(figure: Figure, target: IO[bytes], suffix: str, stamp: str) -> None:
    metadata: dict[str, dict[str, str | None]] = {
        ".png": {"Software": "fraexp", "Description": stamp},
        ".svg": {"Creator": "fraexp", "Date": None, "Identifier": stamp},
        ".pdf": {"Creator": "fraexp", "CreationDate": None, "Keywords": stamp},
    }
    with figure_style(), warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", "Glyph .* missing"
        )  # the font lacks the script of a name, which is drawn as boxes
        figure.savefig(target, format=suffix[1:], metadata=metadata[suffix])
