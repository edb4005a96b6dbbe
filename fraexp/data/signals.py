"""Uniformly sampled channels with units, from a simulation or an instrument."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fraexp.data.results import Metric, Outcome
from fraexp.errors import RecordError, did_you_mean


@dataclass(frozen=True)
class Settling:
    """Whether a periodic experiment had become periodic before it was recorded."""

    settled: bool
    time: float
    """Time before the recorded periods [s]."""
    residual: float
    """Relative difference of the last two periods compared."""


@dataclass(frozen=True)
class Segment:
    """Whole periods of one periodic experiment, sampled so that a period is a whole number of samples.

    A record that does not repeat itself is one period, and not `periodic`.
    """

    sample_time: float
    """Sample time [s]."""
    channels: Mapping[str, np.ndarray]
    """Samples by channel name, each of shape (periods, samples per period)."""
    lines: np.ndarray
    """Excited harmonics of the period, ascending, shape (lines,) of int."""
    settling: Settling | None = None
    """None for a record that does not tell."""
    lead_in: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Samples from rest up to the first period, each of shape (n,), of the channels of which they are known."""
    periodic: bool = True
    """Whether the end goes on at the beginning; otherwise sums over a period are no phasors."""

    cache: dict[tuple[str, str], np.ndarray] = field(default_factory=dict, init=False, repr=False, compare=False)
    """What has been computed of a channel, by what it is: several estimators look at the same record."""

    def __post_init__(self) -> None:
        """Protect the samples: several estimators look at the same record."""
        for samples in (*self.channels.values(), *self.lead_in.values()):
            samples.flags.writeable = False

    @property
    def samples(self) -> int:
        """Samples per period."""
        return next(iter(self.channels.values())).shape[1]

    @property
    def frequency(self) -> np.ndarray:
        """Frequencies of the excited lines [Hz], shape (lines,)."""
        return self.lines / (self.samples * self.sample_time)


@dataclass(frozen=True)
class Signals:
    """The segments of one experiment: one per frequency for a stepped sine, one in all for a multisine."""

    segments: tuple[Segment, ...]
    units: Mapping[str, str]
    """Unit of each channel."""
    outcome: Outcome = Outcome.OK
    message: str = field(default="")
    numerics: str = ""
    """How they were simulated; empty for measured ones."""
    metrics: tuple[Metric, ...] = ()
    """What the experiment took: stroke, force and time."""

    def unit(self, channel: str) -> str:
        """Return the unit of a channel; RecordError names the nearest one if it does not exist."""
        if channel not in self.units:
            raise RecordError(f"the signals have no channel '{channel}'{did_you_mean(channel, self.units)}")
        return self.units[channel]
