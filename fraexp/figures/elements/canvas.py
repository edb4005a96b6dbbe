"""The style of all figures: fonts, colours that the colour-blind can distinguish, axes and legends."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from itertools import cycle, islice
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from fraexp.figures.elements.labels import drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

LineStyle = dict[str, Any]
"""Keyword arguments of matplotlib for a line, such as color, linestyle, linewidth and zorder."""


OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette (2008), without its yellow, which is too light for a line."""
Dash = str | tuple[int, tuple[float, ...]]
DASH_STYLES: tuple[Dash, ...] = ("solid", (0, (4.5, 1.4)), (0, (1.2, 1.2)), (0, (6, 1.4, 1.2, 1.4)))
REFERENCE_STYLE: LineStyle = {"color": "0.1", "linestyle": (0, (4, 6)), "linewidth": 1.2, "zorder": 4}
TITLE_CHARACTERS_PER_INCH, TITLE_MARGIN_INCH = 10.5, 0.8
"""Characters of a title per width of the figure, and the width that it cannot use, because it is above the axes."""
LEGEND_CHARACTERS_PER_INCH = 11.5
"""Characters of a legend per width of the figure."""
LEGEND_ROW_INCH = 0.22
"""Height by which a figure grows for each further row of its legend."""
NARROW_RATIO = 4.0
"""Ratio of the limits of a logarithmic axis up to which its ticks are evenly spaced: too few of 1, 2, 5 lie within."""
RC_PARAMS: Any = {  # matplotlib lists each key with a type of its own
    "font.family": "DejaVu Sans",
    "font.size": 11,
    "axes.titlesize": 12.5,
    "axes.edgecolor": "0.25",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": "0.25",
    "ytick.color": "0.25",
    "xtick.labelcolor": "0.1",
    "ytick.labelcolor": "0.1",
    "legend.frameon": False,
    "legend.fontsize": 10.5,
    "savefig.dpi": 100,
    "text.parse_math": False,  # a name from a study is not a formula
    "svg.hashsalt": "fraexp",
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Draw with this style, independent of the user's matplotlibrc."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(RC_PARAMS)
        yield


def png_bytes(figure: "Figure") -> bytes:
    """Return a figure as PNG in this style."""
    stream = BytesIO()
    with figure_style(), laid_out(figure):
        figure.savefig(stream, format="png")
    return stream.getvalue()


@contextmanager
def laid_out(figure: "Figure") -> Iterator[None]:
    """Lay a figure out before it is saved as PNG: matplotlib itself draws all of it once more to lay it out."""
    engine = figure.get_layout_engine()
    if engine is None:
        yield
        return
    engine.execute(figure)
    figure.set_layout_engine(None)
    try:
        yield
    finally:
        figure.set_layout_engine(engine)


def _import_figure() -> "type[Figure]":
    """Return matplotlib's class of figures.

    Each class of matplotlib lists its properties in a docstring when it is imported, for a third of the whole time.
    """
    from matplotlib import artist as artists

    list_properties, artists.kwdoc = artists.kwdoc, lambda artist: ""
    try:
        from matplotlib.figure import Figure
    finally:
        artists.kwdoc = list_properties
    return Figure


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure of a size [inch], with its own canvas and without global state."""
    figure_class = _import_figure()
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = figure_class(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    setattr(figure, "_repr_png_", lambda: png_bytes(figure))  # noqa: B010 - a notebook shows it in its cell
    return figure


def wrapped_title(figure: "Figure", title: str) -> str:
    """Return a title in as many lines as the figure's width needs."""
    return "\n".join(
        wrap(drawable(title), int(TITLE_CHARACTERS_PER_INCH * (figure.get_figwidth() - TITLE_MARGIN_INCH)))
    )


def line_styles(count: int) -> list[LineStyle]:
    """Return a style for each of `count` curves: they differ in colour, and for grey prints in dashes.

    Later curves are thinner, so that the rim of a hidden curve remains visible.
    """
    import matplotlib

    widths = [max(2.8 - 0.25 * index, 1.6) for index in range(count)]
    if count <= len(OKABE_ITO):
        colours = list(OKABE_ITO[:count])
    else:  # a whole grid: an ordered scale is clearer than repeated colours
        scale = [matplotlib.colormaps["cividis"](0.92 * index / (count - 1)) for index in range(count)]
        colours, widths = [matplotlib.colors.to_hex(colour) for colour in scale], [1.5] * count
    return [
        {"color": colour, "linestyle": dash, "linewidth": width, "zorder": 3}
        for colour, dash, width in zip(colours, islice(cycle(DASH_STYLES), count), widths, strict=True)
    ]


def named_styles(count: int) -> list[LineStyle]:
    """Return a style for each of `count` curves without an order: they differ in colour, and neighbours in dashes."""
    looks = zip(range(count), cycle(OKABE_ITO), cycle(DASH_STYLES), strict=False)  # 28 pairs, as no factor is common
    return [
        {"color": colour, "linestyle": dash, "linewidth": max(2.4 - 0.1 * index, 1.5), "zorder": 3}
        for index, colour, dash in looks
    ]


def set_log_abscissa(axes: "Axes", span: tuple[float, float]) -> None:
    """Make x a logarithmic axis over `span`, labelled with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    low, high = span
    margin = 1.01 if high > low else 2.0  # a little, so that 199.9 Hz still gets its tick at 200
    axes.set_xlim(low / margin, high * margin)
    labelled = (1, 2, 3, 5, 7) if high / low < 30 else (1, 2, 5) if high / low < 1500 else (1,)
    axes.xaxis.set_major_locator(LogLocator(base=10, subs=labelled, numticks=50))
    axes.xaxis.set_minor_locator(LogLocator(base=10, subs=range(1, 10), numticks=50))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def set_phase_ticks(axes: "Axes") -> None:
    """Set the ticks of a phase to fractions of a turn."""
    from matplotlib.ticker import MultipleLocator

    low, high = axes.get_ylim()
    step = next((step for step in (5, 15, 45, 90, 180) if (high - low) / step <= 7), 360)
    axes.yaxis.set_major_locator(MultipleLocator(step))
    axes.yaxis.set_minor_locator(MultipleLocator(step / 3 if step in (15, 45, 90) else step / 5))


def set_decade_ticks(axes: "Axes") -> None:
    """Label a logarithmic y axis with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    low, high = axes.get_ylim()
    steps = LogLocator(base=10, subs=(1, 2, 5) if high / low < 1500 else (1,), numticks=50)
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]) if high / low < NARROW_RATIO else steps)
    axes.yaxis.set_minor_locator(LogLocator(base=10, subs=range(1, 10), numticks=50))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def set_error_axis(axes: "Axes", fine: float) -> None:
    """Make y an axis of errors: linear up to ±`fine`, logarithmic with both signs beyond, with plain numbers."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

    axes.set_yscale("symlog", linthresh=fine, linscale=0.6)
    decades = fine * 10.0 ** np.arange(6)
    axes.yaxis.set_major_locator(FixedLocator([*-decades[::-1], 0.0, *decades]))
    between = np.outer(decades, np.arange(2, 10)).ravel()
    axes.yaxis.set_minor_locator(FixedLocator([*-between[::-1], *between]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def draw_grid(*panels: "Axes") -> None:
    """Draw a faint grid under the data, with minor lines between the ticks."""
    from matplotlib.ticker import MaxNLocator

    for axes in panels:
        if isinstance(axes.yaxis.get_major_locator(), MaxNLocator):
            axes.minorticks_on()
        axes.set_axisbelow(True)
        axes.grid(which="major", color="0.80", linewidth=0.7)
        axes.grid(which="minor", color="0.92", linewidth=0.5)
        axes.tick_params(which="minor", length=0)


def add_legend_below(figure: "Figure", *panels: "Axes") -> None:
    """Put the legend of the panels' curves below all panels, where it covers nothing."""
    found: dict[str, Any] = {}  # a name that several panels have stands once
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    handles, labels = list(found.values()), list(found)
    if not any(labels):
        return
    room = int(LEGEND_CHARACTERS_PER_INCH * figure.get_figwidth())
    fitting = max(1, min(len(labels), room // (max(len(label) for label in labels) + 8)))
    rows = -(-len(labels) // fitting)
    figure.set_figheight(figure.get_figheight() + LEGEND_ROW_INCH * (rows - 1))
    columns = -(-len(labels) // rows)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, handlelength=3.4, columnspacing=1.8)


BAR_WIDTH_INCH = 0.2
USED_RANGE = 0.92
"""Part of the colours that is used: the end of the map is too light for a line."""


def amount_colours(amounts: Sequence[float]) -> list[str]:
    """Return the colour of each amount, which the colour-blind can distinguish; larger ones are lighter."""
    import matplotlib
    from matplotlib.colors import to_hex

    norm, shades = _norm(amounts), matplotlib.colormaps["cividis"]
    return [to_hex(shades(USED_RANGE * float(norm(of)))) for of in amounts]


def add_amount_scale(figure: "Figure", panels: Sequence["Axes"], amounts: Sequence[float], title: str) -> None:
    """Put the scale of colours at the right of the panels."""
    import matplotlib
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, LogNorm
    from matplotlib.ticker import FuncFormatter, LogLocator

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


def _norm(amounts: Sequence[float]) -> "Normalize":
    from matplotlib.colors import LogNorm, Normalize

    low, high = min(amounts), max(amounts)
    return LogNorm(low, high) if high >= 10 * low else Normalize(low, high)
