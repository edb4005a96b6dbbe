"""Choosing the figure that fits results, and writing figures to files."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from matplotlib.figure import Figure

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements.canvas import styled
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.elements.stamp import check_suffix, digest
from fraexp.figures.elements.view import ALL, View, interrupt_wrapped, show_band
from fraexp.figures.kinds.against_first import difference_info, draw_difference
from fraexp.figures.kinds.amplitude_map import amplitude_map_info, draw_amplitude_map
from fraexp.figures.kinds.bode import Reference, bode_info, draw_bode
from fraexp.figures.kinds.coherence import coherence_info, draw_coherence
from fraexp.figures.kinds.distribution import distribution_info, draw_distribution
from fraexp.figures.kinds.hysteresis_loops import draw_hysteresis, hysteresis_info, is_hysteresis
from fraexp.figures.kinds.levels import draw_levels, levels_info
from fraexp.figures.kinds.nyquist import draw_nyquist, nyquist_info
from fraexp.figures.kinds.other_curves import curves_info, draw_curves
from fraexp.figures.kinds.plant_errors import draw_errors, errors_info
from fraexp.figures.kinds.positioning_moves import draw_positioning, is_positioning, positioning_info

OF_CURVES = ("hysteresis", "positioning", "curves")
"""Kinds of figure that show the curves of results."""
OF_SHOWN: dict[str, Callable[[Sequence[ShownResult], str], Figure]] = {
    "errors": lambda shown, title: draw_errors(errors_info(shown, title)),
    "difference": lambda shown, title: draw_difference(difference_info(shown, title)),
    "coherence": lambda shown, title: draw_coherence(coherence_info(shown, title)),
    "amplitude_map": lambda shown, title: draw_amplitude_map(amplitude_map_info(shown, title)),
    "levels": lambda shown, title: draw_levels(levels_info(shown, title)),
    "distribution": lambda shown, title: draw_distribution(distribution_info(shown, title)),
}
"""How the kinds are drawn that need nothing but what is shown and a title."""


def figure_for(
    shown: Sequence[ShownResult], reference: Reference | None = None, title: str = "", kind: str = "", view: View = ALL
) -> Figure:
    """Return a figure of results: of a kind (see `kinds`), or of the one that fits them.

    A Bode plot fits them if any has a response, else hysteresis loops if each has one, else positioning motions, else
    curves. FraexpError if there is nothing of a `view` in it.
    """
    chosen = kind or _fitting(shown)
    view.check(chosen)
    figure = _whole(shown, reference, title, chosen, view)
    if view.wrapped:
        interrupt_wrapped(figure)
    if view.band:
        show_band(figure, view.band)
    return figure


def _whole(shown: Sequence[ShownResult], reference: Reference | None, title: str, chosen: str, view: View) -> Figure:
    if chosen in OF_CURVES:
        return _of_curves(_curves(shown), title, chosen)
    if chosen in OF_SHOWN:
        return OF_SHOWN[chosen](shown, title)
    if chosen == "nyquist":
        return draw_nyquist(nyquist_info(shown, reference, title))
    responses = [(of, of.response) for of in shown if of.response is not None]
    curves = [(of.label, response) for of, response in responses]
    groups, fitted = [of.group for of, _ in responses], [of.fitted for of, _ in responses]
    return draw_bode(bode_info(curves, reference, title, groups, fitted, view.wrapped))


def _of_curves(found: Sequence[tuple[str, Curve, str]], title: str, kind: str) -> Figure:
    match kind:
        case "hysteresis":
            loops = [(label, curve) for label, curve, _ in found if is_hysteresis(curve)]
            return draw_hysteresis(hysteresis_info(loops, title))
        case "positioning":
            return draw_positioning(positioning_info(found, title))
    return draw_curves(curves_info([(label, curve) for label, curve, _ in found], title, [of for *_, of in found]))


def _fitting(shown: Sequence[ShownResult]) -> str:
    if any(of.response is not None for of in shown):
        return "bode"
    found = _curves(shown)
    if not found:
        raise FraexpError("figure: no result has a frequency response or a curve to draw")
    with_curves = [of.result.curves for of in shown if of.result.curves]
    if all(any(is_hysteresis(curve) for curve in curves) for curves in with_curves):
        return "hysteresis"
    return "positioning" if any(is_positioning(curve) for _, curve, _ in found) else "curves"


def _curves(shown: Sequence[ShownResult]) -> list[tuple[str, Curve, str]]:
    return [(of.label, curve, of.group) for of in shown for curve in of.result.curves]


def save(figure: Figure, path: Path, keys: Sequence[str]) -> None:
    """Write a figure as PNG, SVG or PDF, by the file's suffix, stamped with what it shows (see `stamp.digest`).

    The same figure gives the same bytes; the file appears whole or not at all.
    """
    suffix = check_suffix(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile(dir=path.parent, prefix=path.name, suffix=suffix, delete=False) as part:
            _write(figure, part, suffix, digest(keys))
        Path(part.name).chmod(0o644)  # a temporary file is private; a figure is meant to be read
        Path(part.name).replace(path)
    except OSError as error:
        raise FraexpError(f"{path}: the figure cannot be written: {error.strerror or error}") from None


def _write(figure: Figure, target: Any, suffix: str, stamp: str) -> None:
    metadata: dict[str, dict[str, str | None]] = {
        ".png": {"Software": "fraexp", "Description": stamp},
        ".svg": {"Creator": "fraexp", "Date": None, "Identifier": stamp},
        ".pdf": {"Creator": "fraexp", "CreationDate": None, "Keywords": stamp},
    }
    with styled(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a name in a script that the font lacks: drawn as boxes
        figure.savefig(target, format=suffix[1:], metadata=metadata[suffix])
