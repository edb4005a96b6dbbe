"""How far a response stands above what disturbs it: noise, and stochastic nonlinear distortions."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.data.results import FrequencyResponse
from fraexp.errors import FraexpError
from fraexp.figures.elements.frequency_lines import draw_line
from fraexp.figures.elements.labels import drawable
from fraexp.figures.elements.scales import decibel, readable_unit
from fraexp.figures.elements.shown import ShownResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 12
"""Most panels of one figure."""
ABREAST = 3
"""Most panels side by side."""
QUANTITIES = ("response", "total, of the mean", "noise, of the mean", "nonlinear, of one realisation")
"""What is drawn: |Ĝ|, and standard deviations √E|dG|²."""


@dataclass(frozen=True)
class Levels:
    """The levels of one response, in ascending frequency."""

    label: str
    frequency: np.ndarray
    """Frequency [Hz], shape (n,)."""
    settled: np.ndarray
    """Whether the point had become periodic, shape (n,) of bool."""
    quantities: dict[str, np.ndarray]
    """Those of `QUANTITIES` that are known [dB], each of shape (n,)."""


@dataclass(frozen=True)
class LevelsInfo:
    """What a figure of levels shows."""

    panels: tuple[Levels, ...]
    unit: str
    """Unit that is 0 dB, such as ``mm/N``."""
    title: str


def levels_info(shown: Sequence[ShownResult], title: str = "") -> LevelsInfo:
    """Return the levels of all responses whose noise or nonlinear distortion is known; FraexpError if there is none."""
    responses = [(of.label, of.response) for of in shown if of.response is not None]
    telling = [(label, response) for label, response in responses if _tells(response)]
    if not telling:
        raise FraexpError(
            "levels: no response tells noise or nonlinear distortions; record several periods, or several "
            "realisations of a multisine"
        )
    if len(telling) > MOST:
        raise FraexpError(f"levels: found {len(telling)} responses; {MOST} panels at most fit, choose fewer sweeps")
    units = {response.unit for _, response in telling}
    if len(units) > 1:
        raise FraexpError(f"levels: found responses in {' and '.join(sorted(units))}; choose sweeps that share a unit")
    factor, unit = readable_unit(units.pop())
    panels = tuple(_levels(label, response, factor) for label, response in telling)
    return LevelsInfo(panels, unit, title or "Levels of noise and distortion")


def _tells(response: FrequencyResponse) -> bool:
    apart = (response.noise_variance, response.nonlinear_variance)
    return any(part is not None for part in apart) or bool(np.isfinite(response.standard_deviation).any())


def _levels(label: str, response: FrequencyResponse, factor: float) -> Levels:
    order = np.argsort(response.frequency, kind="stable")
    sizes = {
        QUANTITIES[0]: np.abs(response.response),
        QUANTITIES[1]: response.standard_deviation,
        QUANTITIES[2]: _root(response.noise_variance),
        QUANTITIES[3]: _root(response.nonlinear_variance),
    }
    known = {name: decibel(factor * size[order]) for name, size in sizes.items() if size is not None}
    known = {name: levels for name, levels in known.items() if np.isfinite(levels).any()}
    return Levels(label, response.frequency[order], response.settled[order], known)


def _root(variance: np.ndarray | None) -> np.ndarray | None:
    return None if variance is None else np.sqrt(np.maximum(variance, 0))


def draw_levels(info: LevelsInfo) -> "Figure":
    """Draw a panel for each response; all share their axes."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    count = len(info.panels)
    columns = min(count, ABREAST if count != 4 else 2)
    rows = -(-count // columns)
    with canvas.styled():
        width = 8.0 if columns == 1 else 1.0 + 4.2 * columns
        figure = canvas.new_figure(width=width, height=1.6 + 3.4 * rows if rows > 1 else 5.2)
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for axes, panel in zip(grid.flat, info.panels, strict=False):
            _draw_panel(axes, panel)
            axes.set_title(
                drawable(panel.label) if count > 1 else canvas.heading(figure, info.title),
                fontsize=11 if count > 1 else None,
            )
        spare = list(grid.flat)[count:]
        for axes in spare:
            axes.set_visible(False)
        for axes in list(grid.flat)[max(count - columns, 0) : count]:
            axes.set_xlabel("Frequency [Hz]")
            axes.tick_params(labelbottom=True)
        for axes in grid[:, 0]:
            axes.set_ylabel(f"Level [dB re 1 {info.unit}]")
        frequency = np.concatenate([panel.frequency for panel in info.panels])
        canvas.frequency_axis(grid[0, 0], (float(frequency.min()), float(frequency.max())))
        canvas.grid(*list(grid.flat)[:count])
        if count > 1:
            figure.suptitle(canvas.heading(figure, info.title))
        telling = max(range(count), key=lambda index: len(info.panels[index].quantities))
        canvas.legend_below(figure, grid.flat[telling])
    return figure


def _draw_panel(axes: "Axes", panel: Levels) -> None:
    from fraexp.figures.elements import canvas

    for name, style in zip(QUANTITIES, canvas.line_styles(len(QUANTITIES)), strict=True):
        if name in panel.quantities:
            levels = panel.quantities[name]
            draw_line(axes, panel.frequency, levels, panel.settled & np.isfinite(levels), name, style)
