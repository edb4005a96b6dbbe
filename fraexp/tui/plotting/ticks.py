"""Ticks that fit into the room of an axis: decades on logarithmic axes, fractions of a turn for phases."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import ceil, floor, log10

MANTISSAS = ((1, 2, 3, 4, 5, 6, 7, 8, 9), (1, 2, 3, 5, 7), (1, 2, 5), (1,))
"""Mantissas of the ticks within a decade, finest first."""
ANGLE_STEPS_DEG = (0.1, 0.2, 0.5, 1, 2, 5, 15, 30, 45, 90, 180, 360, 720, 1440, 3600)
"""Tick spacings of an angle [deg]."""


def tick_text(value: float) -> str:
    """Return the label of a tick: short, with k for thousands and so on."""
    for factor, letter in ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= factor:
            return f"{value / factor:.6g}{letter}"
    return f"{value:.6g}"


class TickFormatter:
    """Ticks of an axis that is `room` cells long; horizontal labels must not touch."""

    def __init__(self, room: int, upright: bool = False, logarithmic: bool = False, angle: bool = False) -> None:
        """Make ticks; `logarithmic` axes have log10 of their quantity, an `angle` is in degrees."""
        self.room, self.upright, self.logarithmic, self.angle = max(room, 1), upright, logarithmic, angle

    def ticks(self, low: float, high: float) -> list[tuple[float, str]]:
        """Return the finest ticks that fit, each with its label."""
        found: list[float] = []
        for ticks in self._candidates(low, high):
            if len(ticks) > len(found) and self._has_room(ticks, low, high):
                found = ticks
        return [(tick, self._label(tick)) for tick in found]

    def _label(self, tick: float) -> str:
        return tick_text(self._value(tick))

    def _value(self, tick: float) -> float:
        """Return the value at a tick, free of rounding."""
        return float(f"{10**tick if self.logarithmic else tick:.9g}") + 0.0

    def _candidates(self, low: float, high: float) -> Iterator[list[float]]:
        if not self.logarithmic:
            yield from _multiples(low, high, ANGLE_STEPS_DEG if self.angle else (), self.room)
            return
        for mantissas in MANTISSAS:
            decades = range(floor(low), ceil(high) + 1)
            yield [tick for of in decades for m in mantissas if low <= (tick := of + log10(m)) <= high]
        for step in (2, 3, 5, 10):
            yield [float(of) for of in range(ceil(low), floor(high) + 1) if of % step == 0]
        if high - low < 1:
            for ticks in _multiples(10**low, 10**high, (), self.room):
                yield [log10(tick) for tick in ticks if tick > 0]

    def _has_room(self, ticks: Sequence[float], low: float, high: float) -> bool:
        if len(ticks) > self.room:
            return False
        cell = (high - low) / self.room
        gaps = [(after - before) / cell for before, after in pairwise(ticks)]
        if self.upright:
            return all(gap >= min(2, self.room / 4) for gap in gaps)
        widths = [len(self._label(tick)) for tick in ticks]
        return all(gap >= width + 2 for gap, width in zip(gaps, widths[1:], strict=True))


def _multiples(low: float, high: float, steps: Sequence[float], most: int) -> Iterator[list[float]]:
    """Yield the multiples of each step between two values, if they are at most `most`; without steps, use 1, 2 and 5
    times powers of ten.
    """
    if not steps or high - low < 2 * steps[0]:
        power = floor(log10(high - low))
        steps = [mantissa * 10.0**of for of in range(power - 2, power + 1) for mantissa in (1, 2, 5)]
    for step in steps:
        if (high - low) / step < most + 1:
            yield [float(f"{index * step:.12g}") for index in range(ceil(low / step), floor(high / step) + 1)]
