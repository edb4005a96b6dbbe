"""How far responses can be trusted, by what was measured with them: coherence, and harmonic distortion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.data.results import FrequencyResponse
from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MANY
from fraexp.figures.elements.frequency_lines import draw_line
from fraexp.figures.elements.shown import ShownResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DECADE = 10.0
"""Greatest over least distortion from which its axis is logarithmic."""


@dataclass(frozen=True)
class Trust:
    """Coherence and distortion of one response, in ascending frequency."""

    label: str
    frequency: np.ndarray
    """Frequency [Hz], shape (n,)."""
    settled: np.ndarray
    """Whether the point had become periodic, shape (n,) of bool."""
    coherence: np.ndarray | None
    """Squared coherence of input and output, shape (n,); None where it is not known."""
    distortion: np.ndarray | None
    """Total harmonic distortion of the output [%], shape (n,); None where it is not known."""
    key: str = ""
    """Key of its sweep."""


@dataclass(frozen=True)
class CoherenceInfo:
    """What a figure of coherence and distortion shows."""

    curves: tuple[Trust, ...]
    decades: bool
    """Whether the axis of the distortion is logarithmic."""
    title: str

    @property
    def parts(self) -> tuple[str, ...]:
        """Which are known of some response: ``coherence``, ``distortion``."""
        parts = ("coherence", "distortion")
        return tuple(part for part in parts if any(getattr(curve, part) is not None for curve in self.curves))


def coherence_info(shown: Sequence[ShownResult], title: str = "") -> CoherenceInfo:
    """Return coherence and distortion of all responses of which one is known; FraexpError if there is none."""
    found = (_trust(of, of.response) for of in shown if of.response is not None)
    curves = tuple(curve for curve in found if curve.coherence is not None or curve.distortion is not None)
    if not curves:
        raise FraexpError(
            "coherence: no response tells coherence or distortion; a stepped sine tells distortion, and a spectral "
            "estimator coherence"
        )
    known = [curve.distortion for curve in curves if curve.distortion is not None]
    values = np.concatenate(known) if known else np.zeros(0)
    values = values[np.isfinite(values) & (values > 0)]
    decades = bool(values.size) and bool(values.max() > DECADE * values.min())
    return CoherenceInfo(curves, decades, title or "Coherence and distortion")


def _trust(of: ShownResult, response: FrequencyResponse) -> Trust:
    order = np.argsort(response.frequency, kind="stable")
    coherence, distortion = response.coherence, 100 * response.distortion
    return Trust(
        of.label,
        response.frequency[order],
        response.settled[order],
        None if coherence is None or not np.isfinite(coherence).any() else coherence[order],
        None if not np.isfinite(distortion).any() else distortion[order],
        of.key,
    )


TITLES = {"coherence": "Squared coherence [1]", "distortion": "Harmonic distortion [%]"}


def draw_coherence(info: CoherenceInfo) -> "Figure":
    """Draw coherence and distortion over frequency, as far as they are known."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    if len(info.curves) > MANY:
        raise FraexpError(f"coherence: found {len(info.curves)} responses; {MANY} at most can be told apart")
    with canvas.styled():
        count = len(info.parts)
        figure = canvas.new_figure(width=9.0, height=1.8 + 2.6 * count)
        panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        styles = canvas.line_styles(len(info.curves))
        for axes, part in zip(panels, info.parts, strict=True):
            for curve, style in zip(info.curves, styles, strict=True):
                values = getattr(curve, part)
                empty = np.full(len(curve.frequency), np.nan)
                draw_line(axes, curve.frequency, empty if values is None else values, curve.settled, curve.label, style)
            axes.set_ylabel(TITLES[part])
            if part == "coherence":
                axes.set_ylim(0, 1.05)
            elif info.decades:
                axes.set_yscale("log")
                canvas.decade_axis(axes)
        panels[0].set_title(canvas.heading(figure, info.title))
        panels[-1].set_xlabel("Frequency [Hz]")
        frequency = np.concatenate([curve.frequency for curve in info.curves])
        canvas.frequency_axis(panels[-1], (float(frequency.min()), float(frequency.max())))
        canvas.grid(*panels)
        figure.align_ylabels(panels)
        canvas.legend_below(figure, panels[0])
    return figure
