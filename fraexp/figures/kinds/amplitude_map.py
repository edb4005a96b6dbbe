"""A frequency response in colours over frequency and amplitude, or another label; a linear plant is uniform."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.canvas import LineStyle
from fraexp.figures.elements.grouping import MAX_MAPS, ShownResult
from fraexp.figures.elements.labels import drawable
from fraexp.figures.elements.scales import continuous_phase, decibel, degrees, readable_unit
from fraexp.figures.kinds.response_errors import on_frequencies

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure

Masked = np.ma.MaskedArray[tuple[int, ...], np.dtype[np.float64]]
MAX_ROW_NAMES = 40
"""Maximum number of rows with names that can be read."""
NAME_INCH = 0.2
"""Height of a row with a name."""
HATCH_STYLE: LineStyle = {"facecolor": "0.93", "edgecolor": "0.55", "hatch": "////", "linewidth": 0}
"""Style of unsettled cells."""
STEPS_DB = (0.1, 1.0, 3.0, 6.0, 10.0, 20.0, 40.0, 80.0)
"""Limits of the colours for a magnitude relative to P(jω) [dB]."""
STEPS_DEGREES = (1.0, 5.0, 10.0, 30.0, 60.0, 90.0, 180.0)
"""Limits of the colours for a phase relative to P(jω) [deg]."""


@dataclass(frozen=True)
class AmplitudeMap:
    """A response over frequency and amplitude."""

    label: str
    """Name that its sweeps share; empty if there is one map."""
    frequency: NDArray[np.float64]
    """Frequency [Hz], ascending, shape (n,)."""
    amplitude: NDArray[np.float64]
    """Amplitude of the excitation or another quantity, or number of the row; ascending, shape (m,)."""
    magnitude: NDArray[np.float64]
    """Magnitude [dB], shape (m, n); NaN where it is missing."""
    phase: NDArray[np.float64]
    """Phase [deg], shape (m, n); NaN where it is missing."""
    settled: NDArray[np.bool_]
    """Whether the response had settled, shape (m, n)."""


@dataclass(frozen=True)
class AmplitudeMapInfo:
    """Contents of a figure of amplitude maps."""

    maps: tuple[AmplitudeMap, ...]
    is_relative: bool
    """Whether magnitude and phase are those of Ĝ/P; otherwise they are those of Ĝ."""
    unit: str
    """Unit that is 0 dB where they are not relative, such as ``mm/N``."""
    row_title: str
    """What the rows are, with its unit."""
    row_names: tuple[str, ...]
    """Names of rows that are no quantity, by number; empty if they are one."""
    title: str


Series = dict[str, dict[float, list[ShownResult]]]
"""The results by name of the map and value of the row; several results of a row are random draws."""


def amplitude_map_info(shown: Sequence[ShownResult], title: str = "") -> AmplitudeMapInfo:
    """Return maps of the responses that have an amplitude, one for each series; relative to P(jω) if that is known.

    FraexpError if there are not several amplitudes, or too many series.
    """
    usable = [of for of in shown if of.response is not None and np.isfinite(of.amplitude)]
    series: Series = {}
    for of in usable:
        series.setdefault(of.series, {})[of.amplitude] = [of]
    if not series or min(map(len, series.values())) < 2:
        raise FraexpError(
            'amplitude map: found fewer than two amplitudes of one kind; vary "excitation.amplitude" in [grid]'
        )
    units = {of.amplitude_unit for of in usable}
    if len(units) > 1:
        raise FraexpError("amplitude map: found amplitudes in several units; choose sweeps that share them")
    row_title = f"Excitation amplitude [{units.pop()}]"
    return _map_info(series, row_title, (), title or "Response over frequency and amplitude", is_wanted=True)


def response_map_info(shown: Sequence[ShownResult], title: str = "") -> AmplitudeMapInfo:
    """Return maps of responses with a row for each group (see `CurvePlace.row`), the median of its random draws."""
    series: Series = {}
    names: dict[float, str] = {}
    for of in shown:
        if of.response is not None and of.place is not None:
            series.setdefault(of.place.facet, {}).setdefault(of.place.row, []).append(of)
            names[of.place.row] = of.name
    axis = next((of.place.axis for of in shown if of.place), "")
    numbered = () if axis else tuple(names.get(float(row), "") for row in range(int(max(names, default=0)) + 1))
    return _map_info(series, axis, numbered, title or "Response of each group over frequency", is_wanted=False)


def _map_info(
    series: Series, row_title: str, row_names: tuple[str, ...], title: str, is_wanted: bool
) -> AmplitudeMapInfo:
    """Return the maps; they are relative to P(jω) if that is wanted, and known for all."""
    every = [of for rows in series.values() for row in rows.values() for of in row]
    units = {of.response.unit for of in every if of.response}
    if len(units) != 1:
        raise FraexpError("amplitude map: found responses in several units; choose sweeps that share one")
    if len(series) > MAX_MAPS:
        raise FraexpError(
            f"amplitude map: found {len(series)} series; no more than {MAX_MAPS} maps fit; choose fewer sweeps"
        )
    is_relative = is_wanted and all(of.truth is not None for of in every)
    maps = tuple(_amplitude_map(name, rows, is_relative) for name, rows in series.items())
    return AmplitudeMapInfo(maps, is_relative, readable_unit(units.pop())[1], row_title, row_names, title)


def _amplitude_map(label: str, rows: Mapping[float, Sequence[ShownResult]], is_relative: bool) -> AmplitudeMap:
    amplitude = np.sort(np.array(list(rows)))
    frequency = max((of.response.frequency for row in rows.values() for of in row if of.response), key=len)
    levels = [_map_row(rows[value], frequency, is_relative) for value in amplitude]
    magnitude, phase, settled = (np.stack(part) for part in zip(*levels, strict=True))
    return AmplitudeMap(label, frequency, amplitude, magnitude, phase, settled)


def _map_row(
    row: Sequence[ShownResult], frequency: NDArray[np.float64], is_relative: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return magnitude [dB], phase [deg] and whether they had settled: the medians of the random draws."""
    parts = [_interpolated_row(of, frequency, is_relative) for of in row]
    factor = 1.0 if is_relative else readable_unit(next(of.response.unit for of in row if of.response))[0]
    levels = np.stack([np.where(settled, decibel(factor * values), np.nan) for values, settled in parts])
    phases = np.stack([np.where(settled, _phase(values, settled, is_relative), np.nan) for values, settled in parts])
    known = 2 * np.isfinite(levels).sum(axis=0) > len(row)
    middle = np.full((2, len(frequency)), np.nan)
    middle[0, known], middle[1, known] = (np.nanmedian(part[:, known], axis=0) for part in (levels, phases))
    if len(row) == 1:
        values, settled = parts[0]
        return decibel(factor * values), _phase(values, settled, is_relative), settled
    return middle[0], middle[1], known


def _phase(values: NDArray[np.complex128], settled: NDArray[np.bool_], is_relative: bool) -> NDArray[np.float64]:
    return degrees(values) if is_relative else continuous_phase(degrees(values), settled)


def _interpolated_row(
    of: ShownResult, frequency: NDArray[np.float64], is_relative: bool
) -> tuple[NDArray[np.complex128], NDArray[np.bool_]]:
    """Return a response at the frequencies of the map, and where it had settled; NaN outside of its own range."""
    response = of.response
    assert response is not None
    own, values, settled = response.frequency, response.response, response.settled
    if is_relative and of.truth is not None:
        with np.errstate(invalid="ignore"):  # where the machine did not move
            values = values / of.truth
    if len(own) == len(frequency) and np.allclose(own, frequency, rtol=1e-9):
        return values, settled
    usable = np.isfinite(values) & (values != 0)
    inside = (frequency >= own.min()) & (frequency <= own.max()) if usable.any() else np.zeros(len(frequency), bool)
    found = np.full(len(frequency), np.nan, dtype=complex)
    found[inside] = on_frequencies(frequency[inside], own[usable], values[usable])
    nearest = np.argmin(np.abs(np.log(own[None, :] / frequency[:, None])), axis=1)
    return found, inside & settled[nearest]


def draw_amplitude_map(info: AmplitudeMapInfo) -> "Figure":
    """Draw magnitude above phase for each map; unsettled cells are hatched."""
    count = len(info.maps)
    with canvas.figure_style():
        names = max(map(len, info.row_names), default=0)
        height = max(7.4, 2.0 + 2 * NAME_INCH * min(len(info.row_names), MAX_ROW_NAMES))
        figure = canvas.new_figure(2.2 + (6.6 if count == 1 else 4.6 * count) + 0.07 * names, height)
        panels = figure.subplots(2, count, squeeze=False, sharex=True, sharey=True)
        _draw_row(figure, panels[0], info, "magnitude")
        _draw_row(figure, panels[1], info, "phase")
        for upper, lower, of in zip(*panels, info.maps, strict=True):
            canvas.set_log_abscissa(lower, (float(of.frequency[0]), float(of.frequency[-1])))
            lower.set_xlabel("Frequency [Hz]")
            upper.set_title(drawable(of.label) if count > 1 else canvas.wrapped_title(figure, info.title))
        if count > 1:
            figure.suptitle(canvas.wrapped_title(figure, info.title))
        for axes in panels[:, 0]:
            axes.set_ylabel(info.row_title)
            _name_rows(axes, info.row_names) if info.row_names else canvas.set_decade_ticks(axes)
        _add_hatch_legend(figure, info.maps)
    return figure


def _draw_row(figure: "Figure", panels: Sequence["Axes"], info: AmplitudeMapInfo, part: str) -> None:
    values = np.concatenate([np.where(of.settled, getattr(of, part), np.nan).ravel() for of in info.maps])
    levels, colours = _colour_scale(info, part, values)
    drawn = None
    for axes, of in zip(panels, info.maps, strict=True):
        known = np.ma.masked_invalid(np.where(of.settled, getattr(of, part), np.nan))
        drawn = _draw_map(axes, of, known, (levels, colours), bool(info.row_names))
    assert drawn is not None
    bar = figure.colorbar(drawn, ax=list(panels), pad=0.02, aspect=22, ticks=levels, extend="neither")
    bar.ax.set_yticklabels([f"{level:g}" for level in levels])
    bar.ax.minorticks_off()
    bar.set_label(_bar_label(info, part))


def _bar_label(info: AmplitudeMapInfo, part: str) -> str:
    if info.is_relative:
        return "Magnitude over |P(jω)| [dB]" if part == "magnitude" else "Phase less arg P(jω) [deg]"
    return f"Magnitude [dB re 1 {info.unit}]" if part == "magnitude" else "Phase [deg]"


def _colour_scale(info: AmplitudeMapInfo, part: str, values: NDArray[np.float64]) -> tuple[list[float], str]:
    """Return the limits of the colours and the name of their map: diverging around P(jω), else evenly spaced.

    The colour-blind can distinguish both maps.
    """
    known = values[np.isfinite(values)]
    if info.is_relative:
        steps = STEPS_DB if part == "magnitude" else STEPS_DEGREES
        reach = float(np.abs(known).max()) if known.size else 0.0
        used = [step for number, step in enumerate(steps) if number < 2 or steps[number - 1] < reach]
        return [*(-step for step in reversed(used)), *used], "RdBu_r" if part == "magnitude" else "PuOr_r"
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    step = next((step for step in (1, 2, 5, 10, 15, 30, 45, 90) if (high - low) / step <= 12), 180)
    first, last = int(np.floor(low / step)), int(np.ceil(high / step))
    return [float(step * number) for number in range(first, max(last, first + 1) + 1)], "cividis"


def _name_rows(axes: "Axes", names: Sequence[str]) -> None:
    """Label rows with their names, the first at the top; of very many with some of them."""
    step = -(-len(names) // MAX_ROW_NAMES)
    axes.set_yticks(range(0, len(names), step), [drawable(name) for name in names[::step]], fontsize=9)
    axes.set_ylim(len(names) - 0.5, -0.5)


def _draw_map(
    axes: "Axes", of: AmplitudeMap, values: Masked, scale: tuple[list[float], str], is_named: bool
) -> "QuadMesh":
    """Draw the cells of a map; rows with names have the same height."""
    import matplotlib
    from matplotlib.colors import BoundaryNorm

    levels, colours = scale
    shades = matplotlib.colormaps[colours].resampled(256)
    norm = BoundaryNorm(levels, shades.N, clip=True)
    x = _cell_edges(of.frequency)
    y = np.append(of.amplitude - 0.5, of.amplitude[-1] + 0.5) if is_named else _cell_edges(of.amplitude)
    drawn = axes.pcolormesh(x, y, values, cmap=shades, norm=norm, rasterized=True)
    axes.set_yscale("linear" if is_named else "log")
    axes.set_xscale("log")
    axes.set_ylim(y[0], y[-1])
    _hatch_cells(axes, x, y, ~of.settled)
    return drawn


def _cell_edges(centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the limits of cells around ascending centres, midway in logarithm, shape (n + 1,)."""
    logarithm = np.log(centres)
    middle = (logarithm[1:] + logarithm[:-1]) / 2
    ends = 2 * logarithm[[0, -1]] - middle[[0, -1]] if len(centres) > 1 else logarithm[[0, 0]] + [-0.1, 0.1]
    limits: NDArray[np.float64] = np.exp(np.concatenate([ends[:1], middle, ends[1:]]))
    return limits


def _hatch_cells(axes: "Axes", x: NDArray[np.float64], y: NDArray[np.float64], cells: NDArray[np.bool_]) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    patches = [
        Rectangle((x[column], y[row]), x[column + 1] - x[column], y[row + 1] - y[row])
        for row, column in np.argwhere(cells)
    ]
    if patches:
        axes.add_collection(PatchCollection(patches, **HATCH_STYLE))


def _add_hatch_legend(figure: "Figure", maps: Sequence[AmplitudeMap]) -> None:
    from matplotlib.patches import Patch

    if not all(of.settled.all() for of in maps):
        figure.legend(handles=[Patch(**HATCH_STYLE, label="not settled")], loc="outside lower center")
