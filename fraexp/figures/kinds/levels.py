"""Levels of a response and of its disturbances: noise, and stochastic nonlinear distortions."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import PARITIES, FrequencyResponse, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.facets import facet_panels
from fraexp.figures.elements.frequency_lines import draw_line
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.elements.scales import decibel, readable_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_PANELS = 12
"""Maximum number of panels in a figure."""
QUANTITIES = (
    "response",
    "total, of the mean",
    "noise, of the mean",
    "nonlinear, of one realisation",
    *(f"{parity} distortions, of one realisation" for parity in PARITIES),
)
"""Quantities that are drawn: |Ĝ|, and standard deviations √E|dG|²; those of odd and even distortions have its noise."""


@dataclass(frozen=True)
class LevelsPanel:
    """The levels of a response, in ascending frequency."""

    label: str
    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    settled: NDArray[np.bool_]
    """Whether the point had settled, shape (n,)."""
    quantities: dict[str, NDArray[np.float64]]
    """The known ones of `QUANTITIES` [dB], each of shape (n,)."""


@dataclass(frozen=True)
class LevelsInfo:
    """Contents of a figure of levels."""

    panels: tuple[LevelsPanel, ...]
    unit: str
    """Unit that is 0 dB, such as ``mm/N``."""
    title: str


def levels_info(shown: Sequence[ShownResult], title: str = "") -> LevelsInfo:
    """Return the levels of the responses whose noise or nonlinear distortion is known; FraexpError if there is none."""
    responses = [(of.label, of.response, of.result) for of in shown if of.response is not None]
    known = [(label, response, result) for label, response, result in responses if _has_levels(response)]
    if not known:
        raise FraexpError(
            "levels: no response has noise or nonlinear distortions; record several periods, or several "
            "realisations of a multisine"
        )
    if len(known) > MAX_PANELS:
        raise FraexpError(
            f"levels: found {len(known)} responses; no more than {MAX_PANELS} panels fit; choose fewer sweeps"
        )
    units = {response.unit for _, response, _ in known}
    if len(units) > 1:
        raise FraexpError(f"levels: found responses in {' and '.join(sorted(units))}; choose sweeps that share a unit")
    factor, unit = readable_unit(units.pop())
    panels = tuple(_levels_panel(*of, factor) for of in known)
    return LevelsInfo(panels, unit, title or "Levels of noise and distortion")


def _has_levels(response: FrequencyResponse) -> bool:
    apart = (response.noise_variance, response.nonlinear_variance)
    return any(part is not None for part in apart) or bool(np.isfinite(response.standard_deviation).any())


def _levels_panel(label: str, response: FrequencyResponse, result: Result, factor: float) -> LevelsPanel:
    order = np.argsort(response.frequency, kind="stable")
    sizes: dict[str, NDArray[np.float64] | None] = {
        QUANTITIES[0]: np.abs(response.response),
        QUANTITIES[1]: response.standard_deviation,
        QUANTITIES[2]: _standard_deviation(response.noise_variance),
        QUANTITIES[3]: _standard_deviation(response.nonlinear_variance),
    }
    for of, name in zip(QUANTITIES[4:], PARITIES, strict=True):
        if name in result.parity_levels:  # they say more than their sum, which would hide the greater one
            sizes[of], sizes[QUANTITIES[3]] = result.parity_levels[name] * np.abs(response.response), None
    levels = {name: decibel(factor * size[order]) for name, size in sizes.items() if size is not None}
    levels = {name: level for name, level in levels.items() if np.isfinite(level).any()}
    return LevelsPanel(label, response.frequency[order], response.settled[order], levels)


def _standard_deviation(variance: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    return None if variance is None else np.sqrt(np.maximum(variance, 0))


def draw_levels(info: LevelsInfo) -> "Figure":
    """Draw a panel for each response; all share their axes."""
    with canvas.figure_style():
        labels = [panel.label for panel in info.panels]
        names = [of if labels.count(of) == 1 else f"{of} ({number})" for number, of in enumerate(labels, start=1)]
        panels = facet_panels(names, (8.0, 5.2), facet_height=3.4)
        for axes, panel in zip(panels.all, info.panels, strict=True):
            _draw_panel(axes, panel)
        frequency = np.concatenate([panel.frequency for panel in info.panels])
        canvas.set_log_abscissa(panels.first[0], (float(frequency.min()), float(frequency.max())))
        canvas.draw_grid(*panels.all)
        panels.label(info.title, ["Frequency [Hz]"], [f"Level [dB re 1 {info.unit}]"])
        canvas.add_legend_below(panels.figure, *panels.all)
    return panels.figure


def _draw_panel(axes: "Axes", panel: LevelsPanel) -> None:
    styles = canvas.line_styles(len(QUANTITIES) - 1)
    for name, style in zip(QUANTITIES, (*styles[:4], *styles[3:]), strict=True):  # nonlinear, or odd and even
        if name in panel.quantities:
            levels = panel.quantities[name]
            draw_line(axes, panel.frequency, levels, panel.settled & np.isfinite(levels), name, style)
