"""Amounts of work: time on the reference core, and the kind on which a machine's speed depends."""

from dataclasses import dataclass
from math import floor, log10
from typing import NamedTuple

from fraexp.execution.estimates.speeds import SIZE_MARK

LANES = 8
"""Experiments that are computed at the same time in lanes."""
MIN_AMOUNT_S = 1e-3
"""Time on the reference core below which amounts are not distinguished."""
SCALAR, VECTOR = "scalar", "lanes"
"""How a kernel computes: one experiment after another, or several at the same time."""


class Work(NamedTuple):
    """An amount of one kind of work."""

    kind: str
    """Kind of work, such as ``loop/rolling/lanes``; empty for a time that was measured on this machine."""
    seconds: float
    """Time on the reference core [s]."""
    settling: str = ""
    """Kind of the ratio for the samples until the loop is settled; empty without settling."""

    @property
    def sized(self) -> str:
        """The kind with the order of magnitude of the amount: work that fits into a cache is faster."""
        return f"{self.kind}{SIZE_MARK}{floor(log10(max(self.seconds, MIN_AMOUNT_S)))}"


class RecordShape(NamedTuple):
    """Size of an experiment's record, on which the cost of estimators depends."""

    segments: int = 0
    lines: int = 0
    """Excited lines of all segments."""
    recorded: int = 0
    """Samples of all segments."""
    lead_in: int = 0
    """Samples from rest up to the record."""
    repeated: bool = False
    """Whether several periods of each segment are recorded."""


@dataclass(frozen=True)
class CountedExperiment:
    """The work of an experiment, and the size of its record."""

    work: tuple[Work, ...]
    shape: RecordShape
    rows: float = 0.0
    """Samples of all periods, including settling; 0 if no loop is simulated."""
    sample_time: float = 0.0
    """Sample time of the loop [s]."""
    rounds: int = 1
    """Approximate number of times that the periods are repeated."""
