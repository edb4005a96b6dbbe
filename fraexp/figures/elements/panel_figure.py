"""Figures of panels: what they show is described once, for files and for the terminal, and drawn in one way."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fraexp.figures.elements import canvas
from fraexp.figures.elements.canvas import LineStyle
from fraexp.figures.elements.facets import facet_panels, group_styles
from fraexp.figures.elements.frequency_lines import GroupedLine, add_band_legend, draw_grouped_lines, frequency_span
from fraexp.figures.elements.grouping import CurvePlace
from fraexp.figures.elements.labels import drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, MARGIN, FACET_MARGIN, FACET_SHARE = 9.0, 1.8, 0.9, 0.8
"""Width of a figure, its height beside the panels, that of a facet [inch], and the height of a panel in a facet."""
MARK_STYLE: LineStyle = {"color": "0.4", "linewidth": 0.9, "zorder": 1.5}
"""Style of a mark without a name."""


@dataclass(frozen=True)
class Panel:
    """Lines with one ordinate."""

    ordinate: str
    """Its name and unit."""
    unit: str
    lines: tuple[GroupedLine, ...]
    is_log: bool = False
    """Whether the axis is logarithmic; those of one family and unit are shared."""
    linear_range: float | None = None
    """Error up to which an axis of errors is linear, with decades of both signs beyond; None for another axis."""
    span: tuple[float, float] | None = None
    """Limits of the axis; None for those of the lines."""
    marks: tuple[float, ...] = ()
    """Values at which a horizontal line is drawn."""
    mark_name: str = ""
    """Name of the marks in the legend; empty for none."""
    height: float = 2.4
    """Height in a figure [inch]."""

    @property
    def title(self) -> str:
        """Title of the axis, which declares a scale that is not linear all over."""
        if self.linear_range is None:
            return drawable(self.ordinate)
        return f"{drawable(self.ordinate)}\n(logarithmic beyond ±{self.linear_range:g} {self.unit})"


@dataclass(frozen=True)
class PanelFamily:
    """Panels with one abscissa, below each other."""

    abscissa: str
    """Its name and unit."""
    panels: tuple[Panel, ...]
    name: str = ""
    """Name of its curves; empty if they have different names, which the legend shows, or the title says it."""
    is_log: bool = False
    """Whether the abscissa is logarithmic."""
    span: tuple[float, float] | None = None
    """Limits of the abscissa, which a logarithmic one must have; None for those of the lines."""

    @property
    def unit(self) -> str:
        """Unit of the abscissa."""
        return self.abscissa.rpartition("[")[2].rstrip("]")


@dataclass(frozen=True)
class PanelFigure:
    """Contents of a figure: families of panels."""

    families: tuple[PanelFamily, ...]
    title: str
    is_loop: bool = False
    """Whether lines are loops, along which x comes back."""

    @property
    def panels(self) -> list[Panel]:
        """All panels."""
        return [panel for family in self.families for panel in family.panels]

    @property
    def places(self) -> list[CurvePlace]:
        """Where each line of each panel belongs."""
        return [line.place for panel in self.panels for line in panel.lines]


def over_frequency(title: str, *panels: Panel) -> PanelFigure:
    """Return a figure of panels over frequency."""
    span = frequency_span([line for panel in panels for line in panel.lines])
    return PanelFigure((PanelFamily("Frequency [Hz]", panels, is_log=True, span=span),), title)


def draw_panels(info: PanelFigure) -> "Figure":
    """Draw a panel for each ordinate over the abscissa of its family; families follow below each other."""
    places, heights = info.places, [panel.height for panel in info.panels]
    below, beside = _shared_axes(info.families)
    is_named = any(family.name not in ("", info.title) for family in info.families)
    with canvas.figure_style():
        size, facet_height = (WIDTH, MARGIN + sum(heights)), FACET_MARGIN + FACET_SHARE * sum(heights)
        names = list(dict.fromkeys(place.facet for place in places))
        panels = facet_panels(names, size, heights, facet_height, below=below, beside=beside)
        styles = group_styles(places, is_ordered=all(family.name for family in info.families))
        for name, facet in panels.facets.items():
            for axes, panel in zip(facet, info.panels, strict=True):
                draw_panel(axes, panel, [line for line in panel.lines if line.place.facet == name], styles)
            for family, first in zip(info.families, dict.fromkeys(below), strict=True):
                _set_abscissa(facet[first : first + len(family.panels)], family, is_named and len(panels.facets) == 1)
        for axes, panel in zip(panels.first, info.panels, strict=True):
            if panel.is_log:
                canvas.set_decade_ticks(axes)
        add_band_legend(panels.first[0], [line for panel in info.panels for line in panel.lines])
        x_titles = [drawable(info.families[0].abscissa)] if len(info.families) == 1 else []
        y_titles = [panel.title for panel in info.panels]
        return panels.finish(info.title, x_titles, y_titles, places, above=is_named or len(info.families) > 1)


def draw_panel(axes: "Axes", panel: Panel, lines: Sequence[GroupedLine], styles: Mapping[str, LineStyle]) -> None:
    """Draw lines of a panel on its scale, in the styles of their groups, with its marks."""
    if panel.linear_range is not None:
        canvas.set_error_axis(axes, panel.linear_range)
    elif panel.is_log:
        axes.set_yscale("log")
    style = canvas.REFERENCE_STYLE if panel.mark_name else MARK_STYLE
    for mark in panel.marks:
        axes.axhline(mark, **style)
    draw_grouped_lines(axes, lines, styles)
    if panel.mark_name:
        axes.plot([], [], label=panel.mark_name, **style)
    if panel.span:
        axes.set_ylim(*panel.span)


def _shared_axes(families: Sequence[PanelFamily]) -> tuple[list[int], list[int]]:
    """Return, for each panel, the index of that whose abscissa it shares, and whose ordinate."""
    below: list[int] = []
    beside: list[int] = []
    for family in families:
        first, units = len(below), [panel.unit if panel.is_log else None for panel in family.panels]
        below += [first] * len(units)
        beside += [first + (at if unit is None else units.index(unit)) for at, unit in enumerate(units)]
    return below, beside


def _set_abscissa(axes: Sequence["Axes"], family: PanelFamily, is_named: bool) -> None:
    """Set scale, limits and titles of the abscissa of a family's panels."""
    for of in axes:
        of.tick_params(labelbottom=of is axes[-1])
    if family.span:
        canvas.set_log_abscissa(axes[-1], family.span) if family.is_log else axes[-1].set_xlim(*family.span)
    axes[-1].set_xlabel(drawable(family.abscissa))
    if is_named:
        axes[0].set_title(drawable(family.name), loc="left", fontsize=11)
