"""Distribution of metrics over Monte Carlo samples, with the levels of median and 95 %."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import EFFORT
from fraexp.errors import FraexpError
from fraexp.figures.elements.frequency_lines import GroupedLine
from fraexp.figures.elements.grouping import CurvePlace, ShownResult
from fraexp.figures.elements.labels import MAX_GROUPS
from fraexp.figures.elements.panel_figure import Panel, PanelFamily, PanelFigure
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS

MAX_METRICS = 4
"""Maximum number of metrics in a figure."""
MARKED_SHARES = (50.0, 95.0)
"""Shares of the draws [%] that are marked."""


def distribution_info(shown: Sequence[ShownResult], title: str = "") -> PanelFigure:
    """Return the distribution functions of the first `MAX_METRICS` metrics that vary between draws."""
    families: dict[str, list[ShownResult]] = {}
    for of in shown:
        families.setdefault(of.drawn.family if of.drawn else of.place.point if of.place else "", []).append(of)
    if len(families) > MAX_GROUPS:
        raise FraexpError(
            f"distribution: found {len(families)} cases; no more than {MAX_GROUPS} can be distinguished; choose fewer"
        )
    metrics = tuple(_distributions(name, unit, families) for name, unit in _varying_metrics(shown))
    if not metrics:
        raise FraexpError(f"distribution: {_empty_reason(shown)}")
    return PanelFigure(metrics, title or "Distribution over random draws")


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


def _distributions(name: str, unit: str, families: Mapping[str, Sequence[ShownResult]]) -> PanelFamily:
    """Return the distribution functions of a metric, one for each family of draws."""
    values = {family: np.array([_value(of, name, unit) for of in members]) for family, members in families.items()}
    greatest = max(float(np.abs(column[np.isfinite(column)]).max(initial=0.0)) for column in values.values())
    factor, readable = _readable_unit(unit, greatest)
    lines = tuple(_distribution(family, factor * column) for family, column in values.items())
    panel = Panel("Share of the draws [%]", "%", lines, span=(0.0, 103.0), marks=MARKED_SHARES, height=2.0)
    title = name[:1].upper() + name[1:]
    return PanelFamily(f"{title} [{readable}]" if readable not in ("", "1") else title, (panel,))


def _distribution(family: str, values: NDArray[np.float64]) -> GroupedLine:
    """Return a distribution function in steps, which stays below 100 % if draws lack a value, shape (n,) with NaN."""
    known = np.sort(values[np.isfinite(values)])
    share = 100 * np.arange(known.size + 1) / values.size
    return GroupedLine(family, CurvePlace(group=family, point=family), np.repeat(known, 2), np.repeat(share, 2)[1:-1])


def _value(of: ShownResult, name: str, unit: str) -> float:
    return next((m.value for m in of.result.metrics if (m.name, m.unit) == (name, unit)), np.nan)


def _readable_unit(unit: str, greatest: float) -> tuple[float, str]:
    if unit in DISPLACEMENT_UNITS:
        return (1e6, f"µ{unit}") if greatest < 1e-3 else (1e3, f"m{unit}") if greatest < 1 else (1.0, unit)
    return (1e3, "ms") if unit == "s" and greatest < 1 else (1.0, unit)
