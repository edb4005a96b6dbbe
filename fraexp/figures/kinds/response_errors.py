"""Errors of responses against the plant that was simulated, and differences between responses, in dB and degrees."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import EFFORT, FrequencyResponse, Metric
from fraexp.errors import FraexpError
from fraexp.figures.elements.frequency_lines import GroupedLine, PhasedCurve, with_gaps
from fraexp.figures.elements.grouping import OWN_PLACE, CurvePlace, ShownResult, curve_places
from fraexp.figures.elements.panel_figure import Panel, PanelFigure, over_frequency
from fraexp.figures.elements.scales import (
    continuous_phase,
    decibel,
    decibel_limits,
    degree_limits,
    degrees,
    readable_unit,
)

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
    place: CurvePlace = OWN_PLACE
    """Where it belongs."""

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
    """Errors of responses, for a figure, and for a table at some frequencies."""

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
        _error_curve(of, of.response, of.truth, place)
        for of, place in zip(shown, curve_places(shown), strict=True)
        if of.truth is not None and of.response is not None
    )
    if not curves:
        raise FraexpError("errors: found no response of a simulated plant; choose sweeps of a loop, in m/N")
    low = min(float(curve.frequency[0]) for curve in curves) / FREQUENCY_FACTOR
    high = max(float(curve.frequency[-1]) for curve in curves) * FREQUENCY_FACTOR
    in_range = tuple(spot for spot in spots if low <= spot <= high)
    return ErrorsInfo(curves, in_range, title or "Error against P(jω)")


def _error_curve(
    of: ShownResult, response: FrequencyResponse, truth: NDArray[np.complex128], place: CurvePlace
) -> ErrorCurve:
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
        place=place,
    )


def errors_figure(info: ErrorsInfo) -> PanelFigure:
    """Return the errors of magnitude and phase over frequency."""
    return over_frequency(info.title, *error_panels(info.curves))


def error_panels(curves: Sequence[ErrorCurve], noun: str = "error") -> list[Panel]:
    """Return magnitude and phase of errors; far beyond its linear range an axis is logarithmic."""
    panels = []
    for part, (unit, linear_range) in PARTS.items():
        lines = tuple(_line(curve, part) for curve in curves)
        greatest = max(np.nanmax(np.abs(with_gaps(line.y, line.usable)), initial=0.0) for line in lines)
        fine = linear_range if greatest > FAR_ERROR_RATIO * linear_range else None
        panels.append(Panel(f"{part.title()} {noun} [{unit}]", unit, lines, linear_range=fine, marks=(0.0,)))
    return panels


def _line(curve: ErrorCurve, part: str) -> GroupedLine:
    band = getattr(curve, f"{part}_band")
    known = None if np.isnan(band).all() else band
    return GroupedLine(curve.label, curve.place, curve.frequency, getattr(curve, part), curve.settled, known)


FREQUENCY_TOLERANCE = 1e-9
"""Relative distance up to which two frequencies are the same."""
DB_PER_NEPER = 20 / np.log(10)
"""Decibels in a neper."""


@dataclass(frozen=True)
class Difference:
    """Maximum and root-mean-square difference of two responses over their common frequencies."""

    points: int
    """Number of frequencies compared, all settled."""
    low: float
    """Lowest frequency compared [Hz]."""
    high: float
    """Highest frequency compared [Hz]."""
    interpolated: bool
    """Whether the other response was interpolated because the grids differ."""
    magnitude_max: float
    """Largest difference of the magnitudes, with its sign [dB]."""
    magnitude_max_at: float
    """Its frequency [Hz]."""
    magnitude_rms: float
    """Root mean square of the difference of the magnitudes [dB]."""
    phase_max: float
    """Largest difference of the phases, with its sign [deg]."""
    phase_max_at: float
    """Its frequency [Hz]."""
    phase_rms: float
    """Root mean square of the difference of the phases [deg]."""


class _CommonPoints(NamedTuple):
    """The ratio of a response to a reference at the usable frequencies of that; n of them."""

    frequency: NDArray[np.float64]
    """Ascending frequency [Hz], shape (n,)."""
    chosen: NDArray[np.intp]
    """Index of each in the reference, shape (n,)."""
    ratio: NDArray[np.complex128]
    """Shape (n,)."""
    usable: NDArray[np.bool_]
    """Whether each point of the other response is settled and known."""


def _common_points(reference: FrequencyResponse, other: FrequencyResponse) -> _CommonPoints | None:
    """Return the ratio of `other` to `reference`, which is interpolated where the grids differ; None without one.

    The frequencies of both ascend.
    """
    chosen, usable = np.flatnonzero(_usable(reference)), _usable(other)
    theirs, frequency = other.frequency[usable], reference.frequency[chosen]
    if len(theirs):
        low, high = theirs[0] * (1 - FREQUENCY_TOLERANCE), theirs[-1] * (1 + FREQUENCY_TOLERANCE)
        inside = (low <= frequency) & (frequency <= high)
        frequency, chosen = frequency[inside], chosen[inside]
    if not len(theirs) or not len(frequency):
        return None
    found = on_frequencies(frequency, theirs, other.response[usable])
    return _CommonPoints(frequency, chosen, found / reference.response[chosen], usable)


def response_difference(reference: FrequencyResponse, other: FrequencyResponse) -> Difference | None:
    """Return the difference of `other` from `reference`; None without a common frequency or unit.

    Where the grids differ, `other` is interpolated: ln|G| and the unwrapped phase, linear in log frequency.
    """
    reference, other = reference.ascending(), other.ascending()
    common = _common_points(reference, other) if reference.unit == other.unit else None
    if common is None:
        return None
    theirs, frequency = other.frequency[common.usable], common.frequency
    distance = np.abs(theirs[_nearest_index(frequency, theirs)] - frequency)
    interpolated = bool(np.any(distance > FREQUENCY_TOLERANCE * frequency))
    return _summary(frequency, decibel(common.ratio), degrees(common.ratio), interpolated)


def on_frequencies(
    frequency: NDArray[np.float64], grid: NDArray[np.float64], response: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return a response given on an ascending `grid` at other frequencies: ln|G| and phase, linear in log frequency."""
    logarithm = np.log(np.abs(response)) + 1j * np.unwrap(np.angle(response))
    value: NDArray[np.complex128] = np.exp(np.interp(np.log(frequency), np.log(grid), logarithm))
    return value


def _summary(
    frequency: NDArray[np.float64], magnitude: NDArray[np.float64], phase: NDArray[np.float64], interpolated: bool
) -> Difference:
    loudest, furthest = int(np.argmax(np.abs(magnitude))), int(np.argmax(np.abs(phase)))
    return Difference(
        points=len(frequency),
        low=float(frequency[0]),
        high=float(frequency[-1]),
        interpolated=interpolated,
        magnitude_max=float(magnitude[loudest]),
        magnitude_max_at=float(frequency[loudest]),
        magnitude_rms=float(np.sqrt(np.mean(magnitude**2))),
        phase_max=float(phase[furthest]),
        phase_max_at=float(frequency[furthest]),
        phase_rms=float(np.sqrt(np.mean(phase**2))),
    )


@dataclass(frozen=True)
class DifferenceInfo:
    """Contents of a figure of differences."""

    curves: tuple[ErrorCurve, ...]
    """Ratio of each other response to the first one; it is settled where both are."""
    reference: str
    """Name of the first response."""
    left_out: tuple[str, ...]
    """Names of responses without a common frequency."""
    title: str


def difference_info(shown: Sequence[ShownResult], title: str = "") -> DifferenceInfo:
    """Return the differences of all responses from the first one; FraexpError if none can be compared with it."""
    found = [(of, of.response) for of in shown if of.response is not None]
    if len(found) < 2:
        raise FraexpError(f"difference: found {len(found)} responses; choose at least two sweeps with a response")
    if len({response.unit for _, response in found}) > 1:
        raise FraexpError("difference: found responses in several units; choose sweeps that share one")
    first, reference = found[0]
    places = curve_places([of for of, _ in found])
    curves = [
        (of.label, difference_curve(of.label, reference, response, of.key, place))
        for (of, response), place in zip(found[1:], places[1:], strict=True)
    ]
    known = tuple(curve for _, curve in curves if curve is not None)
    if not known:
        raise FraexpError(f"difference: no other response shares settled frequencies with the first, {first.label}")
    left_out = tuple(label for label, curve in curves if curve is None)
    return DifferenceInfo(known, first.label, left_out, title or f"Difference from {first.label}")


def difference_curve(
    label: str, reference: FrequencyResponse, other: FrequencyResponse, key: str = "", place: CurvePlace = OWN_PLACE
) -> ErrorCurve | None:
    """Return the difference of `other` from `reference` at the settled frequencies; None if they share none.

    Where the grids differ `other` is interpolated, ln|G| and the unwrapped phase linear in log frequency; a point
    between two of its frequencies counts as settled only if both are. The 95 % limits are those of
    independent estimates.
    """
    reference, other = reference.ascending(), other.ascending()
    common = _common_points(reference, other)
    if common is None:
        return None
    frequency, chosen, ratio, usable = common
    settled = _is_between_usable(frequency, other.frequency, usable)
    magnitude, phase = decibel(ratio), continuous_phase(degrees(ratio), settled, np.zeros(len(frequency)))
    nearest = _nearest_index(frequency, other.frequency)
    theirs_band, own_band = _log_limits(other, nearest), _log_limits(reference, chosen)
    spread = [_combined_limits(of, to) for of, to in zip(theirs_band, own_band, strict=True)]
    return ErrorCurve(
        label=label,
        frequency=frequency,
        magnitude=magnitude,
        phase=phase,
        settled=settled,
        magnitude_band=magnitude + DB_PER_NEPER * spread[0],
        phase_band=phase + degree_limits(spread[1]),
        key=key,
        place=place,
    )


def _usable(response: FrequencyResponse) -> NDArray[np.bool_]:
    usable: NDArray[np.bool_] = response.settled & np.isfinite(response.response) & (response.response != 0)
    return usable


def _nearest_index(frequency: NDArray[np.float64], grid: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the index of the nearest frequency in an ascending grid, shape (n,)."""
    right = np.clip(np.searchsorted(grid, frequency), 1, max(len(grid) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(grid) - 1)
    closer: NDArray[np.intp] = np.where(frequency - grid[left] <= grid[right] - frequency, left, right)
    return closer


def _is_between_usable(
    frequency: NDArray[np.float64], grid: NDArray[np.float64], usable: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return whether each frequency is a usable one of the grid, or lies between two usable ones, shape (n,)."""
    nearest = _nearest_index(frequency, grid)
    same = np.abs(grid[nearest] / frequency - 1) <= FREQUENCY_TOLERANCE
    right = np.clip(np.searchsorted(grid, frequency), 0, len(grid) - 1)
    sides: NDArray[np.bool_] = np.where(same, usable[nearest], usable[right] & usable[np.maximum(right - 1, 0)])
    return sides


def _log_limits(
    response: FrequencyResponse, chosen: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the 95 % limits of ln|G| and of the phase [rad], each of shape (2, n)."""
    size, turn = (each[:, chosen] for each in confidence_limits(response))
    with np.errstate(divide="ignore"):
        return np.log(np.maximum(size, 0)), turn


def _combined_limits(of: NDArray[np.float64], to: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the limits of a difference from those of its independent parts, shape (2, n)."""
    return np.stack([-np.hypot(of[0], to[1]), np.hypot(of[1], to[0])])


def difference_figure(info: DifferenceInfo) -> PanelFigure:
    """Return the differences of magnitude and phase over frequency."""
    return over_frequency(info.title, *error_panels(info.curves, "difference"))
