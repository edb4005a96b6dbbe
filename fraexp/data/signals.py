"""Uniformly sampled channels with units, from a simulation or an instrument; and columns of a measured record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.data.findings import Finding, Quantity, message_of
from fraexp.data.results import Metric, Outcome
from fraexp.errors import RecordError, did_you_mean


@dataclass(frozen=True)
class RecordTable:
    """Columns of a measured record, as stored in the file."""

    columns: Mapping[str, NDArray[np.float64]]
    """Values by column name, each of shape (n,)."""
    sample_time: float | None = None
    """Sample time [s] if the file states it."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units by column name; none or an empty one where the file states none."""
    times: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Time stamps [s] of columns that have their own, each of shape (n,); the lengths of such columns may differ."""


MAX_MAGNITUDE = 1e100
"""Magnitude of samples, and its inverse, up to which spectra and their products are exact."""


@dataclass(frozen=True)
class Settling:
    """Whether a periodic experiment had become periodic before it was recorded."""

    settled: bool
    time: float
    """Time before the recorded periods [s]."""
    residual: float
    """Relative difference of the last two periods compared."""


class StatedLine(NamedTuple):
    """What is known of a segment that stands for a frequency of a response which was measured elsewhere."""

    output_variance: float
    """Variance of the output's phasor [unit²]; NaN if unknown."""
    coherence: float
    """Squared coherence; NaN if unknown."""
    has_amplitude: bool
    """Whether the amplitude of the input was stated, without which friction cannot be taken off."""


@dataclass(frozen=True)
class Segment:
    """Whole periods of one periodic experiment, sampled so that a period is a whole number of samples.

    A record that does not repeat itself is one period, and not `periodic`.
    """

    sample_time: float
    """Sample time [s]."""
    channels: Mapping[str, NDArray[np.float64]]
    """Samples by channel name, each of shape (periods, samples per period)."""
    lines: NDArray[np.int64]
    """Excited harmonics of the period, ascending, shape (lines,) of int."""
    settling: Settling | None = None
    """None if the record does not contain it."""
    lead_in: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Samples from rest up to the first period, each of shape (n,), where they are known."""
    periodic: bool = True
    """Whether the record repeats itself; otherwise sums over a period are not phasors."""
    stated: StatedLine | None = None
    """Of a response that was measured elsewhere: then only the fundamental of the samples is known."""

    cache: dict[tuple[str, str], NDArray[np.complex128]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    """Results computed from a channel, by channel and kind: several estimators use the same record."""

    def __post_init__(self) -> None:
        """Protect the samples: several estimators look at the same record."""
        for samples in (*self.channels.values(), *self.lead_in.values()):
            samples.flags.writeable = False

    @cached_property
    def samples(self) -> int:
        """Samples per period."""
        return next(iter(self.channels.values())).shape[1]

    @cached_property
    def frequency(self) -> NDArray[np.float64]:
        """Frequencies of the excited lines [Hz], shape (lines,)."""
        return self.lines / (self.samples * self.sample_time)


class Encoder(NamedTuple):
    """What an encoder does to the measured position."""

    noise: float
    """Standard deviation of its noise [m]."""
    resolution: float
    """Its quantisation step [m]."""

    @property
    def deviation(self) -> float:
        """Standard deviation of a position by both [m]."""
        return float(np.hypot(self.noise, self.resolution / np.sqrt(12)))


@dataclass(frozen=True)
class Verification:
    """How exact a simulated experiment is, at some of its frequencies; the encoder counts as ideal."""

    frequency: NDArray[np.float64]
    """Frequencies [Hz] at which it was examined, shape (n,)."""
    step_error: NDArray[np.float64]
    """Relative error of y/u by the steps, shape (n,); of a transient, that of y over the stroke; of a law that is
    driven, that of the force over its range."""
    segments: tuple[Segment, ...]
    """What an ideal encoder recorded: all segments of the experiment if its own is ideal, else those examined."""
    plants: Mapping[str, NDArray[np.complex128]]
    """P(jω) [m/N] of the simulated plant at the lines of `segments`, by the channel of the measured position."""
    machine: Mapping[str, object]
    """Friction model, dead times and lags of the simulated machine, by the names that estimators have for them."""
    remedy: str = ""
    """What makes the simulation more exact."""
    further_step_errors: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """What `step_error` is, of further measured positions, by their channels such as `y.load`."""
    standing_motion: Mapping[str, float] = field(default_factory=dict)
    """Amplitude [m] up to which a position stands, by its channel: the rest is the computation, or the encoder's.

    Where it stands its `step_error` is NaN. 0 if it moves at all frequencies that were examined.
    """

    cache: dict[str, NDArray[np.float64] | None] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Error along `segments` of each estimator that knows the machine: those of a job often differ in no more."""


@dataclass(frozen=True)
class Signals:
    """The segments of one experiment: one per frequency for a stepped sine, one in all for a multisine."""

    segments: tuple[Segment, ...]
    units: Mapping[str, str]
    """Unit of each channel."""
    outcome: Outcome = Outcome.OK
    findings: tuple[Finding, ...] = ()
    """Doubts about them, and the cause of their outcome."""
    numerics: str = ""
    """How they were simulated; empty for measured ones."""
    metrics: tuple[Metric, ...] = ()
    """What the experiment took: stroke, force and time."""
    encoder: Encoder | None = None
    """Noise and rounding of the measured position, where they are known: those of a simulation."""
    verification: Verification | None = None
    """What shows how exact a simulation is; None for a record."""

    @property
    def message(self) -> str:
        """What exactly happened, in one line; empty when all is well."""
        return message_of(self.findings)

    @property
    def are_stated(self) -> bool:
        """Whether they stand for a response that was measured elsewhere."""
        return any(segment.stated for segment in self.segments)

    def check_values(self) -> None:
        """Raise RecordError for a channel whose squares are beyond floating point, or that has no numbers."""
        if self._value_fault:
            raise RecordError(*self._value_fault)

    @cached_property
    def _value_fault(self) -> tuple[object, ...]:
        """What is wrong with the samples, as parts of an error; empty if nothing is. Several estimators ask for it."""
        for name in dict.fromkeys(name for segment in self.segments for name in segment.channels):
            sizes = _magnitudes([segment.channels[name] for segment in self.segments if name in segment.channels])
            wrong = sizes[~((sizes == 0) | ((sizes > 1 / MAX_MAGNITUDE) & (sizes < MAX_MAGNITUDE)))]
            if wrong.size:
                reached = Quantity(float(wrong[0]), self.units.get(name, ""))
                expected = f"expected numbers between {1 / MAX_MAGNITUDE:g} and {MAX_MAGNITUDE:g}"
                return f"channel '{name}' reaches ", reached, f"; {expected}: correct its column, unit or scale"
        return ()

    def unit(self, channel: str) -> str:
        """Return the unit of a channel; RecordError names the nearest one if it does not exist."""
        if channel not in self.units:
            raise RecordError(f"the signals have no channel '{channel}'{did_you_mean(channel, self.units)}")
        return self.units[channel]


def _magnitudes(channels: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the greatest magnitude of each array that has samples, shape (n,); NaN if one of them is."""
    filled = [samples.ravel() for samples in channels if samples.size]
    if not filled:
        return np.empty(0)
    joined = np.concatenate(filled)  # one reduction of all: those of many short arrays take longer than their samples
    first = np.cumsum([0, *(samples.size for samples in filled[:-1])])
    return np.asarray(np.maximum.reduceat(np.abs(joined, out=joined), first))
