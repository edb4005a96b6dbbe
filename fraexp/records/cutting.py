"""Cutting a record into blocks of whole periods and whole samples."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from fraexp.errors import RecordError
from fraexp.records.settings import RecordSettings, Step

ROUNDING = 1e-9
"""Relative difference of samples and periods that is rounding of what the study says."""
BLOCKS = 2
"""Least number of blocks: their scatter is the variance."""


@dataclass(frozen=True)
class Cut:
    """Consecutive blocks of equal length, each of whole periods: the plan of a segment."""

    start: int
    """Index of the first sample."""
    blocks: int
    samples: int
    """Samples per block."""
    periods: int
    """Periods per block."""
    sample_time: float
    """Sample time [s] at which the block is exactly of whole periods: the record's, within the slip."""
    lines: tuple[int, ...] = ()
    """Excited harmonics of the block."""

    def blocks_of(self, channel: np.ndarray) -> np.ndarray:
        """Return the blocks of a channel, shape (blocks, samples)."""
        return channel[self.start : self.start + self.blocks * self.samples].reshape(self.blocks, self.samples)

    def plain(self) -> dict[str, Any]:
        """Return the plain data that identifies the segment."""
        return {
            "start": self.start,
            "periods": self.blocks,
            "samples": self.samples,
            "sample_time": self.sample_time,
            "lines": list(self.lines),
        }

    @classmethod
    def of(cls, data: Any) -> "Cut":
        """Return the cut that `plain` described."""
        return cls(data["start"], data["periods"], data["samples"], 1, data["sample_time"], tuple(data["lines"]))


def coherent(period: float, available: float, slip: float) -> tuple[int, int] | None:
    """Return the fewest samples that hold whole periods, and how many, so that two blocks fit into `available` samples.

    `period` is in samples; `slip` is the greatest difference of the two, in periods. None if there are none.
    """
    periods = np.arange(1, int(available / BLOCKS / period + slip) + 1)
    samples = np.rint(periods * period)
    fitting = np.flatnonzero((np.abs(samples - periods * period) <= slip * period) & (BLOCKS * samples <= available))
    return (int(samples[fitting[0]]), int(periods[fitting[0]])) if fitting.size else None


def periodic_cut(settings: RecordSettings, rate: float, length: int, place: str) -> Cut:
    """Return the blocks of a periodic record, without its lines."""
    period = float(settings.period) if settings.period else (settings.period_time or 0.0) * rate
    start = round(settings.skip_time * rate) + round(settings.skip * period)
    return _cut(start, length, period, settings.coherence, rate, place)


def step_cuts(settings: RecordSettings, steps: Iterable[Step], rate: float, length: int, place: str) -> list[Cut]:
    """Return the blocks of each frequency of a stepped sine; the line is the number of periods per block."""
    cuts = []
    for number, step in enumerate(steps, start=1):
        here = f"{place}, step {number} ({step.frequency:g} Hz)"
        if not step.start < step.stop <= (length + 1) / rate:
            raise RecordError(
                f"{here}: it lasts from {step.start:g} to {step.stop:g} s; expected to lie within {length / rate:g} s"
            )
        if step.frequency >= rate / 2:
            raise RecordError(f"{here}: expected less than half the sample rate of {rate:g} Hz")
        period = rate / step.frequency
        start = round((step.start + settings.skip_time) * rate) + round(settings.skip * period)
        cut = _cut(start, min(round(step.stop * rate), length), period, settings.coherence, rate, here)
        cuts.append(replace(cut, lines=(cut.periods,)))
    return cuts


def steps_of(frequency: np.ndarray, rate: float) -> list[Step]:
    """Return the stretches of constant frequency above 0 of a frequency channel [Hz], shape (n,)."""
    edges = [0, *(np.flatnonzero(np.diff(frequency)) + 1).tolist(), frequency.size]
    runs = [(start, stop, float(frequency[start])) for start, stop in pairwise(edges)]
    return [Step(start=start / rate, stop=stop / rate, frequency=value) for start, stop, value in runs if value > 0]


def _cut(start: int, stop: int, period: float, slip: float, rate: float, place: str) -> Cut:
    available = stop - start
    if available < BLOCKS * period * (1 - slip):
        raise RecordError(
            f"{place}: {max(available, 0)} samples are left, {max(available, 0) / period:.2f} periods; "
            f"expected at least {BLOCKS} periods of {period:.6g} samples"
        )
    found = coherent(period, available, slip)
    if found is None:
        raise RecordError(
            f"{place}: no whole number of periods of {period:.6g} samples is a whole number of samples within "
            f"{slip:g} periods and fits twice into {available} samples; raise coherence, or record for longer"
        )
    samples, periods = found
    # Stretching the clock by the slip gives the lines their true frequencies. What leaks, leaks into input and output
    # alike, and their common drift from block to block drops out of the response and of its covariance.
    stretch = periods * period / samples
    exact = abs(stretch - 1) < ROUNDING
    return Cut(start, available // samples, samples, periods, 1 / rate if exact else stretch / rate)
