"""Errors of frequency responses against the plant that was simulated: lines over frequency, and a table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import EFFORT, FrequencyResponse, Metric
from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas
from fraexp.figures.elements.bands import MAX_SINGLE_CURVES
from fraexp.figures.elements.canvas import LineStyle
from fraexp.figures.elements.frequency_lines import GroupedLine, PhasedCurve, frequency_span, with_gaps
from fraexp.figures.elements.grouping import OWN_PLACE, CurvePlace, ShownResult, facet_indices
from fraexp.figures.elements.labels import MAX_GROUPS, drawable
from fraexp.figures.elements.panel_figure import Panel, draw_panel
from fraexp.figures.elements.scales import decibel, decibel_limits, degree_limits, degrees, readable_unit
from fraexp.figures.elements.table_panel import FigureTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE_FREQUENCIES_HZ = (1.0, 5.0, 12.0, 20.0, 39.0, 80.0, 150.0)
"""Default frequencies of the table."""
FREQUENCY_FACTOR = 1.05
"""Factor within which the table uses the nearest settled frequency, with P(jω) there."""
PARTS = {"magnitude": ("dB", 0.1), "phase": ("deg", 1.0)}
"""Unit of each part of an error, and size up to which its axis is linear if far greater ones must be shown as well."""
FAR_ERROR_RATIO = 20.0
"""Ratio of the greatest error to the linear range above which an axis is logarithmic."""


@dataclass(frozen=True)
class ErrorCurve(PhasedCurve):
    """The error Ĝ/P of a response: |Ĝ/P| [dB], and arg(Ĝ/P) [deg] within ±180."""

    cost: tuple[Metric, ...] = ()
    """Known metrics of the experiment's effort."""
    key: str = ""
    """Key of its sweep."""
    place: CurvePlace | None = None
    """Where it belongs; None for a colour of its own."""

    @property
    def effort(self) -> dict[str, float]:
        """Effort of the experiment in readable units, such as ``{"stroke [mm]": 1.2}``."""
        units = [readable_unit(metric.unit) for metric in self.cost]
        return {
            f"{metric.name} [{unit}]": factor * metric.value
            for metric, (factor, unit) in zip(self.cost, units, strict=True)
        }

    def index_near(self, spot: float) -> int | None:
        """Return the index of the settled point nearest to a frequency [Hz]; None if none is near enough."""
        distance = np.where(self.settled & np.isfinite(self.magnitude), np.abs(np.log(self.frequency / spot)), np.inf)
        index = int(np.argmin(distance)) if len(distance) else 0
        return index if len(distance) and distance[index] <= np.log(FREQUENCY_FACTOR) else None

    @property
    def coverage(self) -> float:
        """Share of the 95 % limits at settled points that cover P(jω); NaN if none is known."""
        bands = np.stack([self.magnitude_band, self.phase_band])[:, :, self.settled]
        known = ~np.isnan(bands).any(axis=1)
        covered = (bands[:, 0] <= 0) & (bands[:, 1] >= 0)
        return float(covered[known].mean()) if known.any() else np.nan


@dataclass(frozen=True)
class ErrorsInfo:
    """Contents of a figure of errors."""

    curves: tuple[ErrorCurve, ...]
    spots: tuple[float, ...]
    """Frequencies [Hz] of the table's columns."""
    title: str

    @property
    def effort(self) -> tuple[str, ...]:
        """Titles of the known efforts of the experiments."""
        return tuple(dict.fromkeys(name for curve in self.curves for name in curve.effort))


def errors_info(
    shown: Sequence[ShownResult], title: str = "", spots: Sequence[float] = TABLE_FREQUENCIES_HZ
) -> ErrorsInfo:
    """Return the errors of the responses whose plant is known; FraexpError if there is none.

    `spots` outside of the range of the responses are left out.
    """
    curves = tuple(
        _error_curve(of, of.response, of.truth) for of in shown if of.truth is not None and of.response is not None
    )
    if not curves:
        raise FraexpError("errors: found no response of a simulated plant; choose sweeps of a loop, in m/N")
    low = min(float(curve.frequency[0]) for curve in curves) / FREQUENCY_FACTOR
    high = max(float(curve.frequency[-1]) for curve in curves) * FREQUENCY_FACTOR
    in_range = tuple(spot for spot in spots if low <= spot <= high)
    return ErrorsInfo(curves, in_range, title or "Error against P(jω)")


def _error_curve(of: ShownResult, response: FrequencyResponse, truth: NDArray[np.complex128]) -> ErrorCurve:
    """Return the error of a response against P(jω), shape (n,), at its own frequencies."""
    with np.errstate(invalid="ignore"):  # where the machine did not move
        ratio = response.response / truth
    band, turn = confidence_limits(response)
    magnitude, phase = decibel(ratio), degrees(ratio)
    return ErrorCurve(
        label=of.label,
        frequency=response.frequency,
        magnitude=magnitude,
        phase=phase,
        settled=response.settled,
        magnitude_band=magnitude + decibel_limits(band),
        phase_band=phase + degree_limits(turn),
        cost=tuple(metric for name in EFFORT for metric in of.result.metrics if metric.name == name),
        key=of.key,
        place=of.place,
    )


def draw_errors(info: ErrorsInfo) -> "Figure":
    """Draw the errors of magnitude and phase over frequency above a table.

    Many curves are spread over panels side by side: facets by their places, or else in order.
    """
    if len(info.curves) > MAX_SINGLE_CURVES:
        raise FraexpError(
            f"errors: found {len(info.curves)} responses; no more than {MAX_SINGLE_CURVES} can be distinguished"
        )
    with canvas.figure_style():
        places, is_numbered = _error_places(info.curves)
        facets, styles = facet_indices(places), _error_styles(places, is_numbered)
        table = FigureTable(*_table_cells(info, facets if is_numbered else {}))
        width = max(9.0, table.width, 1.2 + 3.9 * len(facets))
        figure = canvas.new_figure(width, height=6.4 + table.height)
        parts: Any = figure.subfigures(2, 1, height_ratios=(6.4, table.height))
        panels = parts[0].subplots(2, len(facets), squeeze=False, sharex=True, sharey="row")
        for row, panel in zip(panels, error_panels(info.curves, "error", places), strict=True):
            row[0].set_ylabel(panel.title)
            for axes, indices in zip(row, facets.values(), strict=True):
                draw_panel(axes, panel, [panel.lines[index] for index in indices], styles)
        for name, (upper, lower) in zip(facets, panels.T, strict=True):
            upper.set_title(drawable(name), fontsize=11, loc="left")
            lower.set_xlabel("Frequency [Hz]")
        parts[0].suptitle(canvas.wrapped_title(figure, info.title), fontsize=12.5)
        canvas.set_log_abscissa(panels[1, 0], frequency_span(info.curves))
        canvas.draw_grid(*panels.flat)
        parts[0].align_ylabels(panels[:, 0])
        table.draw(parts[1].subplots(), [styles[place.group] for place in places])
    return figure


def _error_places(curves: Sequence[ErrorCurve]) -> tuple[list[CurvePlace], bool]:
    """Return the places of the curves, and whether their panels are numbered: as few alike ones as curves need."""
    places = [curve.place for curve in curves if curve.place is not None and not curve.place.is_mapped]
    if len(places) == len(curves):
        return places, False
    count = -(-len(curves) // MAX_GROUPS)
    size = -(-len(curves) // count)
    names = [""] if count == 1 else [f"({chr(97 + number)})" for number in range(count)]
    return [CurvePlace(names[at // size], str(at), str(at)) for at in range(len(curves))], count > 1


def _error_styles(places: Sequence[CurvePlace], is_numbered: bool) -> dict[str, LineStyle]:
    """Return the style of each group, which repeats in panels that are numbered."""
    names = list(dict.fromkeys(of.group for of in places))
    size = max(map(len, facet_indices(places).values())) if is_numbered else len(names)
    styles = canvas.named_styles(size)
    return {name: styles[index % size] for index, name in enumerate(names)}


def error_panels(
    curves: Sequence[ErrorCurve], noun: str = "error", places: Sequence[CurvePlace | None] = ()
) -> list[Panel]:
    """Return magnitude and phase of errors; far beyond its linear range an axis is logarithmic.

    The curves are at `places`, by default at their own.
    """
    chosen = [of or OWN_PLACE for of in places or [curve.place for curve in curves]]
    panels = []
    for part, (unit, linear_range) in PARTS.items():
        lines = tuple(_line(curve, place, part) for curve, place in zip(curves, chosen, strict=True))
        greatest = max(np.nanmax(np.abs(with_gaps(line.y, line.usable)), initial=0.0) for line in lines)
        fine = linear_range if greatest > FAR_ERROR_RATIO * linear_range else None
        panels.append(Panel(f"{part.title()} {noun} [{unit}]", unit, lines, linear_range=fine, marks=(0.0,)))
    return panels


def _line(curve: ErrorCurve, place: CurvePlace, part: str) -> GroupedLine:
    band = getattr(curve, f"{part}_band")
    known = None if np.isnan(band).all() else band
    return GroupedLine(curve.label, place, curve.frequency, getattr(curve, part), curve.settled, known)


def _table_cells(info: ErrorsInfo, panels: Mapping[str, Sequence[int]]) -> tuple[list[str], list[list[str]]]:
    names = {index: f"{name} " for name, indices in panels.items() for index in indices if name}
    titles = [
        "dB, degrees",
        *(f"{spot:g} Hz" for spot in info.spots),
        *(name.replace(" ", "\n", 1) for name in info.effort),
    ]
    rows = []
    for number, curve in enumerate(info.curves):
        indices = [curve.index_near(spot) for spot in info.spots]
        effort = curve.effort
        errors = [
            "-" if i is None else f"{_number_text(curve.magnitude[i])}, {_number_text(curve.phase[i])}°"
            for i in indices
        ]
        rows.append(
            [
                drawable(f"{names.get(number, '')}{curve.label}"),
                *errors,
                *(_number_text(effort.get(name, np.nan)) for name in info.effort),
            ]
        )
    return titles, rows


def _number_text(value: float) -> str:
    """Return a number with three significant digits and no more than two decimals; ``-`` if it is unknown."""
    if not np.isfinite(value):
        return "-"
    decimals = 2 if abs(value) < 9.995 else 1 if abs(value) < 99.95 else 0
    return f"{round(value, decimals) + 0.0:.{decimals}f}"
