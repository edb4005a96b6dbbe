"""Quality of measured responses: coherence, and harmonic distortion."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import FraexpError
from fraexp.figures.elements.frequency_lines import GroupedLine
from fraexp.figures.elements.grouping import ShownResult, curve_places
from fraexp.figures.elements.panel_figure import Panel, PanelFigure, over_frequency

LOG_AXIS_RATIO = 10.0
"""Ratio of largest to smallest distortion above which its axis is logarithmic."""


def coherence_info(shown: Sequence[ShownResult], title: str = "") -> PanelFigure:
    """Return coherence and distortion of the responses for which one is known; FraexpError if there is none."""
    rows: dict[str, list[GroupedLine]] = {"coherence": [], "distortion": []}
    for of, place in zip(shown, curve_places(shown), strict=True):
        if (response := of.response) is not None:
            known: dict[str, NDArray[np.float64] | None] = {
                "coherence": response.coherence, "distortion": 100 * response.distortion,
            }  # fmt: skip
            for part, values in known.items():
                if values is not None and np.isfinite(values).any():
                    line = GroupedLine(of.label, place, response.frequency, values, response.settled, key=of.key)
                    rows[part].append(line)
    if not any(rows.values()):
        raise FraexpError(
            "coherence: no response has coherence or distortion; a stepped sine gives distortion, and a spectral "
            "estimator gives coherence"
        )
    sizes = np.concatenate([np.zeros(0), *(line.y for line in rows["distortion"])])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    is_log = bool(sizes.size) and bool(sizes.max() > LOG_AXIS_RATIO * sizes.min())
    panels = (
        Panel("Squared coherence [1]", "", tuple(rows["coherence"]), span=(0.0, 1.05)),
        Panel("Harmonic distortion [%]", "%", tuple(rows["distortion"]), is_log),
    )
    return over_frequency(title or "Coherence and distortion", *(panel for panel in panels if panel.lines))
