"""Any other curves: their columns over the first one, a panel each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fraexp.errors import FraexpError
from fraexp.figures.bundles import MANY, Bundle, draw_bundles, split, stacked
from fraexp.figures.labels import drawable
from fraexp.results import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class CurvesInfo:
    """What a figure of curves shows."""

    labels: tuple[str, ...]
    groups: tuple[str, ...]
    """For each label the name of the group that it is drawn in if there are many; empty if there is one group."""
    abscissa: str
    """Name and unit of the common abscissa."""
    ordinates: tuple[str, ...]
    """Name and unit of each panel's ordinate."""
    values: tuple[tuple[np.ndarray, ...], ...]
    """For each label the abscissa and the ordinates, each of shape (n,)."""
    title: str


def curves_info(curves: Sequence[tuple[str, Curve]], title: str = "", groups: Sequence[str] = ()) -> CurvesInfo:
    """Return the numbers of labelled curves that have the same columns as the first one.

    More than `MANY` curves are told apart by the names of their `groups` alone; without names they are one group.
    """
    if not curves:
        raise FraexpError("curves figure: there is no curve to draw; choose sweeps that have one")
    name, first = curves[0][1].name, curves[0][1]
    alike = [
        (label, curve, group)
        for (label, curve), group in zip(curves, groups or [""] * len(curves), strict=True)
        if list(curve.columns) == list(first.columns)
    ]
    abscissa, *ordinates = (f"{column.capitalize()} [{first.units[column]}]" for column in first.columns)
    values = tuple(tuple(curve.columns.values()) for _, curve, _ in alike)
    labels, names = tuple(label for label, _, _ in alike), tuple(group for _, _, group in alike)
    return CurvesInfo(labels, names, abscissa, tuple(ordinates), values, title or name.capitalize())


def draw_curves(info: CurvesInfo) -> "Figure":
    """Draw a panel for each ordinate over the common abscissa."""
    from fraexp.figures import canvas  # matplotlib: imported only when something is drawn

    with canvas.styled():
        count = len(info.ordinates)
        figure = canvas.new_figure(width=9.0, height=2.2 + 2.4 * count)
        panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        styles = canvas.line_styles(len(info.labels))
        for row, (axes, ordinate) in enumerate(zip(panels, info.ordinates, strict=True), start=1):
            if len(info.labels) > MANY:
                draw_bundles(axes, _bundles(info, row), named=row == 1)
            else:
                _draw_lines(axes, info, row, styles)
            axes.set_ylabel(ordinate)
        panels[-1].set_xlabel(info.abscissa)
        panels[0].set_title(drawable(info.title))
        canvas.grid(*panels)
        canvas.legend_below(figure, *panels)
    return figure


def _draw_lines(axes: "Axes", info: CurvesInfo, row: int, styles: Sequence[dict[str, Any]]) -> None:
    for label, values, style in zip(info.labels, info.values, styles, strict=True):
        axes.plot(values[0], values[row], label=drawable(label) if row == 1 else None, **style)


def _bundles(info: CurvesInfo, row: int) -> list[Bundle]:
    return [
        Bundle(name, *(stacked([info.values[index][column] for index in indices]) for column in (0, row)))
        for name, indices in split(info.groups).items()
    ]
