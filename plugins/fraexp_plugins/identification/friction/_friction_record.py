"""Records for friction identification: displacement, force, motion and cycles of each segment."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, Segment, Signals
from fraexp_plugins.identification._shared.stop_operator import stop_operators, turning_points

MIN_CYCLES = 4
"""Cycles below which a record is divided into parts instead, so that some can be held out."""
PART_COUNT = 8
CYCLE_STROKE_RATIO = 0.25
"""Swing over the stroke with which a reversal begins another cycle."""
MIN_QUANTISED_RATIO = 0.9
"""Fraction of a position's steps that are multiples of the smallest one, from which that is the quantisation step."""


@dataclass(frozen=True)
class FrictionRecord:
    """A record without gaps, from one segment."""

    sample_time: float
    """Sample time [s]."""
    displacement: NDArray[np.float64]
    """Displacement [m], shape (n,)."""
    force: NDArray[np.float64]
    """Friction force, or the thrust that drives mass and friction [N], shape (n,)."""
    acceleration: NDArray[np.float64] | None
    """Measured acceleration [m/s²], shape (n,), or None."""
    before: NDArray[np.float64]
    """Displacement before the record [m] since all elements were at rest or have forgotten their state, shape (m,)."""
    from_rest: bool
    """Whether the elements were at rest when it began."""
    periodic: bool
    """Whether the displacement is periodic."""
    cycle: NDArray[np.int64]
    """Number of the cycle of each sample, over all records, shape (n,)."""

    def first_known_sample(self, max_threshold: float) -> int:
        """Return the first sample at which elements up to the threshold `max_threshold` [m] have forgotten their state.

        A stop operator forgets its initial state once the motion has spanned twice its threshold.
        """
        if self.from_rest:
            return 0
        motion = np.concatenate([self.before, self.displacement])
        span = np.maximum.accumulate(motion) - np.minimum.accumulate(motion)
        known = int(np.searchsorted(span, 2 * max_threshold * (1 - 1e-12)))
        return max(known - self.before.size, 0)

    def deflections(self, thresholds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the deflections of elements with thresholds [m], from their state before the record, shape (n, N)."""
        return stop_operators(np.concatenate([self.before, self.displacement]), thresholds)[self.before.size :]

    def velocity(self) -> NDArray[np.float64]:
        """Return the velocity [m/s], shape (n,)."""
        if self.periodic:
            omega = 2 * np.pi * np.fft.rfftfreq(self.displacement.size, self.sample_time)
            return np.fft.irfft(1j * omega * np.fft.rfft(self.displacement), self.displacement.size)
        return np.gradient(self.displacement, self.sample_time)


def check_units(signals: Signals, expected: dict[str, str]) -> None:
    """Raise RecordError for a channel that is missing or has another unit: kilograms do not follow from volts."""
    for name, unit in expected.items():
        found = signals.unit(name)
        if found.replace("^", "**") != unit:
            raise RecordError(
                f"'{name}' is in {found}; expected {unit}: give the channel its gain, such as 'x * 31.5 [{unit}]'"
            )


def friction_records(signals: Signals, displacement: str, force: str, acceleration: str) -> list[FrictionRecord]:
    """Return the record of each segment; RecordError for channels that are missing or do not move."""
    check_units(signals, {displacement: "m", force: "N", **({acceleration: "m/s**2"} if acceleration else {})})
    found: list[FrictionRecord] = []
    first_cycle = 0
    for segment in signals.segments:
        record = _friction_record(segment, displacement, force, acceleration, first_cycle)
        if np.ptp(record.displacement) == 0:
            raise RecordError(f"'{displacement}' does not move; expected a back-and-forth motion: raise the excitation")
        first_cycle = int(record.cycle.max()) + 1
        found.append(record)
    if not found:
        raise RecordError("the signals are empty; expected a record of displacement and force")
    return found


def _friction_record(
    segment: Segment, displacement: str, force: str, acceleration: str, first_cycle: int
) -> FrictionRecord:
    periods = segment.channels[displacement]
    y = periods.ravel().astype(float)
    from_rest = segment.settling is not None and segment.settling.time == 0
    # A simulated record in the steady state is periodic, a measured one need not be. The Fourier transform
    # differentiates only a periodic one: of another it makes ripple from the jump between its end and its beginning.
    repeats = segment.settling is not None or len(periods) == 1
    is_periodic = segment.periodic and not from_rest and repeats
    return FrictionRecord(
        sample_time=segment.sample_time,
        displacement=y,
        force=segment.channels[force].ravel().astype(float),
        acceleration=segment.channels[acceleration].ravel().astype(float) if acceleration else None,
        before=y if is_periodic else np.empty(0),
        from_rest=from_rest,
        periodic=is_periodic,
        cycle=first_cycle + _cycles(y, len(periods)),
    )


def _cycles(displacement: NDArray[np.float64], periods: int) -> NDArray[np.int64]:
    """Return the cycle number of each sample: its period, its back-and-forth motion, or a part of the record."""
    size = displacement.size
    if periods >= MIN_CYCLES:
        return np.repeat(np.arange(periods), size // periods)
    turns = turning_points(displacement, CYCLE_STROKE_RATIO * float(np.ptp(displacement)))[::2]
    if turns.size < MIN_CYCLES:
        return np.arange(size) * PART_COUNT // size
    return np.searchsorted(turns, np.arange(size), side="right")


def quantisation_step(records: Sequence[FrictionRecord]) -> float:
    """Return the quantisation step of the encoder [m] that the positions show; 0 if they show none."""
    steps = np.abs(np.concatenate([np.diff(record.displacement) for record in records]))
    largest = float(steps.max())
    moving = steps[steps > 1e-9 * largest]
    smallest = float(np.percentile(moving, 1))
    multiples = moving / smallest
    whole = float(np.mean(np.abs(multiples - np.rint(multiples)) < 0.02))
    has_constant_velocity = largest < 1.5 * smallest and moving.size > MIN_QUANTISED_RATIO * steps.size
    return smallest if whole > MIN_QUANTISED_RATIO and not has_constant_velocity else 0.0
