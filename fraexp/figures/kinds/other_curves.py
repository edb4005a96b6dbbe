"""Any other curves: their columns over the first one, a panel each; curves of other columns below them.

A column ``model`` is drawn as a line through the points of the first ordinate, ``lower 95 %`` and ``upper 95 %`` as
its band.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MANY, Bundle, draw_bundles, split, stacked
from fraexp.figures.elements.frequency_lines import (
    LIMITS,
    draw_bands,
    draw_fitted,
    draw_line,
    limits_of,
    name_band,
    name_fitted,
    name_model,
)
from fraexp.figures.elements.labels import drawable
from fraexp.figures.elements.scales import length_unit, readable_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MODEL = "model"
DECADES = 10.0
"""Greatest over least value over frequency from which an axis is logarithmic."""
ANGLES = ("deg", "rad")
Labelled = tuple[str, Curve, str]
"""Label, curve and group."""


class ShownUnit(NamedTuple):
    """The unit in which a column is drawn."""

    factor: float
    """From the stored unit to it."""
    name: str
    stored: str
    """Name of the stored unit."""


@dataclass(frozen=True)
class CurveTrace:
    """One column of one curve in the numbers that are drawn."""

    name: str
    group: str
    """Name of the group that it is drawn in if there are many; empty if there is one group."""
    x: np.ndarray
    """Shape (n,)."""
    y: np.ndarray
    """Shape (n,); NaN leaves a gap."""
    model: np.ndarray | None
    """What a model makes of it, shape (n,); None if there is none."""
    limits: np.ndarray | None
    """Lower and upper 95 % limit, shape (2, n); None if they are not known."""


@dataclass(frozen=True)
class CurvePanel:
    """One ordinate."""

    ordinate: str
    """Its name and unit."""
    unit: str
    decades: str
    """Unit whose logarithmic axis it shares with other panels of its family; empty for a linear axis."""
    traces: tuple[CurveTrace, ...]


@dataclass(frozen=True)
class Family:
    """Curves with the same name, or with the same columns: a panel for each ordinate."""

    name: str
    """Name of its curves; empty if each has its own, which is in the legend then."""
    abscissa: str
    """Name and unit of the common abscissa."""
    frequency: tuple[float, float] | None
    """Least and greatest frequency; None if the abscissa is another quantity."""
    panels: tuple[CurvePanel, ...]


@dataclass(frozen=True)
class CurvesInfo:
    """What a figure of curves shows."""

    families: tuple[Family, ...]
    title: str


def curves_info(curves: Sequence[tuple[str, Curve]], title: str = "", groups: Sequence[str] = ()) -> CurvesInfo:
    """Return the numbers of labelled curves, by their names and columns.

    More than `MANY` curves of a family are told apart by the names of their `groups` alone; without names they are one
    group.
    """
    found: list[list[Labelled]] = []
    for (label, curve), group in zip(curves, groups or [""] * len(curves), strict=True):
        if len(curve.columns) < 2:  # nothing over nothing
            continue
        family = next((of for of in found if _alike(of[0][1], curve)), None)
        if family is None:
            found.append(family := [])
        family.append((label, curve, group))
    if not found:
        raise FraexpError("curves figure: there is no curve to draw; choose sweeps that have one")
    several = len({label for label, _ in curves}) > 1
    families = tuple(_family(alike, several) for alike in found)
    return CurvesInfo(families, title or (families[0].name if len(families) == 1 else "") or "Curves")


def _alike(one: Curve, other: Curve) -> bool:
    """Say whether two curves share their panels."""
    shared = [name for name in one.columns if name in other.columns]
    same = one.name == other.name or list(one.columns) == list(other.columns)
    abscissa = next(iter(one.columns)) == next(iter(other.columns))
    return same and abscissa and all(one.units[name] == other.units[name] for name in shared)


def _family(alike: Sequence[Labelled], several: bool) -> Family:
    names = list(dict.fromkeys(curve.name for _, curve, _ in alike))
    if len(names) > 1:
        alike = [
            (_told(label, curve, several), curve, _told(group, curve, bool(group))) for label, curve, group in alike
        ]
    abscissa, *others = dict.fromkeys(name for _, curve, _ in alike for name in curve.columns)
    ordinates = others[:1] + [name for name in others[1:] if name not in (MODEL, *LIMITS)]
    x = np.concatenate([curve.columns[abscissa] for _, curve, _ in alike])
    units = _units(alike, (abscissa,)) | _units(alike, ordinates)
    spectral = units[abscissa].name == "Hz" and x.size > 0 and bool((x > 0).all())
    panels = [_panel(alike, abscissa, name, units, name == others[0]) for name in ordinates]
    return Family(
        _title(names[0]) if len(names) == 1 else "",
        _axis(abscissa, units),
        (float(x.min()), float(x.max())) if spectral else None,
        tuple(_in_decades(panels) if spectral else panels),
    )


def _told(name: str, curve: Curve, also: bool) -> str:
    """Return a curve's own name, after another one where that tells something."""
    return f"{name}, {curve.name}" if also else curve.name


def _units(alike: Sequence[Labelled], columns: Sequence[str]) -> dict[str, ShownUnit]:
    """Return the units in which columns are shown; lengths in one that suits the greatest of them."""
    stored = {name: unit for _, curve, _ in alike for name, unit in curve.units.items() if name in columns}
    lengths = [curve.columns[name] for _, curve, _ in alike for name in columns if curve.units.get(name) == "m"]
    known = np.abs(np.concatenate([[0.0], *lengths]))
    length = length_unit(float(known[np.isfinite(known)].max()))
    return {name: ShownUnit(*(length if unit == "m" else readable_unit(unit)), unit) for name, unit in stored.items()}


def _panel(
    alike: Sequence[Labelled], abscissa: str, ordinate: str, units: Mapping[str, ShownUnit], first: bool
) -> CurvePanel:
    having = [(label, curve, group) for label, curve, group in alike if ordinate in curve.columns]
    shown = {name: units[name] for name in (abscissa, ordinate)}
    traces = tuple(_trace(label, curve, group, shown, first) for label, curve, group in having)
    return CurvePanel(_axis(ordinate, units), units[ordinate].stored, "", traces)


def _in_decades(panels: Sequence[CurvePanel]) -> list[CurvePanel]:
    """Return panels over frequency: amplitudes in one unit share a logarithmic axis where they span decades."""
    sizes = {panel.ordinate: _sizes(panel) for panel in panels}
    found = []
    for panel in panels:
        alike = [sizes[of.ordinate] for of in panels if of.unit == panel.unit and sizes[of.ordinate].size]
        wide = sizes[panel.ordinate].size and np.ptp(np.log(np.concatenate(alike))) >= np.log(DECADES)
        found.append(replace(panel, decades=panel.unit) if wide else panel)
    return found


def _sizes(panel: CurvePanel) -> np.ndarray:
    """Return its values if they are sizes, all above 0; nothing otherwise."""
    known = np.concatenate([trace.y[np.isfinite(trace.y)] for trace in panel.traces])
    limited = any(trace.limits is not None for trace in panel.traces)
    sizes = panel.unit not in ANGLES and not limited and bool((known > 0).all())
    return known if sizes else np.empty(0)


def _trace(label: str, curve: Curve, group: str, shown: Mapping[str, ShownUnit], first: bool) -> CurveTrace:
    """Return a column over the abscissa, the first of the two; with model and limits if it is the first ordinate."""
    x, y = (unit.factor * curve.columns[name] for name, unit in shown.items())
    factor, model, limits = list(shown.values())[1].factor, curve.columns.get(MODEL), limits_of(curve)
    return CurveTrace(
        label,
        group,
        x,
        y,
        factor * model if first and model is not None else None,
        factor * limits if first and limits is not None else None,
    )


def _axis(name: str, units: Mapping[str, ShownUnit]) -> str:
    return f"{_title(name)} [{units[name].name}]"


def _title(name: str) -> str:
    return name[:1].upper() + name[1:]


def draw_curves(info: CurvesInfo) -> "Figure":
    """Draw a panel for each ordinate over the abscissa of its family, one family below the other."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    with canvas.styled():
        count = sum(len(family.panels) for family in info.families)
        figure = canvas.new_figure(width=9.0, height=1.8 + 2.4 * count + 0.4 * len(info.families))
        panels = list(figure.subplots(count, 1, squeeze=False)[:, 0])
        styles, rest = _styles(info), panels
        for family in info.families:
            mine, rest = rest[: len(family.panels)], rest[len(family.panels) :]
            _draw_family(mine, family, styles)
            if family.name and family.name != info.title:
                mine[0].set_title(drawable(family.name), loc="left", fontsize=11)
        figure.suptitle(canvas.heading(figure, info.title), fontsize=12.5)
        canvas.grid(*panels)
        figure.align_ylabels(panels)
        _name(panels[0], info, styles)
        canvas.legend_below(figure, *panels)
    return figure


def _traces(info: CurvesInfo, many: bool) -> list[CurveTrace]:
    """Return what is drawn in families of many, or of few curves."""
    panels = [panel for family in info.families for panel in family.panels]
    return [trace for panel in panels if (len(panel.traces) > MANY) == many for trace in panel.traces]


def _styles(info: CurvesInfo) -> dict[str, dict[str, Any]]:
    """Return the style of each name: the same one in all panels."""
    from fraexp.figures.elements import canvas

    names = list(dict.fromkeys(trace.name for trace in _traces(info, many=False)))
    ordered = all(family.name for family in info.families)  # sweeps of a grid, not curves with names of their own
    of = canvas.line_styles if ordered or len(names) <= len(canvas.OKABE_ITO) else canvas.named_styles
    return dict(zip(names, of(len(names)), strict=True))


def _draw_family(axes: Sequence["Axes"], family: Family, styles: dict[str, dict[str, Any]]) -> None:
    from fraexp.figures.elements import canvas

    shared: dict[str, Axes] = {}
    for index, (of, panel) in enumerate(zip(axes, family.panels, strict=True)):
        if index:
            of.sharex(axes[0])
        of.tick_params(labelbottom=of is axes[-1])
        if panel.decades in shared:
            of.sharey(shared[panel.decades])
        elif panel.decades:
            of.set_yscale("log")
            shared[panel.decades] = of
        if len(panel.traces) > MANY:
            draw_bundles(of, _bundles(panel), named=index == 0)
        else:
            _draw_traces(of, panel, styles)
        of.set_ylabel(drawable(panel.ordinate))
    for of in shared.values():
        canvas.decade_axis(of)
    if family.frequency:
        canvas.frequency_axis(axes[-1], family.frequency)
    axes[-1].set_xlabel(drawable(family.abscissa))


def _draw_traces(axes: "Axes", panel: CurvePanel, styles: dict[str, dict[str, Any]]) -> None:
    for trace in panel.traces:
        known, style = np.isfinite(trace.y), styles[trace.name]
        if trace.model is None:
            draw_line(axes, trace.x, trace.y, known, "", style)
        else:
            draw_fitted(axes, (trace.x, trace.y), known, (trace.x, trace.model), style)
    bands = [(of.x, of.limits, styles[of.name]["color"]) for of in panel.traces if of.limits is not None]
    draw_bands(axes, bands)


def _name(axes: "Axes", info: CurvesInfo, styles: dict[str, dict[str, Any]]) -> None:
    """Add to the legend what is drawn one by one: each name once, however many panels it is in."""
    traces = _traces(info, many=False)
    lines = {trace.name for trace in traces if trace.model is None}
    for name, style in styles.items():
        if name in lines:
            axes.plot([], [], label=drawable(name), **style)
        else:
            name_fitted(axes, name, style)
    if any(trace.model is not None for trace in traces):
        name_model(axes, "model")
    if any(trace.limits is not None for trace in traces):
        name_band(axes)


def _bundles(panel: CurvePanel) -> list[Bundle]:
    return [
        Bundle(name, *(stacked([getattr(panel.traces[index], part) for index in indices]) for part in ("x", "y")))
        for name, indices in split([trace.group for trace in panel.traces]).items()
    ]
