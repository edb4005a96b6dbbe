"""Lines in the colours of their groups: one for each point of the grid, or one band where random draws share it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.figures.elements.bands import DrawnBand, draw_bands
from fraexp.figures.elements.bundles import Bundle, add_quantile_legend, draw_bundles, stack_padded
from fraexp.figures.elements.facets import is_explained
from fraexp.figures.elements.frequency_lines import draw_line, with_gaps
from fraexp.figures.elements.grouping import CurvePlace, point_indices
from fraexp.figures.elements.line_style import LineStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class GroupedLine:
    """A line as it is drawn."""

    name: str
    """Name in the legend; empty for none."""
    place: CurvePlace
    """Where it belongs; lines with the same point are a sample."""
    x: NDArray[np.float64]
    """Shape (n,)."""
    y: NDArray[np.float64]
    """Shape (n,); NaN leaves a gap."""
    settled: NDArray[np.bool_] | None = None
    """Whether the point had settled, shape (n,); the others are hollow. None for all."""
    band: NDArray[np.float64] | None = None
    """Lower and upper 95 % limit, shape (2, n); None if they are unknown."""

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Whether the line goes through each point, shape (n,)."""
        return np.ones(len(self.x), dtype=bool) if self.settled is None else self.settled


def draw_grouped_lines(
    axes: "Axes", lines: Sequence[GroupedLine], styles: Mapping[str, LineStyle], opacity: float | None = None
) -> None:
    """Draw lines in the styles of their groups, and samples as bundles; `opacity` is that of 95 % bands.

    Lines of a scale of amounts, and those that are named by the title of their panel, have no legend entries.
    """
    points = [[lines[index] for index in of] for of in point_indices([line.place for line in lines]).values()]
    bundles = [_bundle(of) for of in points if len(of) > 1]
    explained = is_explained([line.place for line in lines])
    colours = {name: str(style["color"]) for name, style in styles.items()}
    draw_bundles(axes, bundles, any(line.name for line in lines) and not explained, colours)
    if explained and any(of.quantiles is not None for of in bundles):
        add_quantile_legend(axes)
    singles = [of[0] for of in points if len(of) == 1]
    for line in singles:
        name = "" if explained else line.place.group or line.name
        draw_line(axes, line.x, line.y, line.usable, name if line.name else "", styles[line.place.group])
    bands = [
        DrawnBand(of.x, of.y, with_gaps(of.band, of.usable), colours[of.place.group])
        for of in singles
        if of.band is not None
    ]
    draw_bands(axes, bands, **({} if opacity is None else {"opacity": opacity}))


def _bundle(sample: Sequence[GroupedLine]) -> Bundle:
    place = sample[0].place
    y = [with_gaps(of.y, of.usable) for of in sample]
    return Bundle(place.group, stack_padded([of.x for of in sample]), stack_padded(y), place.sample)
