"""The scale of colours of curves that differ in an amount with many values, such as an amplitude."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator

BAR_WIDTH_INCH = 0.2
USED_RANGE = 0.92
"""Part of the colours that is used: the end of the map is too light for a line."""


def amount_colours(amounts: Sequence[float]) -> list[str]:
    """Return the colour of each amount, which the colour-blind can distinguish; larger ones are lighter."""
    norm, shades = _norm(amounts), matplotlib.colormaps["cividis"]
    return [to_hex(shades(USED_RANGE * float(norm(of)))) for of in amounts]


def add_amount_scale(figure: Figure, panels: Sequence[Axes], amounts: Sequence[float], title: str) -> None:
    """Put the scale of colours at the right of the panels."""
    norm = _norm(amounts)
    shades = ListedColormap(matplotlib.colormaps["cividis"](np.linspace(0, USED_RANGE, 256)))
    plain = FuncFormatter(lambda of, _: f"{of:g}")
    bar = figure.colorbar(
        ScalarMappable(norm, shades),
        ax=list(panels),
        pad=0.02,
        aspect=figure.get_figheight() / BAR_WIDTH_INCH,
        format=plain,
    )
    if isinstance(norm, LogNorm):
        bar.locator = LogLocator(subs=(1, 2, 5))
    bar.minorticks_off()
    bar.set_label(title)


def _norm(amounts: Sequence[float]) -> Normalize:
    low, high = min(amounts), max(amounts)
    return LogNorm(low, high) if high >= 10 * low else Normalize(low, high)
