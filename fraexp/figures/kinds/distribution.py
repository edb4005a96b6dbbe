"""Distribution of metrics over Monte Carlo samples, with the levels of median and 95 %, and the worst sample."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import EFFORT
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.canvas import LineStyle
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.elements.labels import MAX_GROUPS, drawable
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_METRICS = 4
"""Maximum number of metrics in a figure."""
NAME_MARGIN = 0.16
"""Width beside the curves for the names of the worst draws, relative to theirs."""
TEXT_BACKGROUND: LineStyle = {"facecolor": "1.0", "edgecolor": "none", "alpha": 0.7, "pad": 1}
"""Background that keeps a number readable on lines."""
QUANTILE_LEVELS = (0.5, 0.95)
"""Quantiles that are marked."""


@dataclass(frozen=True)
class _MetricSample:
    """Values of a metric over the draws of a family."""

    label: str
    """Nominal values of the draws; empty if there is one family."""
    values: NDArray[np.float64]
    """Known values [unit of the panel], ascending, shape (n,)."""
    count: int
    """Number of draws, including those without a value."""
    worst: ShownResult | None
    """The sweep with the largest magnitude; None if no sweep has a value."""


@dataclass(frozen=True)
class _DistributionPanel:
    """A panel with one metric."""

    metric: str
    unit: str
    samples: tuple[_MetricSample, ...]


@dataclass(frozen=True)
class DistributionInfo:
    """Contents of a figure of distributions."""

    panels: tuple[_DistributionPanel, ...]
    families: tuple[str, ...]
    title: str


def distribution_info(shown: Sequence[ShownResult], title: str = "") -> DistributionInfo:
    """Return the distributions of the first `MAX_METRICS` metrics that vary between draws."""
    families: dict[str, list[ShownResult]] = {}
    for of in shown:
        families.setdefault(of.drawn.family if of.drawn else of.place.point if of.place else "", []).append(of)
    if len(families) > MAX_GROUPS:
        raise FraexpError(
            f"distribution: found {len(families)} cases; no more than {MAX_GROUPS} can be distinguished; choose fewer"
        )
    panels = tuple(_panel(name, unit, families) for name, unit in _varying_metrics(shown))
    if not panels:
        raise FraexpError(f"distribution: {_empty_reason(shown)}")
    return DistributionInfo(panels, tuple(families), title or "Distribution over random draws")


def _varying_metrics(shown: Sequence[ShownResult]) -> list[tuple[str, str]]:
    """Return names and units of the metrics with many different values, or without a value in some draws.

    The effort of an experiment is among them only if there is no other metric.
    """
    found: dict[tuple[str, str], list[float]] = {}
    for of in shown:
        for metric in of.result.metrics:
            found.setdefault((metric.name, metric.unit), []).append(metric.value)
    varied = [key for key, values in found.items() if _distinct_count(np.array(values)) > MAX_GROUPS]
    return ([key for key in varied if key[0] not in EFFORT] or varied)[:MAX_METRICS]


def _distinct_count(values: NDArray[np.float64]) -> int:
    """Return the number of different values; if some are missing, the number of all values."""
    known = np.isfinite(values)
    return np.unique(values).size if known.all() else values.size


def _empty_reason(shown: Sequence[ShownResult]) -> str:
    """Return why there is no distribution, and the remedy."""
    draws = len({of.drawn.number for of in shown if of.drawn})
    if not draws:
        return "no metric has enough different values; draw numbers at random in a section [monte_carlo]"
    if draws <= MAX_GROUPS:
        found = "1 draw" if draws == 1 else f"{draws} draws"
        return f"found {found}; expected at least {MAX_GROUPS + 1}: raise 'count' in the section [monte_carlo]"
    return "no metric differs from draw to draw; draw numbers that matter, or raise their deviation"


def _panel(name: str, unit: str, families: Mapping[str, Sequence[ShownResult]]) -> _DistributionPanel:
    values = {family: np.array([_value(of, name, unit) for of in members]) for family, members in families.items()}
    greatest = max(float(np.abs(column[np.isfinite(column)]).max(initial=0.0)) for column in values.values())
    factor, readable = _readable_unit(unit, greatest)
    samples = []
    for family, column in values.items():
        known, members = np.isfinite(column), families[family]
        worst = members[int(np.nanargmax(np.where(known, np.abs(column), np.nan)))] if known.any() else None
        samples.append(_MetricSample(family, factor * np.sort(column[known]), column.size, worst))
    return _DistributionPanel(name, readable, tuple(samples))


def _value(of: ShownResult, name: str, unit: str) -> float:
    return next((m.value for m in of.result.metrics if (m.name, m.unit) == (name, unit)), np.nan)


def _readable_unit(unit: str, greatest: float) -> tuple[float, str]:
    if unit in DISPLACEMENT_UNITS:
        return (1e6, f"µ{unit}") if greatest < 1e-3 else (1e3, f"m{unit}") if greatest < 1 else (1.0, unit)
    return (1e3, "ms") if unit == "s" and greatest < 1 else (1.0, unit)


def draw_distribution(info: DistributionInfo) -> "Figure":
    """Draw the distribution function of each metric, with a line for each family."""
    count = len(info.panels)
    columns, rows = (1, 1) if count == 1 else (2, -(-count // 2))
    with canvas.figure_style():
        styles = dict(zip(info.families, canvas.named_styles(len(info.families)), strict=True))
        figure = canvas.new_figure(9.0, height=1.2 + 3.0 * rows)
        grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
        for axes, panel in zip(grid.flat, info.panels, strict=False):
            _draw_panel(axes, panel, styles)
        for axes in list(grid.flat)[count:]:
            axes.set_visible(False)
        for axes in grid[:, 0]:
            axes.set_ylabel("Share of the draws [%]")
        canvas.draw_grid(*list(grid.flat)[:count])
        figure.suptitle(canvas.wrapped_title(figure, info.title))
        canvas.add_legend_below(figure, *list(grid.flat)[:count])
    return figure


def _draw_panel(axes: "Axes", panel: _DistributionPanel, styles: Mapping[str, LineStyle]) -> None:
    for level in QUANTILE_LEVELS:
        axes.axhline(100 * level, color="0.4", linewidth=0.8, linestyle=(0, (4, 4)), zorder=2)
    for sample in panel.samples:
        style = styles[sample.label]
        axes.plot([], [], label=drawable(sample.label), **style)  # in the legend even if no draw has a value
        if sample.worst is None:
            continue
        share = 100 * np.arange(sample.values.size + 1) / sample.count
        axes.step(np.append(sample.values[0], sample.values), share, where="post", **style)
        x, y = sample.values[-1 if sample.values[-1] >= -sample.values[0] else 0], share[-1]
        y = y if x == sample.values[-1] else share[1]
        axes.plot(x, y, "o", color=str(style["color"]), markersize=5, zorder=4)
        axes.annotate(
            drawable(_draw_name(sample.worst)), (x, y), xytext=(6, 0), textcoords="offset points", ha="left",
            va="center", fontsize=9, color=str(style["color"]), bbox=TEXT_BACKGROUND,
        )  # fmt: skip
    low, high = axes.get_xlim()
    axes.set_xlim(low, high + NAME_MARGIN * (high - low))
    if all(sample.worst is None for sample in panel.samples):
        axes.text(
            0.5, 0.5, "no draw has a value", ha="center", color="0.3", transform=axes.transAxes, bbox=TEXT_BACKGROUND
        )
        axes.set_xticks([])
    axes.set_ylim(0, 103)
    axes.set_xlabel(_axis_title(panel))


def _axis_title(panel: _DistributionPanel) -> str:
    name = panel.metric[:1].upper() + panel.metric[1:]
    return f"{name} [{panel.unit}]" if panel.unit not in ("", "1") else name


def _draw_name(of: ShownResult) -> str:
    return f"draw {of.drawn.number}" if of.drawn else of.label
