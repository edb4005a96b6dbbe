"""Quality of measured responses: coherence, and harmonic distortion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.frequency_lines import GroupedLine, draw_rows, frequency_span
from fraexp.figures.elements.grouping import ShownResult, curve_places

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOG_AXIS_RATIO = 10.0
"""Ratio of largest to smallest distortion above which its axis is logarithmic."""
AXIS_TITLES = {"coherence": "Squared coherence [1]", "distortion": "Harmonic distortion [%]"}


@dataclass(frozen=True)
class CoherenceInfo:
    """Contents of a figure of coherence and distortion."""

    rows: dict[str, list[GroupedLine]]
    """Lines over frequency [Hz] of squared ``coherence`` and ``distortion`` [%]; of those that a response has."""
    is_logarithmic: bool
    """Whether the axis of the distortion is logarithmic."""
    title: str


def coherence_info(shown: Sequence[ShownResult], title: str = "") -> CoherenceInfo:
    """Return coherence and distortion of the responses for which one is known; FraexpError if there is none."""
    rows: dict[str, list[GroupedLine]] = {part: [] for part in AXIS_TITLES}
    for of, place in zip(shown, curve_places(shown), strict=True):
        if (response := of.response) is not None:
            known: dict[str, NDArray[np.float64] | None] = {
                "coherence": response.coherence, "distortion": 100 * response.distortion,
            }  # fmt: skip
            for part, values in known.items():
                if values is not None and np.isfinite(values).any():
                    line = GroupedLine(of.label, place, response.frequency, values, response.settled, key=of.key)
                    rows[part].append(line)
    rows = {part: lines for part, lines in rows.items() if lines}
    if not rows:
        raise FraexpError(
            "coherence: no response has coherence or distortion; a stepped sine gives distortion, and a spectral "
            "estimator gives coherence"
        )
    sizes = np.concatenate([np.zeros(0), *(line.y for line in rows.get("distortion", []))])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    is_logarithmic = bool(sizes.size) and bool(sizes.max() > LOG_AXIS_RATIO * sizes.min())
    return CoherenceInfo(rows, is_logarithmic, title or "Coherence and distortion")


def draw_coherence(info: CoherenceInfo) -> "Figure":
    """Draw the coherence and distortion that are known over frequency."""
    count, lines = len(info.rows), [line for row in info.rows.values() for line in row]
    with canvas.figure_style():
        panels = draw_rows(list(info.rows.values()), (9.0, 1.8 + 2.6 * count), facet_height=0.9 + 2.0 * count)
        for axes, part in zip(panels.first, info.rows, strict=True):
            if part == "coherence":
                axes.set_ylim(0, 1.05)
            elif info.is_logarithmic:
                axes.set_yscale("log")
                canvas.set_decade_ticks(axes)
        canvas.set_log_abscissa(panels.first[0], frequency_span(lines))
        y_titles = [AXIS_TITLES[part] for part in info.rows]
        return panels.finish(info.title, ["Frequency [Hz]"], y_titles, [line.place for line in lines])
