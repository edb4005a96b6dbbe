"""Amounts of work: how long the reference core takes, and what a machine's speed at it depends on."""

from dataclasses import dataclass
from math import floor, log10
from typing import NamedTuple

from fraexp.execution.estimates.speeds import SIZE

LANES = 8
"""Experiments that are computed side by side."""
LEAST_AMOUNT = 1e-3
"""Time of the reference core [s] below which amounts are not told apart."""
SCALAR, VECTOR = "scalar", "lanes"
"""How a kernel computes: one experiment after another, or side by side."""


class Work(NamedTuple):
    """An amount of one kind of work."""

    kind: str
    """What the machine's speed depends on, such as ``loop/rolling/lanes``; empty for what was measured here."""
    seconds: float
    """Time that the reference core takes [s]."""
    settling: str = ""
    """Kind of the ratio of samples until the loop is settled; empty if nothing settles."""

    @property
    def sized(self) -> str:
        """The kind with the amount's order of magnitude: what fits into a cache is faster than what does not."""
        return f"{self.kind}{SIZE}{floor(log10(max(self.seconds, LEAST_AMOUNT)))}"


class Shape(NamedTuple):
    """What an experiment records, as far as the cost of estimating from it goes."""

    segments: int = 0
    lines: int = 0
    """Excited lines of all segments."""
    recorded: int = 0
    """Samples of all segments."""
    lead_in: int = 0
    """Samples from rest up to the record."""
    repeated: bool = False
    """Whether several periods are recorded of each."""


@dataclass(frozen=True)
class Counted:
    """The work of an experiment, and what it records."""

    work: tuple[Work, ...]
    shape: Shape
    rows: float = 0.0
    """Samples of all periods, settling included; 0 if no loop is simulated."""
    sample_time: float = 0.0
    """Sample time of the loop [s]."""
    rounds: int = 1
    """How often the periods are run, about."""
