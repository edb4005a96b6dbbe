"""Choice of the figure for results, and files of figures."""

import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple

from fraexp.data.atomic_file import atomic_file
from fraexp.data.results import EXTREMUM_CURVES, Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements.canvas import figure_style, laid_out
from fraexp.figures.elements.facets import panel_places
from fraexp.figures.elements.grouping import CurvePlace, ShownResult, curve_places, facet_indices
from fraexp.figures.elements.panel_figure import draw_panels
from fraexp.figures.elements.stamp import check_suffix, stamp_digest
from fraexp.figures.elements.view import FULL_VIEW, View, break_wrapped_lines, zoom_to_band
from fraexp.figures.kinds.amplitude_map import amplitude_map_info, draw_amplitude_map, response_map_info
from fraexp.figures.kinds.bode import Reference, bode_info, draw_bode
from fraexp.figures.kinds.curves import (
    curves_info,
    draw_hysteresis,
    hysteresis_info,
    is_hysteresis,
    is_positioning,
    positioning_info,
)
from fraexp.figures.kinds.distribution import distribution_info
from fraexp.figures.kinds.nyquist import draw_nyquist, nyquist_info
from fraexp.figures.kinds.response_errors import difference_figure, difference_info, errors_figure, errors_info
from fraexp.figures.kinds.response_quality import coherence_info, levels_info

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FACET_KINDS = ("hysteresis", "positioning", "curves", "errors", "difference", "coherence", "nyquist")
"""Kinds of figures that have facets but no map."""


class _FigureRequest(NamedTuple):
    """What a figure is drawn of."""

    shown: Sequence[ShownResult]
    reference: Reference | None
    title: str
    wrapped: bool
    """Whether the phase lies within ±180°."""

    def curves(
        self, belongs: Callable[[Curve], bool] = lambda curve: True
    ) -> tuple[list[tuple[str, Curve]], str, list[CurvePlace]]:
        """Return the labelled curves that belong to a kind of figure, its title, and the places of the curves."""
        found = [
            (of.name, curve, place)
            for of, place in zip(self.shown, curve_places(self.shown), strict=True)
            for curve in of.result.curves
            if curve.name not in EXTREMUM_CURVES and belongs(curve)
        ]
        return [(name, curve) for name, curve, _ in found], self.title, [place for *_, place in found]


def draw_figure(
    shown: Sequence[ShownResult],
    reference: Reference | None = None,
    title: str = "",
    kind: str = "",
    view: View = FULL_VIEW,
) -> "Figure":
    """Return a figure of results: of a kind in `FIGURES`, or of the default one.

    The default is a Bode plot if any result has a response, otherwise hysteresis loops if each result has one,
    otherwise positioning moves, otherwise curves. FraexpError if the kind does not support the `view`.
    """
    request = _FigureRequest(shown, reference, title, view.wrapped)
    chosen = kind or _default_kind(request)
    view.check(chosen, [of.response.frequency for of in shown if of.response is not None])
    if chosen in FACET_KINDS:
        places = panel_places(curve_places(shown), chosen)
        placed = [replace(of, place=place) for of, place in zip(shown, places, strict=True)]
        request = request._replace(shown=placed)
    figure = DRAWING_FUNCTIONS[chosen](request)
    if view.wrapped:
        break_wrapped_lines(figure)
    if view.band:
        zoom_to_band(figure, view.band)
    return figure


def _draw_bode(of: _FigureRequest) -> "Figure":
    """Draw responses as a Bode plot, or as a map if there are too many groups for lines."""
    shown = [one for one in of.shown if one.response is not None]
    if any(one.place and one.place.is_mapped for one in shown):
        return draw_amplitude_map(response_map_info(shown, of.title))
    places, infos = curve_places(shown), {}
    for name, indices in (facet_indices(places) or {"": []}).items():
        members = [shown[index] for index in indices]
        curves = [(one.name, one.response) for one in members if one.response is not None]
        of_facet = [places[index] for index in indices]
        fitted = [one.fitted for one in members]
        infos[name] = bode_info(curves, of.reference, of.title, of_facet, fitted, of.wrapped)
    return draw_bode(infos)


def _default_kind(request: _FigureRequest) -> str:
    if any(of.response is not None for of in request.shown):
        return "bode"
    if not request.curves()[0]:
        raise FraexpError("figure: no result has a frequency response or a curve to draw")
    with_curves = [of.result.curves for of in request.shown if of.result.curves]
    if all(any(is_hysteresis(curve) for curve in curves) for curves in with_curves):
        return "hysteresis"
    return "positioning" if request.curves(is_positioning)[0] else "curves"


DRAWING_FUNCTIONS: dict[str, Callable[[_FigureRequest], "Figure"]] = {
    "bode": _draw_bode,
    "errors": lambda of: draw_panels(errors_figure(errors_info(of.shown, of.title))),
    "amplitude_map": lambda of: draw_amplitude_map(amplitude_map_info(of.shown, of.title)),
    "difference": lambda of: draw_panels(difference_figure(difference_info(of.shown, of.title))),
    "nyquist": lambda of: draw_nyquist(nyquist_info(of.shown, of.reference, of.title)),
    "coherence": lambda of: draw_panels(coherence_info(of.shown, of.title)),
    "levels": lambda of: draw_panels(levels_info(of.shown, of.title)),
    "hysteresis": lambda of: draw_hysteresis(hysteresis_info(*of.curves(is_hysteresis))),
    "positioning": lambda of: draw_panels(positioning_info(*of.curves(is_positioning))),
    "distribution": lambda of: draw_panels(distribution_info(of.shown, of.title)),
    "curves": lambda of: draw_panels(curves_info(*of.curves())),
}
"""What draws each kind of figure."""


def save_figure(figure: "Figure", path: Path, keys: Sequence[str]) -> None:
    """Write a figure as PNG, SVG or PDF, by the file's suffix, with a stamp of its contents (see `stamp_digest`).

    The same figure gives the same bytes; the file appears complete or not at all.
    """
    suffix = check_suffix(path)
    with atomic_file(path, makes_folder=True) as draft, draft.open("wb") as stream:
        _write(figure, stream, suffix, stamp_digest(keys))


def _write(figure: "Figure", target: IO[bytes], suffix: str, stamp: str) -> None:
    metadata: dict[str, dict[str, str | None]] = {
        ".png": {"Software": "fraexp", "Description": stamp},
        ".svg": {"Creator": "fraexp", "Date": None, "Identifier": stamp},
        ".pdf": {"Creator": "fraexp", "CreationDate": None, "Keywords": stamp},
    }
    with figure_style(), warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", "Glyph .* missing"
        )  # the font lacks the script of a name, which is drawn as boxes
        with laid_out(figure) if suffix == ".png" else nullcontext():  # others measure texts otherwise
            figure.savefig(target, format=suffix[1:], metadata=metadata[suffix])
