"""Errors of frequency responses against the plant that was simulated: lines over frequency, and a table."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.analysis.confidence import limits
from fraexp.data.results import EFFORT, Metric, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MANY
from fraexp.figures.elements.frequency_lines import draw_bands, draw_line, joined
from fraexp.figures.elements.labels import drawable
from fraexp.figures.elements.scales import decibel, decibel_limits, degrees, readable_unit
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.elements.table_panel import FigureTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPOTS = (1.0, 5.0, 12.0, 20.0, 39.0, 80.0, 150.0)
"""Frequencies [Hz] at which a table tells the error unless others are asked for."""
NEAR = 1.05
"""A table takes the nearest settled frequency within this factor, and P(jω) there."""
FINE_DB, FINE_DEGREES = 0.1, 1.0
"""Error up to which an axis is linear if it must show far greater ones too."""


@dataclass(frozen=True)
class ErrorCurve:
    """The error Ĝ/P of one response, in ascending frequency."""

    label: str
    frequency: np.ndarray
    """Frequency [Hz], shape (n,)."""
    magnitude: np.ndarray
    """|Ĝ/P| [dB], shape (n,)."""
    phase: np.ndarray
    """arg(Ĝ/P) [deg], within ±180, shape (n,)."""
    settled: np.ndarray
    """Whether the point had become periodic, shape (n,) of bool."""
    magnitude_band: np.ndarray
    """95 % limits of the magnitude [dB], shape (2, n); NaN where unknown."""
    phase_band: np.ndarray
    """95 % limits of the phase [deg], shape (2, n); NaN where unknown."""
    cost: tuple[Metric, ...] = ()
    """What it has cost: those metrics of `EFFORT` that are known."""
    key: str = ""
    """Key of its sweep."""

    @property
    def effort(self) -> dict[str, float]:
        """What it has cost in units that people read, such as ``{"stroke [mm]": 1.2}``."""
        units = [readable_unit(metric.unit) for metric in self.cost]
        return {
            f"{metric.name} [{unit}]": factor * metric.value
            for metric, (factor, unit) in zip(self.cost, units, strict=True)
        }

    def at(self, spot: float) -> int | None:
        """Return the index of the settled point nearest to a frequency [Hz]; None if there is none within `NEAR`."""
        distance = np.where(self.settled & np.isfinite(self.magnitude), np.abs(np.log(self.frequency / spot)), np.inf)
        index = int(np.argmin(distance)) if len(distance) else 0
        return index if len(distance) and distance[index] <= np.log(NEAR) else None

    @property
    def inside(self) -> float:
        """Share of the 95 % limits of magnitude and phase, at settled points, that hold P(jω); NaN if none is known."""
        bands = np.stack([self.magnitude_band, self.phase_band])[:, :, self.settled]
        known = ~np.isnan(bands).any(axis=1)
        held = (bands[:, 0] <= 0) & (bands[:, 1] >= 0)
        return float(held[known].mean()) if known.any() else np.nan


@dataclass(frozen=True)
class ErrorsInfo:
    """What a figure of errors shows."""

    curves: tuple[ErrorCurve, ...]
    spots: tuple[float, ...]
    """Frequencies [Hz] of the table's columns."""
    title: str

    @property
    def effort(self) -> tuple[str, ...]:
        """Titles of what the responses have cost, as far as any tells it."""
        return tuple(dict.fromkeys(name for curve in self.curves for name in curve.effort))


def errors_info(shown: Sequence[ShownResult], title: str = "", spots: Sequence[float] = SPOTS) -> ErrorsInfo:
    """Return the errors of all responses of which the plant is known; FraexpError if there is none.

    Of `spots` those are kept that lie within the responses' frequencies.
    """
    curves = tuple(
        error_curve(of.label, of.result, of.truth, of.key)
        for of in shown
        if of.truth is not None and of.response is not None
    )
    if not curves:
        raise FraexpError("errors: found no response of a simulated plant; choose sweeps of a loop, in m/N")
    low = min(float(curve.frequency[0]) for curve in curves) / NEAR
    high = max(float(curve.frequency[-1]) for curve in curves) * NEAR
    inside = tuple(spot for spot in spots if low <= spot <= high)
    return ErrorsInfo(curves, inside, title or "Error against P(jω)")


def error_curve(label: str, result: Result, truth: np.ndarray, key: str = "") -> ErrorCurve:
    """Return the error of a result's response against P(jω), shape (n,), at its own frequencies."""
    response = result.response
    assert response is not None
    order = np.argsort(response.frequency, kind="stable")
    with np.errstate(invalid="ignore"):  # where nothing moved
        ratio = (response.response / truth)[order]
    band, turn = (each[:, order] for each in limits(response))
    magnitude, phase = decibel(ratio), degrees(ratio)
    return ErrorCurve(
        label=label,
        frequency=response.frequency[order],
        magnitude=magnitude,
        phase=phase,
        settled=response.settled[order],
        magnitude_band=magnitude + decibel_limits(band),
        phase_band=phase + np.clip(np.degrees(turn), -360, 360),
        cost=tuple(metric for name in EFFORT for metric in result.metrics if metric.name == name),
        key=key,
    )


def draw_errors(info: ErrorsInfo) -> "Figure":
    """Draw the errors of magnitude and phase over frequency, and below them the table of both."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    if len(info.curves) > MANY:
        raise FraexpError(f"errors: found {len(info.curves)} responses; {MANY} at most can be told apart, choose fewer")
    with canvas.styled():
        styles = canvas.named_styles(len(info.curves))
        table = FigureTable(*_cells(info))
        figure = canvas.new_figure(width=max(9.0, table.width), height=6.4 + table.height)
        upper, lower, below = figure.subplots(3, 1, height_ratios=(3.2, 3.2, table.height))
        lower.sharex(upper)
        draw_part(upper, info.curves, "magnitude", styles, FINE_DB)
        draw_part(lower, info.curves, "phase", styles, FINE_DEGREES)
        upper.set_title(canvas.heading(figure, info.title))
        upper.set_ylabel("Magnitude error [dB]")
        lower.set_ylabel("Phase error [deg]")
        lower.set_xlabel("Frequency [Hz]")
        frequency = np.concatenate([curve.frequency for curve in info.curves])
        canvas.frequency_axis(lower, (float(frequency.min()), float(frequency.max())))
        upper.tick_params(labelbottom=False)
        canvas.grid(upper, lower)
        figure.align_ylabels((upper, lower))
        table.draw(below, styles)
    return figure


def draw_part(
    axes: "Axes", curves: Sequence[ErrorCurve], part: str, styles: Sequence[dict[str, object]], fine: float
) -> None:
    """Draw the ``magnitude`` or ``phase`` of errors, on a linear axis or, far beyond `fine`, a logarithmic one."""
    from fraexp.figures.elements import canvas

    axes.axhline(0, color="0.1", linewidth=1.0, zorder=2)
    values = np.concatenate([joined(getattr(curve, part), curve.settled) for curve in curves])
    known = np.abs(values[np.isfinite(values)])
    if known.size and known.max() > 20 * fine:
        canvas.error_axis(axes, fine)
    for curve, style in zip(curves, styles, strict=True):
        draw_line(axes, curve.frequency, getattr(curve, part), curve.settled, curve.label, style)
    draw_bands(
        axes,
        [
            (curve.frequency, joined(getattr(curve, f"{part}_band"), curve.settled), str(style["color"]))
            for curve, style in zip(curves, styles, strict=True)
        ],
        opacity=0.13,
    )


def _cells(info: ErrorsInfo) -> tuple[list[str], list[list[str]]]:
    titles = [
        "dB, degrees",
        *(f"{spot:g} Hz" for spot in info.spots),
        *(name.replace(" ", "\n", 1) for name in info.effort),
    ]
    rows = []
    for curve in info.curves:
        indices = [curve.at(spot) for spot in info.spots]
        effort = curve.effort
        errors = ["-" if at is None else f"{_text(curve.magnitude[at])}, {_text(curve.phase[at])}°" for at in indices]
        rows.append([drawable(curve.label), *errors, *(_text(effort.get(name, np.nan)) for name in info.effort)])
    return titles, rows


def _text(value: float) -> str:
    """Return a number with three digits that count, two decimals at most; ``-`` where it is unknown."""
    if not np.isfinite(value):
        return "-"
    decimals = 2 if abs(value) < 9.995 else 1 if abs(value) < 99.95 else 0
    return f"{round(value, decimals) + 0.0:.{decimals}f}"
