"""Crossover, bandwidth and margins of a feedback loop whose response was measured, with 95 % intervals."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

REFINEMENT = 16
"""Points of the spline per line of the response."""
HALF_SHARE = 0.5
"""Error of the spline over the change by leaving out every second line: of a smooth loop it is less than a tenth, near
a resonance narrower than the distance of two lines it may be all."""
HALF_POWER = float(np.sqrt(0.5))
"""Magnitude of the closed loop at its bandwidth."""


class LoopFigure(NamedTuple):
    """One figure of a loop."""

    name: str
    value: float
    half_width: float
    """Half width of its 95 % interval, in the same unit; NaN where it is unknown."""
    unit: str
    frequency: float
    """Where the loop has it [Hz]."""


class LoopResponse(NamedTuple):
    """Open loop L = C G, in ascending frequency; the closed loop is L/(1 + L)."""

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    response: NDArray[np.complex128]
    """L [1], shape (n,)."""
    along: NDArray[np.float64]
    """Half width of the 95 % interval of ln|L| [1], shape (n,); NaN where unknown."""
    across: NDArray[np.float64]
    """Half width of the 95 % interval of the phase [rad], shape (n,)."""


class _Crossing(NamedTuple):
    """A place between two lines: all that is interpolated is linear over ln f."""

    line: int
    weight: float

    def interpolate(self, values: NDArray[np.float64]) -> float:
        """Return values there."""
        return float((1 - self.weight) * values[self.line] + self.weight * values[self.line + 1])

    def slope(self, values: NDArray[np.float64]) -> float:
        """Return the difference of the values of both lines."""
        return float(values[self.line + 1] - values[self.line])

    def deviation(self, *parts: NDArray[np.float64]) -> float:
        """Return the root of the sum of squares of independent deviations of both lines."""
        weights = 1 - self.weight, self.weight
        squares = [(weight * part[self.line + at]) ** 2 for at, weight in enumerate(weights) for part in parts]
        return float(np.sqrt(sum(squares)))


def loop_figures(loop: LoopResponse) -> list[LoopFigure]:
    """Return crossover [Hz], bandwidth [Hz], and margins of phase [rad], gain [1] and modulus [1] of a stable loop.

    The crossover is the highest frequency with |L| = 1, the bandwidth the highest with |L/(1 + L)| = -3 dB from above.
    The modulus margin is the least distance of L from -1, 1/max|S|. A figure outside of the frequencies is left out.

    Between the lines ln L follows a cubic spline over ln f. The half width of an interval is that of the errors of the
    lines, of first order and independent, plus the error of the interpolation: the difference between the spline and
    straight lines, or half of that to a spline by every second line, which shows resonances.
    """
    if loop.frequency.size < 2:
        return []
    coarse = {figure.name: figure for figure in _figures(loop)}
    halves = [_figures(_refine(_every_second(loop, first))) for first in (0, 1)] if loop.frequency.size > 3 else []
    others = [{figure.name: figure.value for figure in half} for half in halves]
    return [
        _widen(figure, coarse.get(figure.name), [half[figure.name] for half in others if figure.name in half])
        for figure in _figures(_refine(loop))
    ]


def _figures(loop: LoopResponse) -> list[LoopFigure]:
    """Return the figures of a loop that is straight between its lines."""
    found = [_crossover(loop), _bandwidth(loop), _phase_margin(loop), *_gain_margins(loop), _modulus_margin(loop)]
    return [figure for figure in found if figure is not None]


def _refine(loop: LoopResponse) -> LoopResponse:
    """Return the loop at more frequencies, by a spline; the lines are among them."""
    from scipy.interpolate import CubicSpline  # half a second, and only a loop with its controller needs it

    place = np.arange(loop.frequency.size)
    between = np.linspace(0, place[-1], REFINEMENT * place[-1] + 1)
    x = np.log(loop.frequency)
    finer = np.interp(between, place, x)
    logarithm = np.log(np.abs(loop.response)) + 1j * np.unwrap(np.angle(loop.response))
    unknown = np.full(finer.size, np.nan)
    return LoopResponse(np.exp(finer), np.exp(CubicSpline(x, logarithm)(finer)), unknown, unknown)


def _every_second(loop: LoopResponse, first: int) -> LoopResponse:
    part = slice(first, None, 2)
    return LoopResponse(loop.frequency[part], loop.response[part], loop.along[part], loop.across[part])


def _widen(figure: LoopFigure, coarse: LoopFigure | None, halves: Sequence[float]) -> LoopFigure:
    """Return a figure of the spline with its interval.

    `coarse` is that of straight lines, None if they miss it; `halves` are its values by every second line.
    """
    if coarse is None:
        return figure
    differences = [abs(figure.value - coarse.value), *(HALF_SHARE * abs(figure.value - value) for value in halves)]
    return figure._replace(half_width=coarse.half_width + max(differences))


def _crossings(values: NDArray[np.float64]) -> list[_Crossing]:
    """Return where values pass 0."""
    change = np.flatnonzero(np.signbit(values[:-1]) != np.signbit(values[1:]))
    return [_Crossing(int(at), float(values[at] / (values[at] - values[at + 1]))) for at in change]


def _frequency(loop: LoopResponse, crossing: _Crossing) -> float:
    return float(np.exp(crossing.interpolate(np.log(loop.frequency))))


def _crossing_figure(
    name: str, loop: LoopResponse, crossing: _Crossing, levels: NDArray[np.float64], *deviations: NDArray[np.float64]
) -> LoopFigure:
    """Return the frequency of a crossing as a figure."""
    frequency = _frequency(loop, crossing)
    shift = crossing.deviation(*deviations) * crossing.slope(np.log(loop.frequency)) / abs(crossing.slope(levels))
    return LoopFigure(name, frequency, frequency * shift, "Hz", frequency)


def _crossover(loop: LoopResponse) -> LoopFigure | None:
    level = np.log(np.abs(loop.response))
    crossings = _crossings(level)
    return _crossing_figure("crossover", loop, crossings[-1], level, loop.along) if crossings else None


def _bandwidth(loop: LoopResponse) -> LoopFigure | None:
    level = np.log(np.abs(loop.response / (1 + loop.response)) / HALF_POWER)
    crossings = [crossing for crossing in _crossings(level) if crossing.slope(level) < 0]
    if not crossings:
        return None
    turn = 1 / (1 + loop.response)  # d ln T = d ln L/(1 + L)
    return _crossing_figure("bandwidth", loop, crossings[-1], level, turn.real * loop.along, turn.imag * loop.across)


def _phase_margin(loop: LoopResponse) -> LoopFigure | None:
    level, phase = np.log(np.abs(loop.response)), np.unwrap(np.angle(loop.response))
    found = []
    for crossing in _crossings(level):
        margin = float(np.angle(-np.exp(1j * crossing.interpolate(phase))))
        tilt = crossing.slope(phase) / crossing.slope(level)
        width = crossing.deviation(loop.across, tilt * loop.along)
        found.append(LoopFigure("phase margin", margin, width, "rad", _frequency(loop, crossing)))
    return min(found, key=lambda figure: abs(figure.value), default=None)


def _gain_margins(loop: LoopResponse) -> list[LoopFigure]:
    """Return the factors up to which the gain may rise, and down to which it may fall."""
    level, phase = np.log(np.abs(loop.response)), np.unwrap(np.angle(loop.response))
    turned = np.mod(phase, 2 * np.pi) - np.pi
    found = []
    for crossing in _crossings(turned):
        if abs(crossing.slope(turned)) > np.pi:  # the phase of 0, not of ±180°
            continue
        factor = float(np.exp(-crossing.interpolate(level)))
        tilt = crossing.slope(level) / crossing.slope(phase)
        width = factor * crossing.deviation(loop.along, tilt * loop.across)
        name = "gain margin" if factor > 1 else "gain reduction margin"
        found.append(LoopFigure(name, factor, width, "1", _frequency(loop, crossing)))
    rises = [figure for figure in found if figure.value > 1]
    falls = [figure for figure in found if figure.value <= 1]
    return [*sorted(rises, key=lambda figure: figure.value)[:1], *sorted(falls, key=lambda figure: -figure.value)[:1]]


def _modulus_margin(loop: LoopResponse) -> LoopFigure:
    distance = 1 + loop.response
    at = int(np.argmin(np.abs(distance)))
    share = loop.response[at] / distance[at]
    width = abs(distance[at]) * np.hypot(share.real * loop.along[at], share.imag * loop.across[at])
    return LoopFigure("modulus margin", float(abs(distance[at])), float(width), "1", float(loop.frequency[at]))
