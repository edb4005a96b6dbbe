"""Which points an autonomous measurement plays, each stage by what those before it have shown."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from fraexp.components.registry import Registry
from fraexp.measurement.friction_loop import FrictionLoop
from fraexp.measurement.measured_points import MeasuredPoint
from fraexp.measurement.measurement_plan import PlannedPoint
from fraexp.measurement.unknown_axis import LOWEST_HZ, UnknownAxis

LEVEL_RATIOS = (0.9, 1.4, 2.5, 6.0)
"""Amplitudes over the friction force: nearly still, just sliding, and sliding."""
COARSE_POINTS = 20
"""Frequencies of the first look at friction and plant."""
UPPER_LEVELS = (2, 3)
"""Levels at frequencies above those that show friction: where sliding hides least of the plant."""
MODE_OFFSETS = (-2.0, -0.7, 0.7, 2.0)
"""Frequencies around a mode at which it is looked at again, in half-widths of its resonance."""
MIN_HALF_WIDTH = 0.015
"""Least relative half-width of a resonance that counts."""
NEAR_LIMIT = 0.7
"""Part of a limit to which the motion of the level below may be extrapolated."""
STUCK_RATIO, MIN_SLIDING_RATIO = 0.8, 0.3
"""Friction force that is taken off an amplitude for its motion, and the least that is left, over that force."""
VALIDATION_RATIO, VALIDATION_SEED, VALIDATION_HZ = 2.0, 7, (2.0, 0.5)
"""Force [rms] of the fresh excitation over the friction force, its seed, its lowest frequency [Hz] and its highest one
over that of the measurement."""


class PointDesign:
    """Numbers and amplitudes of the points on one axis."""

    def __init__(self, axis: UnknownAxis, loop: FrictionLoop, registry: Registry) -> None:
        self._axis, self._loop, self._registry = axis, loop, registry

    def coarse(self) -> list[float]:
        """Return the frequencies of the first look [Hz], above `top` with the same ratio."""
        low, high = self._axis.top, self._axis.plant_top
        found = np.geomspace(LOWEST_HZ, low, COARSE_POINTS)
        count = int(np.ceil(np.log(high / low) / np.log(found[1] / found[0])))
        return [*found.tolist(), *np.geomspace(low, high, count + 1)[1:].tolist()]

    def fine(self, frequencies: Sequence[float], damping: Sequence[float]) -> list[float]:
        """Return frequencies [Hz] near the modes that were found, where their parameters change the response most."""
        found = []
        for frequency, ratio in zip(frequencies, damping, strict=True):
            width = max(ratio, MIN_HALF_WIDTH) * frequency
            found += [frequency + offset * width for offset in MODE_OFFSETS]
        return sorted(f for f in found if LOWEST_HZ <= f <= self._axis.plant_top)

    def between(self, frequencies: Sequence[float]) -> list[float]:
        """Return the frequencies [Hz] halfway between others, where these do not show the plant."""
        return [float(np.sqrt(low * high)) for low, high in pairwise(frequencies)]

    def level(
        self, frequencies: Sequence[float], level: int, first: int, below: Mapping[int, MeasuredPoint]
    ) -> list[PlannedPoint]:
        """Return the points of a level, the highest frequency first: it moves least.

        `first` is the number of the first frequency's point, and `below` has the point of the level below by the place
        of its frequency: what it took of a limit is extrapolated, and the amplitude kept lower where that is too much.
        Frequencies above those that show friction have no points at the lower levels.
        """
        points = []
        for place, period in enumerate(self._axis.sines(frequencies, self._registry)):
            if frequencies[place] > self._axis.top and level not in UPPER_LEVELS:
                continue
            amplitude = self._safe_amplitude(LEVEL_RATIOS[level] * self._loop.force, below.get(place))
            points.append(self._axis.point(first + place, period, amplitude))
        return points[::-1]

    def validation(self, number: int) -> PlannedPoint:
        """Return the fresh excitation: random phases, and an amplitude of its own."""
        low, ratio = VALIDATION_HZ
        period = self._axis.multisine(low, ratio * self._axis.top, VALIDATION_SEED, self._registry)
        return self._axis.point(number, period, VALIDATION_RATIO * self._loop.force)

    def _safe_amplitude(self, amplitude: float, below: MeasuredPoint | None) -> float:
        """Return an amplitude [N] that by the level below comes no nearer to a limit than `NEAR_LIMIT`."""
        limit = self._axis.limits.force
        assert limit is not None
        amplitude = min(amplitude, NEAR_LIMIT * limit)
        if below is None or below.used <= 0:
            return amplitude
        force = self._loop.force
        before = max(below.amplitude - STUCK_RATIO * force, MIN_SLIDING_RATIO * force)
        most = STUCK_RATIO * force + before * NEAR_LIMIT * self._axis.share / below.used
        return max(min(amplitude, most), below.amplitude)
