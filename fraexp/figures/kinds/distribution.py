"""Metrics over random draws: the share of draws up to each value, with median, 95 % and the worst one."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from fraexp.data.results import EFFORT
from fraexp.errors import FraexpError
from fraexp.figures.elements.labels import GROUPS, drawable
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.elements.table_panel import FigureTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 4
"""Most metrics of one figure."""
CHARACTERS, NOTE = 13.5, 0.19
"""Characters of a note per width of the figure [1/inch], and the height of its line [inch]."""
BEHIND: dict[str, Any] = {"facecolor": "1.0", "edgecolor": "none", "alpha": 0.7, "pad": 1}
"""What keeps a number readable on lines."""
LEVELS = (0.5, 0.95)
"""Shares of the draws that are marked."""


@dataclass(frozen=True)
class Sample:
    """One metric over the draws of one family."""

    label: str
    """What they were drawn around; empty if there is one family."""
    values: np.ndarray
    """Values that are known [unit of its panel], ascending, shape (n,)."""
    count: int
    """Draws, those without a value included."""
    worst: ShownResult | None
    """The sweep with the greatest magnitude; None if no sweep has a value."""
    missing: ShownResult | None
    """The first sweep that has no value, such as one that never settles."""

    def quantile(self, share: float) -> float:
        """Return the value that a share of the draws keeps to; infinite where too few have a value."""
        index = max(int(np.ceil(share * self.count - 1e-9)), 1) - 1
        return float(self.values[index]) if index < self.values.size else np.inf


@dataclass(frozen=True)
class DistributionPanel:
    """One metric."""

    metric: str
    unit: str
    samples: tuple[Sample, ...]


@dataclass(frozen=True)
class DistributionInfo:
    """What a figure of distributions shows."""

    panels: tuple[DistributionPanel, ...]
    families: tuple[str, ...]
    title: str


def distribution_info(shown: Sequence[ShownResult], title: str = "") -> DistributionInfo:
    """Return the distributions of the first metrics that differ from draw to draw, `MOST` at most."""
    families: dict[str, list[ShownResult]] = {}
    for of in shown:
        families.setdefault(of.drawn.family if of.drawn else of.group, []).append(of)
    if len(families) > GROUPS:
        raise FraexpError(
            f"distribution: found {len(families)} cases; {GROUPS} at most can be told apart, choose fewer sweeps"
        )
    panels = tuple(_panel(name, unit, families) for name, unit in _telling(shown))
    if not panels:
        raise FraexpError(f"distribution: {_nothing(shown)}")
    return DistributionInfo(panels, tuple(families), title or "Distribution over random draws")


def _telling(shown: Sequence[ShownResult]) -> list[tuple[str, str]]:
    """Return names and units of metrics with many values, or with none in some draws: that is worse than any value.

    What an experiment takes is among them only if there is nothing else.
    """
    found: dict[tuple[str, str], list[float]] = {}
    for of in shown:
        for metric in of.result.metrics:
            found.setdefault((metric.name, metric.unit), []).append(metric.value)
    varied = [key for key, values in found.items() if _differing(np.array(values)) > GROUPS]
    return ([key for key in varied if key[0] not in EFFORT] or varied)[:MOST]


def _differing(values: np.ndarray) -> int:
    """Return how many different values there are; all of them where some are missing."""
    known = np.isfinite(values)
    return np.unique(values).size if known.all() else values.size


def _nothing(shown: Sequence[ShownResult]) -> str:
    """Return why there is no distribution to draw, and the remedy."""
    draws = len({of.drawn.number for of in shown if of.drawn})
    if not draws:
        return "no metric has enough different values; draw numbers at random in a section [random]"
    if draws <= GROUPS:
        found = "1 draw" if draws == 1 else f"{draws} draws"
        return f"found {found}; expected {GROUPS + 1} at least: raise 'count' in the section [random]"
    return "no metric differs from draw to draw; draw numbers that matter, or raise their deviation"


def _panel(name: str, unit: str, families: Mapping[str, Sequence[ShownResult]]) -> DistributionPanel:
    values = {family: np.array([_value(of, name, unit) for of in members]) for family, members in families.items()}
    greatest = max(float(np.abs(column[np.isfinite(column)]).max(initial=0.0)) for column in values.values())
    factor, readable = _readable(unit, greatest)
    samples = []
    for family, column in values.items():
        known, members = np.isfinite(column), families[family]
        worst = members[int(np.nanargmax(np.where(known, np.abs(column), np.nan)))] if known.any() else None
        missing = None if known.all() else members[int(np.argmin(known))]
        samples.append(Sample(family, factor * np.sort(column[known]), column.size, worst, missing))
    return DistributionPanel(name, readable, tuple(samples))


def _value(of: ShownResult, name: str, unit: str) -> float:
    return next((m.value for m in of.result.metrics if (m.name, m.unit) == (name, unit)), np.nan)


def _readable(unit: str, greatest: float) -> tuple[float, str]:
    if unit == "m":
        return (1e6, "µm") if greatest < 1e-3 else (1e3, "mm") if greatest < 1 else (1.0, "m")
    return (1e3, "ms") if unit == "s" and greatest < 1 else (1.0, unit)


def draw_distribution(info: DistributionInfo) -> "Figure":
    """Draw the distribution function of each metric, and below the quantiles and the worst draws in numbers."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    count = len(info.panels)
    columns, rows = (1, 1) if count == 1 else (2, -(-count // 2))
    with canvas.styled():
        styles = dict(zip(info.families, canvas.named_styles(len(info.families)), strict=True))
        lines = [style for panel in info.panels for style in (styles[sample.label] for sample in panel.samples)]
        table = FigureTable(*_cells(info))
        width = max(9.0, table.width)
        notes = [line for text in _worst_draws(info) for line in wrap(drawable(text), int(CHARACTERS * width))]
        below = table.height + NOTE * len(notes)
        figure = canvas.new_figure(width, height=0.8 + 3.0 * rows + below)
        parts: Any = figure.subfigures(2, 1, height_ratios=(0.6 + 3.0 * rows, below))
        upper, lower = parts
        grid = upper.subplots(rows, columns, squeeze=False, sharey=True)
        for axes, panel in zip(grid.flat, info.panels, strict=False):
            _draw_panel(axes, panel, styles)
        for axes in list(grid.flat)[count:]:
            axes.set_visible(False)
        for axes in grid[:, 0]:
            axes.set_ylabel("Share of the draws [%]")
        canvas.grid(*list(grid.flat)[:count])
        upper.suptitle(canvas.heading(figure, info.title))
        of_table, of_notes = lower.subplots(2, 1, height_ratios=(table.height, max(NOTE * len(notes), 0.05)))
        table.draw(of_table, lines)
        of_notes.set_axis_off()
        text = of_notes.text(0.01, 1.0, "\n".join(notes), va="top", fontsize=9.5, transform=of_notes.transAxes)
        text.set_in_layout(False)  # it fits by its wrapping, and would narrow the table
    return figure


def _draw_panel(axes: "Axes", panel: DistributionPanel, styles: Mapping[str, dict[str, object]]) -> None:
    for level in LEVELS:
        axes.axhline(100 * level, color="0.4", linewidth=0.8, linestyle=(0, (4, 4)), zorder=2)
    for sample in panel.samples:
        if sample.worst is None:
            continue
        style = styles[sample.label]
        share = 100 * np.arange(sample.values.size + 1) / sample.count
        axes.step(np.append(sample.values[0], sample.values), share, where="post", **style)  # type: ignore[arg-type]
        x, y = sample.values[-1 if sample.values[-1] >= -sample.values[0] else 0], share[-1]
        y = y if x == sample.values[-1] else share[1]
        axes.plot(x, y, "o", color=str(style["color"]), markersize=5, zorder=4)
        axes.annotate(
            drawable(_number(sample.worst)), (x, y), xytext=(-5, -6), textcoords="offset points", ha="right", va="top",
            fontsize=9, color=str(style["color"]), bbox=BEHIND,
        )  # fmt: skip
    if all(sample.worst is None for sample in panel.samples):
        axes.text(0.5, 0.5, "no draw has a value", ha="center", color="0.3", transform=axes.transAxes, bbox=BEHIND)
        axes.set_xticks([])
    axes.set_ylim(0, 103)
    axes.set_xlabel(_named(panel))


def _named(panel: DistributionPanel) -> str:
    name = panel.metric[:1].upper() + panel.metric[1:]
    return f"{name} [{panel.unit}]" if panel.unit not in ("", "1") else name


def _number(of: ShownResult) -> str:
    return f"draw {of.drawn.number}" if of.drawn else of.label


def _cells(info: DistributionInfo) -> tuple[list[str], list[list[str]]]:
    titles = ["", "metric", "median", "95 %", "worst", "of", "sweep", "without\na value"]
    rows = [
        [
            drawable(sample.label), drawable(_named(panel)), *(_text(sample.quantile(level)) for level in LEVELS),
            *_worst(sample), _missing(sample),
        ]
        for panel in info.panels
        for sample in panel.samples
    ]  # fmt: skip
    return titles, rows


def _worst(sample: Sample) -> list[str]:
    if sample.worst is None:
        return ["none", "", ""]
    return [_text(float(max(sample.values, key=abs))), drawable(_number(sample.worst)), sample.worst.key[4:12]]


def _missing(sample: Sample) -> str:
    count = sample.count - sample.values.size
    return f"{count}, first {_number(sample.missing)}" if sample.missing else str(count)


def _text(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "none"


def _worst_draws(info: DistributionInfo) -> list[str]:
    """Return a line for each draw that is the worst in something: what was drawn."""
    return [f"draw {number}: {values}" for number, values in sorted(set(_drawn(info)))]


def _drawn(info: DistributionInfo) -> Iterator[tuple[int, str]]:
    for panel in info.panels:
        for sample in panel.samples:
            if sample.worst and sample.worst.drawn:
                yield sample.worst.drawn.number, sample.worst.drawn.values
