"""Whether the periods of a record had settled: a response that goes on changing from period to period had not."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.data.frequency_text import frequency_text
from fraexp.data.signals import Segment

MIN_PERIODS = 3
"""Periods from which a decay is told from noise."""
DECAYS = (0.0, 0.2, 0.4, 0.6, 0.75, 0.9)
"""Ratios of a transient in successive periods that are tried, from the first period alone to nearly a ramp."""
FALSE_ALARM_PROBABILITY = 1e-3
"""Probability with which noise alone looks like a transient somewhere in a record."""
LIKELY_PROBABILITY = 0.1
"""Probability of a decay by noise alone below which a line had not settled, if the record shows that some had not."""
MAX_ERROR = 0.01
"""Relative error of a mean over the periods from which a record is not ok."""


class Transient(NamedTuple):
    """What a transient does to the mean over the periods of a record."""

    error: NDArray[np.float64]
    """Error of the mean relative to the last period, shape (n,); 0 where no transient is seen."""
    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""

    @property
    def is_large(self) -> NDArray[np.bool_]:
        """Where the response is not ok, shape (n,)."""
        return self.error > MAX_ERROR

    @property
    def message(self) -> str:
        """Where the record had not settled, how much it matters and what helps; empty if nowhere."""
        if not self.is_large.any():
            return ""
        worst = int(np.argmax(self.error))
        decibels = 20 * np.log10(1 + self.error[worst])
        return (
            f"the machine was still settling at {self.is_large.sum()} of {self.error.size} frequencies "
            f"({frequency_text(self.frequency[self.is_large])}): at {self.frequency[worst]:.4g} Hz the mean over the "
            f"periods is off by {decibels:.2g} dB or more; leave the first periods out (skip_periods, --skip-periods), "
            "or wait before each frequency"
        )


def find_transient(
    segments: Sequence[Segment],
    frequency: NDArray[np.float64],
    inputs: Sequence[NDArray[np.complex128]],
    outputs: Sequence[NDArray[np.complex128]],
) -> Transient:
    """Return the transient in the ratio of output to input, whose phasors have the shape (periods, lines) each.

    `frequency` is that of all lines [Hz], shape (n,). Segments that state whether they had settled show none.
    """
    if not any(map(_may_settle, segments, inputs)):
        return Transient(np.zeros(frequency.size), frequency)
    parts = [_decay(*each) for each in zip(segments, inputs, outputs, strict=True)]
    chance, error = (np.concatenate([part[key] for part in parts]) for key in (0, 1))
    per_segment = np.array([min(float(part[0].min()) * part[0].size, 1.0) for part in parts])
    seen = np.full(chance.size, _is_transient(per_segment)) & (chance < LIKELY_PROBABILITY)
    return Transient(np.where(seen, error, 0.0), frequency)


def _may_settle(segment: Segment, inputs: NDArray[np.complex128]) -> bool:
    """Return whether it is unknown that a segment has settled, and its periods can show it."""
    return segment.settling is None and len(inputs) >= MIN_PERIODS


def _is_transient(chance: NDArray[np.float64]) -> bool:
    """Return whether noise alone would hardly look like a decay in one of the segments, or in many of them (Fisher).

    Every step of a stepped sine settles alike, and few periods show little each. The lines of one segment share drift.
    """
    if not (chance < 1).any():
        return False
    from scipy.special import gammaincc  # slow to import: listing plugins must stay fast

    together = gammaincc(chance.size, -np.sum(np.log(np.maximum(chance, np.finfo(float).tiny))))
    return min(float(chance.min()) * chance.size, float(together)) < FALSE_ALARM_PROBABILITY / 2


def _decay(
    segment: Segment, inputs: NDArray[np.complex128], outputs: NDArray[np.complex128]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the probability that noise alone explains a decay a + b r^p as well, and the error of the mean by it.

    Both have the shape (lines,). With the share s of the square that remains, F = (1/s - 1) (P - 2) of P periods has
    (2, 2(P - 2)) degrees of freedom, and exceeds that with the probability s^(P - 2).
    """
    lines, periods = segment.lines.size, len(inputs)
    chance, error = np.ones(lines), np.zeros(lines)
    if not _may_settle(segment, inputs):
        return chance, error
    moves = (inputs != 0).all(axis=0) & (outputs.mean(axis=0) != 0)
    ratio = outputs / np.where(moves, inputs, 1.0)
    mean = np.where(moves, ratio.mean(axis=0), 1.0)
    swing = ratio / mean - 1
    total = np.sum(np.abs(swing) ** 2, axis=0)
    for decay in DECAYS:
        shape = decay ** np.arange(periods)
        centred = shape - shape.mean()
        slope = centred @ swing / np.sum(centred**2)
        share = 1 - np.abs(slope) ** 2 * np.sum(centred**2) / np.where(total > 0, total, np.inf)
        found = np.minimum(np.maximum(share, 0.0) ** (periods - 2) * len(DECAYS), 1.0)
        last = np.abs(1 + slope * centred[-1])
        size = np.abs(slope * centred[-1]) / np.where(last > 0, last, np.inf)
        error = np.where(moves & (found < chance), size, error)
        chance = np.where(moves, np.minimum(found, chance), chance)
    return chance, error
