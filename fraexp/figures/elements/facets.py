"""Facets: panels of a figure that share axes, colours and one legend; the same for all kinds of figure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.bands import MAX_SINGLE_CURVES
from fraexp.figures.elements.canvas import LineStyle, add_amount_scale, amount_colours
from fraexp.figures.elements.grouping import MAX_FACETS, CurvePlace, facet_indices
from fraexp.figures.elements.labels import drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Member = TypeVar("Member")
MAX_COLUMNS = 3
"""Maximum number of facets side by side."""
FACET_WIDTH, FACET_MARGIN = 3.7, 1.4
"""Width of a facet, and what a figure needs beside its facets [inch]."""
FACET_FONT_SIZE, MAX_FACET_TICKS = 9.5, 5
"""Size of the titles of axes [pt], and maximum number of steps between ticks, of a facet."""


def panel_places(places: Sequence[CurvePlace], kind: str) -> list[CurvePlace]:
    """Return places for a kind of figure that has no map: names that would be rows get a panel each, or share one.

    They share one if they are too many for panels, but not for lines. Amounts that would be rows keep theirs, which
    sets the colour. FraexpError if there are too many curves.
    """
    if any(of.is_mapped and not of.axis for of in places):
        is_shared = MAX_FACETS < len({of.group for of in places}) <= MAX_SINGLE_CURVES
        places = [of._replace(facet="" if is_shared else of.group, row=np.nan) for of in places]
    facets = facet_indices(places)
    groups = max(
        (len({places[at].group for at in of if not places[at].is_mapped}) for of in facets.values()), default=0
    )
    for count, most, noun in ((len(facets), MAX_FACETS, "panels"), (groups, MAX_SINGLE_CURVES, "groups of curves")):
        if count > most:
            remedy = "choose fewer sweeps, or merge groups with --group-by"
            raise FraexpError(f"{kind}: found {count} {noun}; no more than {most} can be distinguished; {remedy}")
    return list(places)


def group_styles(places: Sequence[CurvePlace], is_ordered: bool = True) -> dict[str, LineStyle]:
    """Return the line style of each group, which all facets share; amounts of many values are a scale of colours.

    Groups that are not ordered, such as curves with other names, do not become a scale however many they are.
    """
    names = list(dict.fromkeys(of.group for of in places))
    if any(of.is_mapped for of in places):
        colours = amount_colours([of.row for of in places])
        pairs = zip(places, colours, strict=True)
        return {
            of.group: {"color": colour, "linestyle": "solid", "linewidth": 1.5, "zorder": 3} for of, colour in pairs
        }
    if all(of.group == of.facet for of in places):
        return dict.fromkeys(names, canvas.line_styles(1)[0])
    is_scale = is_ordered or len(names) <= len(canvas.OKABE_ITO)
    return dict(zip(names, (canvas.line_styles if is_scale else canvas.named_styles)(len(names)), strict=True))


def is_explained(places: Sequence[CurvePlace]) -> bool:
    """Return whether colours need no legend: a scale of amounts, or the titles of the panels, explain them."""
    return all(of.is_mapped or of.group == of.facet != "" for of in places)


@dataclass(frozen=True)
class FacetPanels:
    """The panels of a figure: for each facet, by its name, one below the other."""

    figure: "Figure"
    facets: dict[str, list["Axes"]]
    columns: int
    is_shared: bool
    """Whether the facets share their axes, which then have titles at the outer panels only."""

    def label(self, title: str, x_titles: Sequence[str], y_titles: Sequence[str], above: bool = False) -> None:
        """Write the titles of figure, facets and axes: one below for each facet, and one beside for each panel in it.

        Without `x_titles` those below stay as they are. The title of the figure is `above` that of its only facet.
        """
        count = len(self.facets)
        for index, (name, panels) in enumerate(self.facets.items()):
            is_first = not self.is_shared or index % self.columns == 0
            is_last = not self.is_shared or index + self.columns >= count
            for axes, y_title in zip(panels, y_titles, strict=True):
                axes.set_ylabel(y_title if is_first else "")
                axes.tick_params(labelleft=is_first)
            for axes in panels if x_titles else ():
                axes.tick_params(labelbottom=is_last and axes is panels[-1])
                axes.set_xlabel(x_titles[index % len(x_titles)] if is_last and axes is panels[-1] else "")
            if count > 1:
                panels[0].set_title(drawable(name), fontsize=11, loc="left")
                _thin_out(panels)
        text = canvas.wrapped_title(self.figure, title)
        if count == 1 and not above:
            self.first[0].set_title(text)
        else:
            self.figure.suptitle(text, fontsize=12.5)
        self.figure.align_ylabels(self.all)

    @property
    def first(self) -> list["Axes"]:
        """The panels of the first facet, whose axes the others share."""
        return next(iter(self.facets.values()))

    @property
    def all(self) -> list["Axes"]:
        """All panels."""
        return [axes for panels in self.facets.values() for axes in panels]

    def finish(
        self,
        title: str,
        x_titles: Sequence[str],
        y_titles: Sequence[str],
        places: Sequence[CurvePlace],
        above: bool = False,
    ) -> "Figure":
        """Return the figure with a grid, its titles (see `label`), and a legend of the curves at these places."""
        canvas.draw_grid(*self.all)
        self.label(title, x_titles, y_titles, above)
        self.add_legend(places)
        return self.figure

    def add_legend(self, places: Sequence[CurvePlace]) -> None:
        """Add the legend below, or the scale of colours of amounts at the right."""
        axis = next((of.axis for of in places if of.is_mapped), "")
        if axis:
            add_amount_scale(self.figure, self.all, [of.row for of in places], axis)
        canvas.add_legend_below(self.figure, *self.all)


def _thin_out(panels: Sequence["Axes"]) -> None:
    """Make the texts of narrow panels smaller and fewer."""
    from matplotlib.ticker import MaxNLocator

    for axes in panels:
        axes.yaxis.label.set_fontsize(FACET_FONT_SIZE)
        if axes.get_xscale() == "linear":
            axes.xaxis.set_major_locator(MaxNLocator(MAX_FACET_TICKS))


def facet_panels(
    names: Sequence[str],
    size: tuple[float, float],
    heights: Sequence[float] = (1.0,),
    facet_height: float = 3.7,
    is_shared: bool = True,
    below: Sequence[int] = (),
    beside: Sequence[int] = (),
) -> FacetPanels:
    """Return empty panels for facets by name, in each one below the other with relative `heights`.

    `size` is that of the figure with one facet [inch], `facet_height` that of each row of facets. If the axes are
    shared, all facets share theirs. `below` and `beside` are, for each panel of a facet, the index of that whose axis
    it shares, by default the first and itself.
    """
    count, parts = len(names), len(heights)
    columns = 2 if count == 4 else min(count, MAX_COLUMNS)
    rows = -(-count // columns)
    if count > 1:
        size = (FACET_MARGIN + FACET_WIDTH * columns, FACET_MARGIN + facet_height * rows)
    figure = canvas.new_figure(*size)
    grid = figure.subplots(parts * rows, columns, squeeze=False, height_ratios=tuple(heights) * rows)
    panels = [
        [grid[parts * (n // columns) + part, n % columns] for part in range(parts)] for n in range(rows * columns)
    ]
    for axes in (axes for of in panels[count:] for axes in of):
        axes.remove()
    for of in panels[:count]:
        source = panels[0] if is_shared else of
        for part, axes in enumerate(of):
            _share(axes, source[beside[part] if beside else part], source[below[part] if below else 0])
    return FacetPanels(figure, dict(zip(names, panels[:count], strict=True)), columns, is_shared)


def _share(axes: "Axes", beside: "Axes", below: "Axes") -> None:
    if axes is not beside:
        axes.sharey(beside)
    if axes is not below:
        axes.sharex(below)


def by_facet(members: Sequence[Member], places: Sequence[CurvePlace]) -> dict[str, list[Member]]:
    """Return the members of each facet, by its name."""
    return {name: [members[index] for index in of] for name, of in facet_indices(places).items()}
