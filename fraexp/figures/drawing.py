"""Choosing the figure that fits results, and writing figures to files."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from matplotlib.figure import Figure

from fraexp.errors import FraexpError
from fraexp.figures.bode import Reference, bode_info, draw_bode
from fraexp.figures.canvas import styled
from fraexp.figures.curves import curves_info, draw_curves
from fraexp.figures.hysteresis import draw_hysteresis, hysteresis_info, is_hysteresis
from fraexp.figures.stamp import check_suffix, digest
from fraexp.results import Result


def figure_for(
    results: Sequence[tuple[str, Result]],
    reference: Reference | None = None,
    title: str = "",
    groups: Sequence[str] = (),
) -> Figure:
    """Return the figure that fits labelled results: a Bode plot, else hysteresis loops, else curves.

    Where the curves are too many to be told apart, their `groups` are, by these names: one for each result.
    """
    named = list(zip(results, groups or [""] * len(results), strict=True))
    responses = [(label, of.response, group) for (label, of), group in named if of.response is not None]
    if responses:
        curves = [(label, response) for label, response, _ in responses]
        return draw_bode(bode_info(curves, reference, title, [group for *_, group in responses]))
    found = [(label, curve, group) for (label, of), group in named for curve in of.curves]
    if not found:
        raise FraexpError("figure: no result has a frequency response or a curve to draw")
    loops = [(label, curve) for label, curve, _ in found if is_hysteresis(curve)]
    if loops:
        return draw_hysteresis(hysteresis_info(loops, title))
    return draw_curves(curves_info([(label, curve) for label, curve, _ in found], title, [of for *_, of in found]))


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
