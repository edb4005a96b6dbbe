"""What friction identification sees of signals: displacement, force, motion and cycles, stretch by stretch."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fraexp.api import RecordError, Segment, Signals
from fraexp_plugins.identification.stop_operator import turning_points

FEW_CYCLES = 4
"""Cycles below which a stretch is divided into parts instead: something must be left to judge by."""
PARTS = 8
GROSS = 0.25
"""Part of the stroke by which a motion must turn to begin another cycle."""
QUANTISED = 0.9
"""Share of the steps of a position that are whole multiples of the smallest one, where that is the scale's."""


@dataclass(frozen=True)
class Stretch:
    """A stretch of a record without gaps."""

    sample_time: float
    """Sample time [s]."""
    displacement: np.ndarray
    """Displacement [m], shape (n,)."""
    force: np.ndarray
    """Friction force, or the thrust that drives mass and friction [N], shape (n,)."""
    acceleration: np.ndarray | None
    """Measured acceleration [m/s²], shape (n,), or None."""
    before: np.ndarray
    """Displacement just before [m], from where every element was at rest or since when it has forgotten, shape (m,)."""
    from_rest: bool
    """Whether the elements were at rest when it began."""
    periodic: bool
    """Whether the displacement goes on from its end to its beginning."""
    cycle: np.ndarray
    """Number of the cycle of each sample, over all stretches, shape (n,) of int."""

    def known_from(self, widest: float) -> int:
        """Return the first sample at which elements up to the threshold `widest` [m] have forgotten their beginning.

        A stop operator has, whatever its state was, once the motion has spanned twice its threshold.
        """
        if self.from_rest:
            return 0
        motion = np.concatenate([self.before, self.displacement])
        span = np.maximum.accumulate(motion) - np.minimum.accumulate(motion)
        known = int(np.searchsorted(span, 2 * widest * (1 - 1e-12)))
        return max(known - self.before.size, 0)

    def velocity(self) -> np.ndarray:
        """Return the velocity [m/s], shape (n,)."""
        if self.periodic:
            omega = 2 * np.pi * np.fft.rfftfreq(self.displacement.size, self.sample_time)
            return np.fft.irfft(1j * omega * np.fft.rfft(self.displacement), self.displacement.size)
        found: np.ndarray = np.gradient(self.displacement, self.sample_time)
        return found


CLEARLY = 0.8
"""Error with a thrust that is not held, over that with one that is, below which it is not: most are held."""
HOLD = "whether the thrust is held between samples; tried both ways if none is given, unless the signals are simulated"
"""Help of a parameter `hold`."""


def held_or_not(signals: Signals, hold: bool | None, error: Callable[[bool], float]) -> tuple[bool, list[str]]:
    """Return whether the thrust is held between samples, and what is to be said of how that is known.

    A simulated thrust is; of a measured one, that of a controller's output is, and that of a force sensor is not: what
    the model leaves, the root mean square `error` [N], tells them apart.
    """
    if hold is not None or signals.numerics:
        return hold is not False, []
    if error(False) >= CLEARLY * error(True):
        return True, []
    return False, ["the thrust is taken as not held between samples, as that of a sensor, which fits better (hold)"]


def check_units(signals: Signals, expected: dict[str, str]) -> None:
    """Raise RecordError for a channel that is missing or of another unit: kilograms do not follow from volts."""
    for name, unit in expected.items():
        found = signals.unit(name)
        if found.replace("^", "**") != unit:
            raise RecordError(
                f"'{name}' is in {found}; expected {unit}: give the channel its gain, as in 'x * 31.5 [{unit}]'"
            )


def stretches_of(signals: Signals, displacement: str, force: str, acceleration: str) -> list[Stretch]:
    """Return the stretches of the signals; RecordError for channels that are missing or do not move."""
    check_units(signals, {displacement: "m", force: "N", **({acceleration: "m/s**2"} if acceleration else {})})
    found: list[Stretch] = []
    begun = 0
    for segment in signals.segments:
        stretch = _stretch(segment, displacement, force, acceleration, begun)
        if np.ptp(stretch.displacement) == 0:
            raise RecordError(f"'{displacement}' does not move; expected a motion to and fro: raise the excitation")
        begun = int(stretch.cycle.max()) + 1
        found.append(stretch)
    if not found:
        raise RecordError("the signals are empty; expected a record of displacement and force")
    return found


def _stretch(segment: Segment, displacement: str, force: str, acceleration: str, begun: int) -> Stretch:
    periods = segment.channels[displacement]
    y = periods.ravel().astype(float)
    from_rest = segment.settling is not None and segment.settling.time == 0
    # A simulated record that has settled repeats itself, a measured one need not.
    repeats = not from_rest and (segment.settling is not None or len(periods) == 1)
    return Stretch(
        sample_time=segment.sample_time,
        displacement=y,
        force=segment.channels[force].ravel().astype(float),
        acceleration=segment.channels[acceleration].ravel().astype(float) if acceleration else None,
        before=y if repeats else np.empty(0),
        from_rest=from_rest,
        periodic=repeats,
        cycle=begun + _cycles(y, len(periods)),
    )


def _cycles(displacement: np.ndarray, periods: int) -> np.ndarray:
    """Return the number of the cycle of each sample: its period, its turn of the motion, or a part of the stretch."""
    size = displacement.size
    if periods >= FEW_CYCLES:
        return np.repeat(np.arange(periods), size // periods)
    turns = turning_points(displacement, GROSS * float(np.ptp(displacement)))[::2]
    if turns.size < FEW_CYCLES:
        return np.arange(size) * PARTS // size
    return np.searchsorted(turns, np.arange(size), side="right")


def resolution_of(stretches: list[Stretch]) -> float:
    """Return the step of the scale [m] that the positions show, or 0 where they are not quantised."""
    steps = np.abs(np.concatenate([np.diff(stretch.displacement) for stretch in stretches]))
    greatest = float(steps.max())
    moving = steps[steps > 1e-9 * greatest]
    smallest = float(np.percentile(moving, 1))
    multiples = moving / smallest
    whole = float(np.mean(np.abs(multiples - np.rint(multiples)) < 0.02))
    alike = greatest < 1.5 * smallest and moving.size > QUANTISED * steps.size  # a constant velocity
    return smallest if whole > QUANTISED and not alike else 0.0
