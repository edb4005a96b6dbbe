"""Positioning: how far the position is from its target over the time since the move began, and the thrust."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MANY, Bundle, draw_bundles, split, stacked
from fraexp.figures.elements.labels import drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = ("time", "position", "reference", "target", "band")
"""What a curve must have to be drawn so; ``thrust`` may come on top."""
LEAST, LINEAR = 2.5, 6.0
"""Height of the axis at least, and at most if it is linear, in half widths of the band; logarithmic beyond the band
if it must show more."""
ROOM = 1.15
"""Of the axis above what is to be seen."""
STILL = 1e-9
"""Change of the reference per sample, relative to its range, up to which it rests."""


@dataclass(frozen=True)
class Course:
    """One positioning motion in the numbers that are drawn."""

    label: str
    group: str
    """Name of its group, by which it is told apart where there are too many."""
    time: np.ndarray
    """Time since the reference began to move [ms], shape (n,)."""
    deviation: np.ndarray
    """Position less target [unit of the figure], shape (n,)."""
    thrust: np.ndarray | None
    """Control input [its unit], shape (n,); None if it is not known."""
    after: float
    """Greatest deviation from the target once the reference rests there."""


@dataclass(frozen=True)
class PositioningInfo:
    """What a figure of positioning shows."""

    courses: tuple[Course, ...]
    bands: tuple[float, ...]
    """Half widths of the bands [unit of the figure], ascending."""
    height: float
    """Deviation [unit of the figure] at which the axis ends."""
    unit: str
    thrust_unit: str
    """Unit of the thrust; empty if none is known."""
    title: str


def is_positioning(curve: Curve) -> bool:
    """Say whether a curve is a motion to targets with bands around them."""
    lengths = {curve.units.get(name) for name in COLUMNS[1:]}
    return all(name in curve.columns for name in COLUMNS) and curve.units.get("time") == "s" and len(lengths) == 1


def positioning_info(curves: Sequence[tuple[str, Curve, str]], title: str = "") -> PositioningInfo:
    """Return the courses of motions, each with its label and group."""
    found = [(label, curve, group) for label, curve, group in curves if is_positioning(curve)]
    if not found:
        raise FraexpError("positioning figure: there is no positioning motion; take the estimator 'positioning'")
    length = found[0][1].units["position"]
    if any(curve.units["position"] != length for _, curve, _ in found):
        raise FraexpError("positioning figure: found positions in several units; choose sweeps that share one")
    factor, unit = (1e6, "µm") if length == "m" else (1.0, length)
    courses = tuple(_course(label, curve, group, factor) for label, curve, group in found)
    bands = tuple(sorted({factor * float(band) for _, curve, _ in found for band in np.unique(curve.columns["band"])}))
    height = max(ROOM * max(course.after for course in courses), LEAST * bands[-1])
    thrust_unit = next((of.units["thrust"] for _, of, _ in found if "thrust" in of.units), "")
    return PositioningInfo(courses, bands, height, unit, thrust_unit, title or "Position relative to its target")


def _course(label: str, curve: Curve, group: str, factor: float) -> Course:
    time, position, reference, target = (curve.columns[name] for name in ("time", "position", "reference", "target"))
    moving = np.flatnonzero(np.abs(np.diff(reference)) > STILL * np.ptp(reference))
    begin = time[moving[0]] if moving.size else time[0]
    deviation = factor * (position - target)
    resting = np.abs(reference - target) <= STILL * np.ptp(reference)
    after = float(np.abs(deviation[resting]).max()) if resting.any() else 0.0
    return Course(label, group, 1e3 * (time - begin), deviation, curve.columns.get("thrust"), after)


def draw_positioning(info: PositioningInfo) -> "Figure":
    """Draw the deviation from the target, over the thrust; many motions as bundles."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    with canvas.styled():
        count = 2 if info.thrust_unit else 1
        figure = canvas.new_figure(width=9.0, height=4.9 + 2.0 * (count - 1))
        panels = figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=(2.2, 1.0)[:count])[:, 0]
        upper = panels[0]
        _draw(upper, info.courses, lambda course: course.deviation, named=True)
        if info.thrust_unit:
            _draw(panels[1], info.courses, lambda course: course.thrust, named=False)
            panels[1].set_ylabel(f"Thrust [{info.thrust_unit}]")
        _draw_bands(upper, info)
        if info.height > LINEAR * info.bands[-1]:
            canvas.error_axis(upper, 10.0 ** np.ceil(np.log10(info.bands[-1])))
        upper.set_ylim(-info.height, info.height)
        upper.set_ylabel(f"Position − target [{info.unit}]")
        upper.set_title(canvas.heading(figure, info.title))
        times = [course.time for course in info.courses]
        upper.set_xlim(min(time[0] for time in times), max(time[-1] for time in times))
        panels[-1].set_xlabel("Time since the move began [ms]")
        canvas.grid(*panels)
        figure.align_ylabels(panels)
        canvas.legend_below(figure, upper)
    return figure


def _draw(axes: "Axes", courses: Sequence[Course], part: Callable[[Course], np.ndarray | None], named: bool) -> None:
    from fraexp.figures.elements import canvas

    values = [np.full(course.time.size, np.nan) if part(course) is None else part(course) for course in courses]
    if len(courses) > MANY:
        groups = split([course.group for course in courses])
        bundles = [
            Bundle(name, stacked([courses[i].time for i in chosen]), stacked([values[i] for i in chosen]))  # type: ignore[misc]
            for name, chosen in groups.items()
        ]
        draw_bundles(axes, bundles, named)
        return
    for course, y, style in zip(courses, values, canvas.line_styles(len(courses)), strict=True):
        axes.plot(course.time, y, label=drawable(course.label) if named else None, **style)  # type: ignore[arg-type]


def _draw_bands(axes: "Axes", info: PositioningInfo) -> None:
    from fraexp.figures.elements import canvas

    for band in info.bands:
        for limit in (-band, band):
            axes.axhline(limit, **canvas.REFERENCE)  # type: ignore[arg-type]
    style = {**canvas.REFERENCE, "label": " and ".join(f"±{band:g} {info.unit}" for band in info.bands)}
    axes.plot([], [], **style)  # type: ignore[arg-type]
