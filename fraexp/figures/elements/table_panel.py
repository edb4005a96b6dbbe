"""A table below the panels of a figure, whose first column is also the legend."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.figures.elements.canvas import LineStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINE_SAMPLE_HALF_WIDTH = 3
"""Half of the width of a line sample [characters]."""


@dataclass(frozen=True)
class FigureTable:
    """Titles, which may have several lines, and rows of cells."""

    titles: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def widths(self) -> list[int]:
        """Width of each column [characters]."""
        columns = zip(self.titles, zip(*self.rows, strict=True), strict=True)
        return [max(map(len, [*title.splitlines(), *column])) + 3 for title, column in columns]

    @property
    def width(self) -> float:
        """Size that the table needs [inch]."""
        return 0.083 * sum(self.widths)

    @property
    def height(self) -> float:
        """Size that the table needs [inch]."""
        return 0.24 * (len(self.rows) + 2.5)

    def draw(self, axes: "Axes", styles: Sequence[LineStyle]) -> None:
        """Draw the table; its first column is the legend, each name beside a sample of its line."""
        axes.set_axis_off()
        widths = self.widths
        axes.set_xlim(0, sum(widths) + 2 * LINE_SAMPLE_HALF_WIDTH)
        axes.set_ylim(len(self.rows) + 0.7, -1.2)
        edges = np.cumsum([2 * LINE_SAMPLE_HALF_WIDTH, *widths])
        for row, cells in enumerate([self.titles, *self.rows]):
            style: LineStyle = {"fontsize": 9.5, "fontweight": "normal" if row else "bold"}
            place, vertical = (row, "center") if row else (0.4, "bottom")
            axes.text(edges[0], place, cells[0], ha="left", va=vertical, **style)
            for right, cell in zip(edges[2:], cells[1:], strict=True):
                axes.text(right, place, cell, ha="right", va=vertical, **style)
        for row, drawn in enumerate(styles, start=1):
            axes.plot([0.5, 2 * LINE_SAMPLE_HALF_WIDTH - 1], [row, row], **drawn)
        axes.axhline(0.5, color="0.6", linewidth=0.8)
