"""Quality of measured responses: coherence, and harmonic distortion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import FrequencyResponse
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.facets import by_facet, facet_panels, group_styles
from fraexp.figures.elements.frequency_lines import GroupedLine, draw_grouped_lines
from fraexp.figures.elements.grouping import CurvePlace, ShownResult, curve_places

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOG_AXIS_RATIO = 10.0
"""Ratio of largest to smallest distortion above which its axis is logarithmic."""


@dataclass(frozen=True)
class CoherenceCurve:
    """Coherence and distortion of one response, in ascending frequency."""

    label: str
    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    settled: NDArray[np.bool_]
    """Whether the point had settled, shape (n,)."""
    coherence: NDArray[np.float64] | None
    """Squared coherence of input and output, shape (n,); None if it is unknown."""
    distortion: NDArray[np.float64] | None
    """Total harmonic distortion of the output [%], shape (n,); None if it is unknown."""
    place: CurvePlace
    """Where it belongs."""
    key: str = ""
    """Key of its sweep."""


@dataclass(frozen=True)
class CoherenceInfo:
    """Contents of a figure of coherence and distortion."""

    curves: tuple[CoherenceCurve, ...]
    is_logarithmic: bool
    """Whether the axis of the distortion is logarithmic."""
    title: str

    @property
    def parts(self) -> tuple[str, ...]:
        """Those of ``coherence`` and ``distortion`` that are known for a response."""
        parts = ("coherence", "distortion")
        return tuple(part for part in parts if any(getattr(curve, part) is not None for curve in self.curves))


def coherence_info(shown: Sequence[ShownResult], title: str = "") -> CoherenceInfo:
    """Return coherence and distortion of the responses for which one is known; FraexpError if there is none."""
    pairs = zip(shown, curve_places(shown), strict=True)
    found = (_coherence_curve(of, of.response, place) for of, place in pairs if of.response is not None)
    curves = tuple(curve for curve in found if curve.coherence is not None or curve.distortion is not None)
    if not curves:
        raise FraexpError(
            "coherence: no response has coherence or distortion; a stepped sine gives distortion, and a spectral "
            "estimator gives coherence"
        )
    known = [curve.distortion for curve in curves if curve.distortion is not None]
    values = np.concatenate(known) if known else np.zeros(0)
    values = values[np.isfinite(values) & (values > 0)]
    is_logarithmic = bool(values.size) and bool(values.max() > LOG_AXIS_RATIO * values.min())
    return CoherenceInfo(curves, is_logarithmic, title or "Coherence and distortion")


def _coherence_curve(of: ShownResult, response: FrequencyResponse, place: CurvePlace) -> CoherenceCurve:
    order = np.argsort(response.frequency, kind="stable")
    coherence, distortion = response.coherence, 100 * response.distortion
    return CoherenceCurve(
        of.label,
        response.frequency[order],
        response.settled[order],
        None if coherence is None or not np.isfinite(coherence).any() else coherence[order],
        None if not np.isfinite(distortion).any() else distortion[order],
        place,
        of.key,
    )


AXIS_TITLES = {"coherence": "Squared coherence [1]", "distortion": "Harmonic distortion [%]"}


def draw_coherence(info: CoherenceInfo) -> "Figure":
    """Draw the coherence and distortion that are known over frequency."""
    places = [curve.place for curve in info.curves]
    count = len(info.parts)
    with canvas.figure_style():
        facets = by_facet(info.curves, places)
        panels = facet_panels(list(facets), (9.0, 1.8 + 2.6 * count), (1.0,) * count, 0.9 + 2.0 * count)
        styles = group_styles(places)
        for curves, drawn in zip(facets.values(), panels.facets.values(), strict=True):
            for axes, part in zip(drawn, info.parts, strict=True):
                draw_grouped_lines(axes, [_line(curve, part) for curve in curves], styles)
        for axes, part in zip(panels.first, info.parts, strict=True):
            _set_axis(axes, part, info.is_logarithmic)
        frequency = np.concatenate([curve.frequency for curve in info.curves])
        canvas.set_log_abscissa(panels.first[0], (float(frequency.min()), float(frequency.max())))
        canvas.draw_grid(*panels.all)
        panels.label(info.title, ["Frequency [Hz]"], [AXIS_TITLES[part] for part in info.parts])
        panels.add_legend(places)
    return panels.figure


def _line(curve: CoherenceCurve, part: str) -> GroupedLine:
    values = getattr(curve, part)
    values = np.full(len(curve.frequency), np.nan) if values is None else values
    return GroupedLine(curve.label, curve.place, curve.frequency, values, curve.settled)


def _set_axis(axes: "Axes", part: str, is_logarithmic: bool) -> None:
    if part == "coherence":
        axes.set_ylim(0, 1.05)
    elif is_logarithmic:
        axes.set_yscale("log")
        canvas.set_decade_ticks(axes)
