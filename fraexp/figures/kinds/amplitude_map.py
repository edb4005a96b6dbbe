"""A frequency response over frequency and amplitude, in colours: of a linear plant all amplitudes show the same."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fraexp.errors import FraexpError
from fraexp.figures.elements.labels import drawable
from fraexp.figures.elements.scales import continuous_phase, decibel, degrees, readable_unit
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.kinds.difference import on_frequencies

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Masked = np.ma.MaskedArray[Any, Any]
MOST = 4
"""Most maps side by side."""
HATCHED: dict[str, Any] = {"facecolor": "0.93", "edgecolor": "0.55", "hatch": "////", "linewidth": 0}
"""Look of what had not settled."""
STEPS_DB = (0.1, 1.0, 3.0, 6.0, 10.0, 20.0, 40.0, 80.0)
"""Limits of the colours for a magnitude relative to P(jω) [dB]."""
STEPS_DEGREES = (1.0, 5.0, 10.0, 30.0, 60.0, 90.0, 180.0)
"""Limits of the colours for a phase relative to P(jω) [deg]."""


@dataclass(frozen=True)
class AmplitudeMap:
    """One response over frequency and amplitude."""

    label: str
    """What its sweeps have in common; empty if there is one map."""
    frequency: np.ndarray
    """Frequency [Hz], ascending, shape (n,)."""
    amplitude: np.ndarray
    """Amplitude of the excitation, ascending, shape (m,)."""
    magnitude: np.ndarray
    """Magnitude [dB], shape (m, n); NaN where there is none."""
    phase: np.ndarray
    """Phase [deg], shape (m, n); NaN where there is none."""
    settled: np.ndarray
    """Whether the response had become periodic, shape (m, n) of bool."""


@dataclass(frozen=True)
class AmplitudeMapInfo:
    """What a figure of amplitude maps shows."""

    maps: tuple[AmplitudeMap, ...]
    relative: bool
    """Whether magnitude and phase are those of Ĝ/P; else they are those of Ĝ."""
    unit: str
    """Unit that is 0 dB where they are not relative, such as ``mm/N``."""
    amplitude_unit: str
    title: str


def amplitude_map_info(shown: Sequence[ShownResult], title: str = "") -> AmplitudeMapInfo:
    """Return maps of the responses that have an amplitude, one for each series; relative to P(jω) if that is known.

    FraexpError if there are not several amplitudes, or too many series.
    """
    usable = [of for of in shown if of.response is not None and np.isfinite(of.amplitude)]
    series: dict[str, dict[float, ShownResult]] = {}
    for of in usable:
        series.setdefault(of.series, {})[of.amplitude] = of
    if not series or min(map(len, series.values())) < 2:
        raise FraexpError('amplitude map: found no two amplitudes of one kind; vary "excitation.amplitude" in [grid]')
    units = {(of.response.unit, of.amplitude_unit) for of in usable if of.response}
    if len(units) > 1:
        raise FraexpError(
            "amplitude map: found responses or amplitudes in several units; choose sweeps that share them"
        )
    if len(series) > MOST:
        raise FraexpError(f"amplitude map: found {len(series)} series; {MOST} maps at most fit, choose fewer sweeps")
    relative = all(of.truth is not None for of in usable)
    (unit, amplitude_unit) = units.pop()
    maps = tuple(_map(name, [of[key] for key in sorted(of)], relative) for name, of in series.items())
    return AmplitudeMapInfo(
        maps, relative, readable_unit(unit)[1], amplitude_unit, title or "Response over frequency and amplitude"
    )


def _map(label: str, shown: Sequence[ShownResult], relative: bool) -> AmplitudeMap:
    frequency = np.sort(next(of.response.frequency for of in shown if of.response))
    rows = [_row(of, frequency, relative) for of in shown]
    values, settled = np.stack([row[0] for row in rows]), np.stack([row[1] for row in rows])
    factor = 1.0 if relative else readable_unit(shown[0].response.unit)[0]  # type: ignore[union-attr]
    phase = np.stack([_phase(row, inside, relative) for row, inside in zip(values, settled, strict=True)])
    amplitude = np.array([of.amplitude for of in shown])
    return AmplitudeMap(label, frequency, amplitude, decibel(factor * values), phase, settled)


def _phase(values: np.ndarray, settled: np.ndarray, relative: bool) -> np.ndarray:
    return degrees(values) if relative else continuous_phase(degrees(values), settled)


def _row(of: ShownResult, frequency: np.ndarray, relative: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return a response on the map's frequencies, and where it had settled; NaN beyond its own."""
    response = of.response
    assert response is not None
    order = np.argsort(response.frequency, kind="stable")
    own, values, settled = response.frequency[order], response.response[order], response.settled[order]
    if relative and of.truth is not None:
        with np.errstate(invalid="ignore"):  # where nothing moved
            values = values / of.truth[order]
    if len(own) == len(frequency) and np.allclose(own, frequency, rtol=1e-9):
        return values, settled
    usable = np.isfinite(values) & (values != 0)
    inside = (frequency >= own.min()) & (frequency <= own.max()) if usable.any() else np.zeros(len(frequency), bool)
    found = np.full(len(frequency), np.nan, dtype=complex)
    found[inside] = on_frequencies(frequency[inside], own[usable], values[usable])
    nearest = np.argmin(np.abs(np.log(own[None, :] / frequency[:, None])), axis=1)
    return found, inside & settled[nearest]


def draw_amplitude_map(info: AmplitudeMapInfo) -> "Figure":
    """Draw magnitude over phase for each map; what had not settled is hatched."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    count = len(info.maps)
    with canvas.styled():
        figure = canvas.new_figure(width=2.2 + (6.6 if count == 1 else 4.6 * count), height=7.4)
        panels = figure.subplots(2, count, squeeze=False, sharex=True, sharey=True)
        _draw_row(figure, panels[0], info, "magnitude")
        _draw_row(figure, panels[1], info, "phase")
        for upper, lower, of in zip(*panels, info.maps, strict=True):
            canvas.frequency_axis(lower, (float(of.frequency[0]), float(of.frequency[-1])))
            lower.set_xlabel("Frequency [Hz]")
            upper.set_title(drawable(of.label) if count > 1 else canvas.heading(figure, info.title))
        if count > 1:
            figure.suptitle(canvas.heading(figure, info.title))
        for axes in panels[:, 0]:
            axes.set_ylabel(f"Excitation amplitude [{info.amplitude_unit}]")
            canvas.decade_axis(axes)
        _explain_hatching(figure, info.maps)
    return figure


def _draw_row(figure: "Figure", panels: Sequence["Axes"], info: AmplitudeMapInfo, part: str) -> None:
    values = np.concatenate([np.where(of.settled, getattr(of, part), np.nan).ravel() for of in info.maps])
    levels, colours = _scale(info, part, values)
    lines = [level for level in levels if abs(level) > min(map(abs, levels))] if info.relative else levels[::3]
    drawn = None
    for axes, of in zip(panels, info.maps, strict=True):
        known = np.ma.masked_invalid(np.where(of.settled, getattr(of, part), np.nan))
        drawn = _draw_map(axes, of, known, levels, colours)
        _draw_contours(axes, of, known, lines)  # fewer than colours: all of them would tangle
    assert drawn is not None
    bar = figure.colorbar(drawn, ax=list(panels), pad=0.02, aspect=22, ticks=levels, extend="neither")
    bar.ax.set_yticklabels([f"{level:g}" for level in levels])
    bar.ax.minorticks_off()
    bar.set_label(_meaning(info, part))


def _meaning(info: AmplitudeMapInfo, part: str) -> str:
    if info.relative:
        return "Magnitude over |P(jω)| [dB]" if part == "magnitude" else "Phase less arg P(jω) [deg]"
    return f"Magnitude [dB re 1 {info.unit}]" if part == "magnitude" else "Phase [deg]"


def _scale(info: AmplitudeMapInfo, part: str, values: np.ndarray) -> tuple[list[float], str]:
    """Return the limits of the colours and the name of their map: diverging around P(jω), else evenly spaced.

    Both maps can be told apart by the colour-blind.
    """
    known = values[np.isfinite(values)]
    if info.relative:
        steps = STEPS_DB if part == "magnitude" else STEPS_DEGREES
        reach = float(np.abs(known).max()) if known.size else 0.0
        used = [step for number, step in enumerate(steps) if number < 2 or steps[number - 1] < reach]
        return [*(-step for step in reversed(used)), *used], "RdBu_r" if part == "magnitude" else "PuOr_r"
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    step = next((step for step in (1, 2, 5, 10, 15, 30, 45, 90) if (high - low) / step <= 12), 180)
    first, last = int(np.floor(low / step)), int(np.ceil(high / step))
    return [float(step * number) for number in range(first, max(last, first + 1) + 1)], "cividis"


def _draw_map(axes: "Axes", of: AmplitudeMap, values: Masked, levels: list[float], colours: str) -> Any:
    import matplotlib
    from matplotlib.colors import BoundaryNorm

    shades = matplotlib.colormaps[colours].resampled(256)
    norm = BoundaryNorm(levels, shades.N, clip=True)
    x, y = _edges(of.frequency), _edges(of.amplitude)
    drawn = axes.pcolormesh(x, y, values, cmap=shades, norm=norm, rasterized=True)
    axes.set_yscale("log")
    axes.set_xscale("log")
    axes.set_ylim(y[0], y[-1])
    _hatch(axes, x, y, ~of.settled)
    return drawn


def _draw_contours(axes: "Axes", of: AmplitudeMap, values: Masked, levels: list[float]) -> None:
    if values.count() < 4 or min(values.shape) < 2:
        return
    from matplotlib.patheffects import withStroke

    low, high = float(values.min()), float(values.max())
    inside = [level for level in levels if low < level < high]
    if inside:
        halo: list[Any] = [withStroke(linewidth=1.8, foreground="1.0", alpha=0.7)]  # to be seen on dark colours too
        lines = axes.contour(of.frequency, of.amplitude, values, inside, colors="0.1", linewidths=0.7)
        lines.set_path_effects(halo)
        for text in axes.clabel(lines, fmt=lambda level: f"{level:g}", fontsize=8, inline_spacing=3):
            text.set_path_effects(halo)


def _edges(centres: np.ndarray) -> np.ndarray:
    """Return the limits of cells around ascending centres, midway in logarithm, shape (n + 1,)."""
    logarithm = np.log(centres)
    middle = (logarithm[1:] + logarithm[:-1]) / 2
    ends = 2 * logarithm[[0, -1]] - middle[[0, -1]] if len(centres) > 1 else logarithm[[0, 0]] + [-0.1, 0.1]
    limits: np.ndarray = np.exp(np.concatenate([ends[:1], middle, ends[1:]]))
    return limits


def _hatch(axes: "Axes", x: np.ndarray, y: np.ndarray, cells: np.ndarray) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    patches = [
        Rectangle((x[column], y[row]), x[column + 1] - x[column], y[row + 1] - y[row])
        for row, column in np.argwhere(cells)
    ]
    if patches:
        axes.add_collection(PatchCollection(patches, **HATCHED))


def _explain_hatching(figure: "Figure", maps: Sequence[AmplitudeMap]) -> None:
    from matplotlib.patches import Patch

    if not all(of.settled.all() for of in maps):
        figure.legend(handles=[Patch(**HATCHED, label="not settled")], loc="outside lower center")
