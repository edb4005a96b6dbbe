"""Quality of measured responses: coherence, and harmonic distortion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import FrequencyResponse
from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MAX_SINGLE_CURVES
from fraexp.figures.elements.frequency_lines import draw_line
from fraexp.figures.elements.shown import ShownResult

if TYPE_CHECKING:
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
    found = (_coherence_curve(of, of.response) for of in shown if of.response is not None)
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


def _coherence_curve(of: ShownResult, response: FrequencyResponse) -> CoherenceCurve:
    order = np.argsort(response.frequency, kind="stable")
    coherence, distortion = response.coherence, 100 * response.distortion
    return CoherenceCurve(
        of.label,
        response.frequency[order],
        response.settled[order],
        None if coherence is None or not np.isfinite(coherence).any() else coherence[order],
        None if not np.isfinite(distortion).any() else distortion[order],
        of.key,
    )


AXIS_TITLES = {"coherence": "Squared coherence [1]", "distortion": "Harmonic distortion [%]"}


def draw_coherence(info: CoherenceInfo) -> "Figure":
    """Draw the coherence and distortion that are known over frequency."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    if len(info.curves) > MAX_SINGLE_CURVES:
        raise FraexpError(
            f"coherence: found {len(info.curves)} responses; no more than {MAX_SINGLE_CURVES} can be distinguished"
        )
    with canvas.figure_style():
        count = len(info.parts)
        figure = canvas.new_figure(width=9.0, height=1.8 + 2.6 * count)
        panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        styles = canvas.line_styles(len(info.curves))
        for axes, part in zip(panels, info.parts, strict=True):
            for curve, style in zip(info.curves, styles, strict=True):
                values = getattr(curve, part)
                empty = np.full(len(curve.frequency), np.nan)
                draw_line(axes, curve.frequency, empty if values is None else values, curve.settled, curve.label, style)
            axes.set_ylabel(AXIS_TITLES[part])
            if part == "coherence":
                axes.set_ylim(0, 1.05)
            elif info.is_logarithmic:
                axes.set_yscale("log")
                canvas.set_decade_ticks(axes)
        panels[0].set_title(canvas.wrapped_title(figure, info.title))
        panels[-1].set_xlabel("Frequency [Hz]")
        frequency = np.concatenate([curve.frequency for curve in info.curves])
        canvas.set_frequency_axis(panels[-1], (float(frequency.min()), float(frequency.max())))
        canvas.draw_grid(*panels)
        figure.align_ylabels(panels)
        canvas.add_legend_below(figure, panels[0])
    return figure
