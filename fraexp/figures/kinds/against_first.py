"""How responses differ from the first one, frequency by frequency, in dB and degrees."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.analysis.confidence import limits
from fraexp.data.results import FrequencyResponse
from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MANY
from fraexp.figures.elements.scales import continuous_phase, decibel, degrees
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.kinds.difference import on_frequencies
from fraexp.figures.kinds.plant_errors import FINE_DB, FINE_DEGREES, ErrorCurve, draw_part

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SLACK = 1e-9
"""Relative distance up to which two frequencies are the same."""
NEPER = 20 / np.log(10)
"""In dB."""


@dataclass(frozen=True)
class DifferenceInfo:
    """What a figure of differences shows."""

    curves: tuple[ErrorCurve, ...]
    """Each other response over the first one; not settled where one of both is not."""
    reference: str
    """Name of the first one."""
    left_out: tuple[str, ...]
    """Names of responses that share no frequency with it."""
    title: str


def difference_info(shown: Sequence[ShownResult], title: str = "") -> DifferenceInfo:
    """Return how all other responses differ from the first one; FraexpError if none can be compared with it."""
    found = [(of, of.response) for of in shown if of.response is not None]
    if len(found) < 2:
        raise FraexpError(f"difference: found {len(found)} responses; choose two sweeps at least that have one")
    if len({response.unit for _, response in found}) > 1:
        raise FraexpError("difference: found responses in several units; choose sweeps that share one")
    first, reference = found[0]
    curves = [(of.label, difference_curve(of.label, reference, response, of.key)) for of, response in found[1:]]
    known = tuple(curve for _, curve in curves if curve is not None)
    if not known:
        raise FraexpError(f"difference: no other response shares settled frequencies with the first, {first.label}")
    left_out = tuple(label for label, curve in curves if curve is None)
    return DifferenceInfo(known, first.label, left_out, title or f"Difference from {first.label}")


def difference_curve(
    label: str, reference: FrequencyResponse, other: FrequencyResponse, key: str = ""
) -> ErrorCurve | None:
    """Return how `other` differs from `reference` at its settled frequencies; None if they share none.

    Where the grids differ `other` is interpolated, ln|G| and the unwrapped phase linear in log frequency; a point
    between two of its frequencies of which one had not settled has not settled either. The 95 % limits are those of
    independent estimates.
    """
    base, order = _usable(reference), np.argsort(other.frequency, kind="stable")
    usable = _usable(other)[order]
    theirs, response = other.frequency[order][usable], other.response[order][usable]
    ascending = np.argsort(reference.frequency[base], kind="stable")
    frequency = reference.frequency[base][ascending]
    if not len(theirs) or not len(frequency):
        return None
    inside = (frequency >= theirs[0] * (1 - SLACK)) & (frequency <= theirs[-1] * (1 + SLACK))
    if not inside.any():
        return None
    chosen = np.flatnonzero(base)[ascending][inside]
    frequency = frequency[inside]
    ratio = on_frequencies(frequency, theirs, response) / reference.response[chosen]
    settled = _between(frequency, other.frequency[order], usable)
    magnitude, phase = decibel(ratio), continuous_phase(degrees(ratio), settled, np.zeros(len(frequency)))
    nearest = order[_nearest(frequency, other.frequency[order])]
    theirs_band, own_band = _logarithmic(other, nearest), _logarithmic(reference, chosen)
    spread = [_together(of, to) for of, to in zip(theirs_band, own_band, strict=True)]
    return ErrorCurve(
        label=label,
        frequency=frequency,
        magnitude=magnitude,
        phase=phase,
        settled=settled,
        magnitude_band=magnitude + NEPER * spread[0],
        phase_band=phase + np.clip(np.degrees(spread[1]), -360, 360),
        key=key,
    )


def _usable(response: FrequencyResponse) -> np.ndarray:
    usable: np.ndarray = response.settled & np.isfinite(response.response) & (response.response != 0)
    return usable


def _nearest(frequency: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return the index of the frequency nearest to each, shape (n,), in an ascending grid."""
    right = np.clip(np.searchsorted(grid, frequency), 1, max(len(grid) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(grid) - 1)
    closer: np.ndarray = np.where(frequency - grid[left] <= grid[right] - frequency, left, right)
    return closer


def _between(frequency: np.ndarray, grid: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Return whether each frequency is one of the grid's usable ones, or has such ones on both sides, shape (n,)."""
    nearest = _nearest(frequency, grid)
    same = np.abs(grid[nearest] / frequency - 1) <= SLACK
    right = np.clip(np.searchsorted(grid, frequency), 0, len(grid) - 1)
    sides: np.ndarray = np.where(same, usable[nearest], usable[right] & usable[np.maximum(right - 1, 0)])
    return sides


def _logarithmic(response: FrequencyResponse, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the 95 % limits of ln|G| and of the phase [rad], each of shape (2, n)."""
    size, turn = (each[:, chosen] for each in limits(response))
    with np.errstate(divide="ignore"):
        return np.log(np.maximum(size, 0)), turn


def _together(of: np.ndarray, to: np.ndarray) -> np.ndarray:
    """Return the limits of a difference from those of its parts, shape (2, n)."""
    return np.stack([-np.hypot(of[0], to[1]), np.hypot(of[1], to[0])])


def draw_difference(info: DifferenceInfo) -> "Figure":
    """Draw the differences of magnitude and phase over frequency."""
    from fraexp.figures.elements import canvas  # matplotlib: imported only when something is drawn

    if len(info.curves) > MANY:
        raise FraexpError(f"difference: found {len(info.curves) + 1} responses; {MANY + 1} at most can be told apart")
    with canvas.styled():
        figure = canvas.new_figure(width=9.0, height=6.2)
        upper, lower = figure.subplots(2, 1, sharex=True)
        styles = canvas.named_styles(len(info.curves) + 1)[1:]  # the reference keeps the colour of the Bode plot
        draw_part(upper, info.curves, "magnitude", styles, FINE_DB)
        draw_part(lower, info.curves, "phase", styles, FINE_DEGREES)
        upper.set_title(canvas.heading(figure, info.title))
        upper.set_ylabel("Magnitude difference [dB]")
        lower.set_ylabel("Phase difference [deg]")
        lower.set_xlabel("Frequency [Hz]")
        frequency = np.concatenate([curve.frequency for curve in info.curves])
        canvas.frequency_axis(lower, (float(frequency.min()), float(frequency.max())))
        canvas.grid(upper, lower)
        figure.align_ylabels((upper, lower))
        canvas.legend_below(figure, upper)
    return figure
