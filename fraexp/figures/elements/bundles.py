"""Many curves in one panel: thin lines in the colour of their group, with its median and the band of 5…95 %."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fraexp.figures.elements.labels import GROUPS, drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MANY = 20
"""More curves than this in one panel are drawn as bundles."""
FEW = 10
"""A bundle of fewer curves has no quantiles worth drawing."""
LEVELS = (0.05, 0.5, 0.95)
"""Quantiles that are drawn: the band's lower limit, the median, the band's upper limit."""
PIXELS = 500
"""A bundle of more lines is drawn in pixels even in SVG and PDF, which would take long to open."""
BAND = 0.4
"""Opacity of a band: the lines under it show."""
TINT = 0.5
"""Share of white in the lines under a band."""
SHADE = 0.3
"""Share of black in a median."""
GREY = "0.35"
Colour = tuple[float, ...]


@dataclass(frozen=True)
class Bundle:
    """Curves of one group in the numbers that are drawn, a row each, all of shape (m, n)."""

    label: str
    """What they have in common; empty if there is one bundle."""
    x: np.ndarray
    y: np.ndarray
    """NaN leaves a gap in the line."""

    @property
    def quantiles(self) -> np.ndarray | None:
        """Quantiles of y at `LEVELS`, shape (3, n), NaN where most curves have no value; None without a common x."""
        shared = bool((self.x == self.x[0]).all() and (np.diff(self.x[0]) >= 0).all())
        if len(self.x) < FEW or not shared:
            return None
        known = 2 * np.isfinite(self.y).sum(axis=0) > len(self.y)
        found = np.full((len(LEVELS), self.y.shape[1]), np.nan)
        if known.any():
            found[:, known] = np.nanquantile(self.y[:, known], LEVELS, axis=0)
        return found


def split(groups: Sequence[str]) -> dict[str, list[int]]:
    """Return the indices of each group's curves by its name; one group without a name if there are too many."""
    if len(set(groups)) > GROUPS:
        return {"": list(range(len(groups)))}
    found: dict[str, list[int]] = {}
    for index, name in enumerate(groups):
        found.setdefault(name, []).append(index)
    return found


def stacked(rows: Sequence[np.ndarray], missing: Any = np.nan) -> np.ndarray:
    """Return arrays of shape (n,) as the rows of one; shorter ones are filled up with `missing`."""
    lengths = [len(row) for row in rows]
    if min(lengths) == max(lengths):
        return np.stack(rows)
    filled = np.full((len(rows), max(lengths)), missing, dtype=np.result_type(*{row.dtype for row in rows}))
    for target, row in zip(filled, rows, strict=True):
        target[: len(row)] = row
    return filled


def draw_bundles(axes: "Axes", bundles: Sequence[Bundle], named: bool) -> None:
    """Draw bundles, each in its colour; `named` bundles get their entries in the legend."""
    from fraexp.figures.elements.canvas import OKABE_ITO

    quantiles = [bundle.quantiles for bundle in bundles]
    for bundle, levels, colour in zip(bundles, quantiles, OKABE_ITO, strict=False):
        _draw_lines(axes, bundle, mixed(colour, 1.0, 0.0 if levels is None else TINT))
        if levels is not None:
            _draw_quantiles(axes, bundle.x[0], levels, colour)
    if named:
        _name(axes, bundles, OKABE_ITO, any(levels is not None for levels in quantiles))


def _draw_lines(axes: "Axes", bundle: Bundle, colour: Colour) -> None:
    from matplotlib.collections import LineCollection

    drawn = np.isfinite(bundle.x) & np.isfinite(bundle.y)
    if not drawn.any():
        return
    count = len(bundle.x)
    # The more lines, the fainter each; all of them together are no darker than their tint, under band and median.
    alpha = float(np.clip(100 / count, 0.12, 0.8))
    lines = LineCollection(
        list(np.stack([bundle.x, bundle.y], axis=-1)),
        colors=colour, linewidths=0.8, alpha=alpha, zorder=2, rasterized=count > PIXELS,
    )  # fmt: skip
    lines.set_in_layout(False)  # they lie inside the axes: measuring them all would only cost time
    axes.add_collection(lines, autolim=False)
    x, y = bundle.x[drawn], bundle.y[drawn]
    axes.update_datalim([(x.min(), y.min()), (x.max(), y.max())])
    axes.autoscale_view()


def _draw_quantiles(axes: "Axes", x: np.ndarray, levels: np.ndarray, colour: str) -> None:
    low, middle, high = levels
    axes.fill_between(x, low, high, color=colour, alpha=BAND, linewidth=0, zorder=2.5)
    axes.plot(x, middle, color=mixed(colour, 0.0, SHADE), linewidth=1.8, zorder=3)


def mixed(colour: str, grey: float, share: float) -> Colour:
    """Return a colour with a share of a grey, 0 for black and 1 for white."""
    from matplotlib.colors import to_rgb

    return tuple((1 - share) * part + share * grey for part in to_rgb(colour))


def _name(axes: "Axes", bundles: Sequence[Bundle], colours: Sequence[str], quantiles: bool) -> None:
    """Add the legend's entries, on artists without data: the lines themselves are too faint to be told there."""
    alone = len(bundles) == 1
    for bundle, colour in zip(bundles, colours, strict=False):
        label = f"{bundle.label}, {len(bundle.x)} sweeps".removeprefix(", ")
        width, shown = (0.8, mixed(colour, 1.0, TINT)) if alone else (1.8, mixed(colour, 0.0, SHADE))
        axes.plot([], [], color=shown, linewidth=width, label=drawable(label))
    if quantiles:
        shared = colours[0] if alone else GREY
        axes.plot([], [], color=mixed(shared, 0.0, SHADE), linewidth=1.8, label="median")
        axes.fill_between([], [], color=mixed(shared, 1.0, 0.4), linewidth=0, label="5…95 %")
