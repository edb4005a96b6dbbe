"""Cutting a record into blocks of whole periods and whole samples."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from fraexp.errors import RecordError
from fraexp.records.record_settings import BLOCKS, RecordSettings, Step

ROUNDING = 1e-9
"""Relative difference of samples and periods that is rounding of what the study says."""
SPARE = 0.01
"""Part of a realisation that may be left over at the end of a record."""
FEWEST = 100
"""Samples of a stretch that does not repeat itself at least."""
LEAST = 2
"""Samples of a period."""
MOST_LINES = 200
"""Frequencies of such a stretch, where the study does not say which."""


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
    periodic: bool = True
    """False for a stretch that does not repeat itself: its one block is all of it."""
    left_out: int = 0
    """Lines that stand out of the noise and do not count, though they are not far weaker than some that do."""
    doubtful: int = 0
    """Lines that count, though they are far weaker than the others."""

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
            **({} if self.periodic else {"periodic": False}),
            **{key: getattr(self, key) for key in ("left_out", "doubtful") if getattr(self, key)},
        }

    @classmethod
    def of(cls, data: Any) -> "Cut":
        """Return the cut that `plain` described."""
        lines, periodic = tuple(data["lines"]), data.get("periodic", True)
        weak = (data.get("left_out", 0), data.get("doubtful", 0))
        return cls(data["start"], data["periods"], data["samples"], 1, data["sample_time"], lines, periodic, *weak)


def coherent(period: float, available: float, slip: float, least: int = BLOCKS) -> tuple[int, int] | None:
    """Return the fewest samples that hold whole periods, and how many, so that two blocks fit into `available` samples.

    `least` is another number of blocks than two. `period` is in samples; `slip` is the greatest difference of the
    two, in periods. None if there are none.
    """
    periods = np.arange(1, int(available / least / period + slip) + 1)
    samples = np.rint(periods * period)
    fitting = np.flatnonzero((np.abs(samples - periods * period) <= slip * period) & (least * samples <= available))
    return (int(samples[fitting[0]]), int(periods[fitting[0]])) if fitting.size else None


def periodic_cut(settings: RecordSettings, rate: float, run: tuple[int, int], place: str) -> Cut:
    """Return the blocks of a periodic record from the first sample of a run to before its last, without its lines."""
    period = period_of(settings, rate)
    if not LEAST <= period <= run[1]:
        raise RecordError(
            f"{place}: a period of {period:.4g} samples; expected from {LEAST} to those of the record, {run[1]}"
        )
    start = run[0] + round(settings.skip_time * rate) + round(settings.skip * period)
    return _cut(start, run[1], period, settings.coherence, rate, place, settings.least_blocks)


def period_of(settings: RecordSettings, rate: float) -> float:
    """Return the period that the study states [samples]."""
    return float(settings.period) if settings.period else (settings.period_time or 0.0) * rate


def realisations_of(settings: RecordSettings, rate: float, run: tuple[int, int], place: str) -> list[tuple[int, int]]:
    """Return the runs of the realisations that follow one another in a run, or the run itself."""
    if not settings.periods:
        return [run]
    length = settings.periods * period_of(settings, rate)
    count = int((run[1] - run[0]) / length + ROUNDING)
    if settings.periods * period_of(settings, rate) * max(count, 1) < run[1] - run[0] - length * SPARE or not count:
        raise RecordError(
            f"{place}: {run[1] - run[0]} samples are {(run[1] - run[0]) / length:.2f} realisations of "
            f"{settings.periods} periods; expected a whole number: correct periods or period"
        )
    edges = [run[0] + round(number * length) for number in range(count + 1)]
    return list(pairwise(edges))


def whole_cut(settings: RecordSettings, rate: float, run: tuple[int, int], place: str) -> Cut:
    """Return a run that does not repeat itself as one block.

    Its lines are where a response is asked for: from `lowest`, or ten periods in the run, to `highest`, or a fifth of
    the sample rate, each or some of them, evenly over the logarithm of the frequency; `every` takes every so many.
    """
    start = run[0] + round(settings.skip_time * rate)
    samples = run[1] - start
    if settings.skip or settings.lines:
        key = "skip" if settings.skip else "lines"
        raise RecordError(f"{place}: {key} counts periods, and the record has none; give skip_time, lowest and highest")
    if samples < FEWEST:
        raise RecordError(f"{place}: {max(samples, 0)} samples are left; expected at least {FEWEST}")
    if max(settings.lowest or 0.0, settings.highest or 0.0) > rate / 2:
        raise RecordError(
            f"{place}: lowest and highest reach {max(settings.lowest or 0.0, settings.highest or 0.0):g} Hz; "
            f"expected {rate / 2:g} Hz at most, half the sample rate"
        )
    first = max(round((settings.lowest or 10 * rate / samples) * samples / rate), 1)
    last = min(round((settings.highest or rate / 5) * samples / rate), (samples - 1) // 2)
    if last < first:
        raise RecordError(
            f"{place}: no frequency between {first * rate / samples:.4g} and {last * rate / samples:.4g} Hz can be "
            f"told; expected lowest below highest, and that below {rate / 2:g} Hz"
        )
    if settings.every:
        lines = np.arange(first, last + 1, settings.every)
    else:
        lines = np.unique(np.rint(np.geomspace(first, last, MOST_LINES)).astype(int))
    return Cut(start, 1, samples, 1, 1 / rate, tuple(lines.tolist()), periodic=False)


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


def runs_of(values: np.ndarray) -> list[tuple[int, int]]:
    """Return first sample and the one after the last of each run of equal values above 0, shape (n,)."""
    edges = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), values.size]
    return [(start, stop) for start, stop in pairwise(edges) if values[start] > 0]


def steps_of(frequency: np.ndarray, rate: float) -> list[Step]:
    """Return the stretches of constant frequency above 0 of a frequency channel [Hz], shape (n,)."""
    runs = runs_of(frequency)
    return [Step(start=start / rate, stop=stop / rate, frequency=float(frequency[start])) for start, stop in runs]


def _cut(  # the numbers of one cut
    start: int, stop: int, period: float, slip: float, rate: float, place: str, least: int = BLOCKS
) -> Cut:
    available = stop - start
    if available < least * period * (1 - slip):
        raise RecordError(
            f"{place}: {max(available, 0)} samples are left, {max(available, 0) / period:.2f} periods; "
            f"expected at least {least} periods of {period:.6g} samples"
        )
    found = coherent(period, available, slip, least)
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
