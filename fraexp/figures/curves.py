"""Any other curves: their columns over the first one, a panel each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.figures.labels import drawable
from fraexp.results import Curve

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class CurvesInfo:
    """What a figure of curves shows."""

    labels: tuple[str, ...]
    abscissa: str
    """Name and unit of the common abscissa."""
    ordinates: tuple[str, ...]
    """Name and unit of each panel's ordinate."""
    values: tuple[tuple[np.ndarray, ...], ...]
    """For each label the abscissa and the ordinates, each of shape (n,)."""
    title: str


def curves_info(curves: Sequence[tuple[str, Curve]], title: str = "") -> CurvesInfo:
    """Return the numbers of labelled curves that have the same columns as the first one."""
    name, first = curves[0][1].name, curves[0][1]
    alike = [(label, curve) for label, curve in curves if list(curve.columns) == list(first.columns)]
    abscissa, *ordinates = (f"{column.capitalize()} [{first.units[column]}]" for column in first.columns)
    values = tuple(tuple(curve.columns.values()) for _, curve in alike)
    return CurvesInfo(
        tuple(label for label, _ in alike), abscissa, tuple(ordinates), values, title or name.capitalize()
    )


def draw_curves(info: CurvesInfo) -> "Figure":
    """Draw a panel for each ordinate over the common abscissa."""
    from fraexp.figures import canvas  # matplotlib: imported only when something is drawn

    with canvas.styled():
        count = len(info.ordinates)
        figure = canvas.new_figure(width=9.0, height=2.2 + 2.4 * count)
        panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        styles = canvas.line_styles(len(info.labels))
        for row, (axes, ordinate) in enumerate(zip(panels, info.ordinates, strict=True), start=1):
            for label, values, style in zip(info.labels, info.values, styles, strict=True):
                named = drawable(label) if row == 1 else None
                axes.plot(values[0], values[row], label=named, **style)
            axes.set_ylabel(ordinate)
        panels[-1].set_xlabel(info.abscissa)
        panels[0].set_title(drawable(info.title))
        canvas.grid(*panels)
        canvas.legend_below(figure, *panels)
    return figure
