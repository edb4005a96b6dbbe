"""The limits of a machine, watched while it moves."""

import numpy as np
from numpy.typing import NDArray

from fraexp.components.machine_session import Chunk
from fraexp.simulation.motion_limits import DEMAND_UNITS, Demand, MotionLimits

DIFFERENCE_TIME_S = 1e-3
"""Time over which the position is differenced: the encoder's steps then count little."""
MAX_CYCLES = 0.4
"""Cycles of the highest frequency in that time at most: with half a cycle a sine differenced would show nothing."""

NOT_FINITE = "the machine recorded values that are not finite numbers"
"""How the fault of a broken sample begins, which is no limit that was exceeded."""


class MotionGuard:
    """Compares recorded motion with limits; what it has seen goes on from one play to the next."""

    def __init__(self, limits: MotionLimits, sample_time: float, share: float = 1.0) -> None:
        self.limits, self._sample_time = limits, sample_time
        self.share = share
        """Part of each limit that may be reached."""
        self._low, self._high = self._range_before = np.inf, -np.inf
        self._was_exceeded = False
        self.seen = Demand(0.0, 0.0, 0.0, 0.0, 0.0)
        """The greatest motion and force so far."""
        self.begin(0.0)

    def begin(self, highest_frequency: float) -> None:
        """Begin a play, of which the highest frequency [Hz] is given.

        The range of positions goes on from those before, but for plays that exceeded a limit: played again with a lower
        amplitude, a point would exceed it at once.
        """
        if self._was_exceeded:
            self._low, self._high = self._range_before
        self._range_before, self._was_exceeded = (self._low, self._high), False
        lag = max(round(DIFFERENCE_TIME_S / self._sample_time), 1)
        if highest_frequency:
            lag = max(min(lag, int(MAX_CYCLES / (highest_frequency * self._sample_time))), 1)
        self._lag = lag
        self._correction = 1 / float(np.sinc(min(highest_frequency * lag * self._sample_time, MAX_CYCLES)))
        self._last = np.empty((2, 0))
        self.of_play = Demand(0.0, 0.0, 0.0, 0.0, 0.0)
        """The greatest motion and force of this play."""

    def look(self, chunk: Chunk) -> str:
        """Take note of what was recorded; return which limit it exceeds, in words, or an empty text."""
        position, force = chunk.channels["y"], chunk.channels["u"]
        for name, samples in (("y", position), ("u", force)):
            if not np.isfinite(samples).all():
                return f"{NOT_FINITE} in channel {name}"
        found = self._demand(position, force)
        self.of_play, self.seen = self.of_play.maximum_with(found), self.seen.maximum_with(found)
        for name, value, unit in zip(Demand._fields, found, DEMAND_UNITS, strict=True):
            allowed = getattr(self.limits, name)
            if allowed is not None and value > self.share * allowed:
                self._was_exceeded = True
                part = "" if self.share == 1 else f"{self.share:.0%} of "
                return (
                    f"the {name.replace('_', ' ')} was {value:.4g} {unit}; {part}limits.{name} is "
                    f"{self.share * allowed:.4g} {unit}"
                )
        return ""

    def nearest(self) -> float:
        """Return the greatest part of a limit that this play has reached."""
        return max(
            value / allowed
            for name, value in self.of_play._asdict().items()
            if (allowed := getattr(self.limits, name)) is not None
        )

    def _demand(self, position: NDArray[np.float64], force: NDArray[np.float64]) -> Demand:
        both = np.hstack([self._last, [position, force]])
        self._last = both[:, -2 * self._lag :]
        self._low, self._high = min(self._low, position.min()), max(self._high, position.max())
        lag, step = self._lag, self._lag * self._sample_time
        velocity = np.abs(both[0, lag:] - both[0, :-lag]).max(initial=0.0) / step
        acceleration = (
            np.abs(both[0, 2 * lag :] - 2 * both[0, lag:-lag] + both[0, : -2 * lag]).max(initial=0.0) / step**2
        )
        rate = np.abs(np.diff(both[1])).max(initial=0.0) / self._sample_time
        return Demand(
            float(self._high - self._low),
            float(velocity * self._correction),
            float(acceleration * self._correction**2),
            float(np.abs(force).max()),
            float(rate),
        )
