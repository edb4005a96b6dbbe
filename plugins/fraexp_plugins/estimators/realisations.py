"""What broadband estimators have in common: realisations of one experiment, and a response put together from them."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fraexp.api import (
    HARMONICS,
    Curve,
    FrequencyResponse,
    Metric,
    Outcome,
    RecordError,
    Result,
    Segment,
    Signals,
    param,
    phasors,
)
from fraexp_plugins.estimators.delayed import DelayedEstimator

Group = tuple[Segment, ...]
"""Segments with the same lines, samples and sample time: realisations, or repetitions, of one experiment."""


@dataclass(frozen=True)
class Part:
    """What one group of segments tells about the response; the fields are those of FrequencyResponse."""

    segments: Group
    frequency: np.ndarray
    response: np.ndarray
    covariance: np.ndarray
    freedom: float | np.ndarray
    input_amplitude: np.ndarray
    output_amplitude: np.ndarray
    noise_variance: np.ndarray | None = None
    nonlinear_variance: np.ndarray | None = None
    coherence: np.ndarray | None = None
    curves: tuple[Curve, ...] = ()
    metrics: tuple[Metric, ...] = ()


class BroadbandEstimator(DelayedEstimator, ABC):
    """An estimator that looks at the realisations of an experiment together."""

    remove_delay: bool = param("", "whether to divide by G_di G_do and the hold, to compare with P(jω)", False)

    def estimate(self, signals: Signals) -> Result:
        """Return the response, group of realisations by group."""
        units = (signals.unit(self.input), signals.unit(self.output))
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            parts = [self.part(signals, group) for group in groups(signals)]
        return combined(signals, parts, names=(self.input, self.output), units=units)

    @abstractmethod
    def part(self, signals: Signals, group: Group) -> Part:
        """Return what one group of realisations tells."""

    def path(self, frequency: np.ndarray, sample_time: float) -> np.ndarray:
        """Return what lies between input and output besides the plant, shape (n,), or ones if it is left in."""
        if not self.remove_delay:
            return np.ones(frequency.size)
        omega = 2 * np.pi * frequency
        return self.input_path(omega, sample_time) * self.output_path(omega)


class ReferencedEstimator(BroadbandEstimator, ABC):
    """An estimator that needs the injected signal, which noise and friction do not touch."""

    reference_channel: str = param("", "channel of the injected signal", "excitation")

    def reference(self, signals: Signals, group: Group) -> list[np.ndarray]:
        """Return the phasors of the injected signal, complex, each of shape (periods, lines)."""
        self.check_reference(signals)
        return [phasors(segment, self.reference_channel) for segment in group]

    def check_reference(self, signals: Signals) -> None:
        """Raise RecordError if the signals lack the injected signal."""
        if self.reference_channel not in signals.units:
            raise RecordError(
                f"the signals have no channel '{self.reference_channel}'; {self.name} needs the injected signal: name "
                f"its channel as reference_channel, or the input's, '{self.input}', if no feedback acts on that"
            )

    def rotated(self, signals: Signals, group: Group) -> tuple[np.ndarray, np.ndarray]:
        """Return phasors of input and output less the phase of the injected signal, (realisations, periods, lines).

        Only then can realisations, each with random phases of its own, be averaged. A single one is left as it is.
        """
        path = self.path(group[0].frequency, group[0].sample_time)
        u = np.stack([phasors(segment, self.input) for segment in group]) * path
        y = np.stack([phasors(segment, self.output) for segment in group])
        if len(group) == 1:
            return u, y
        r = np.stack([mean(each) for each in self.reference(signals, group)])
        back = (np.conj(r) / np.abs(r))[:, None]
        return u * back, y * back


def groups(signals: Signals) -> list[Group]:
    """Return the segments in groups of equal lines, samples and sample time, in the order of their first ones."""
    found: dict[tuple[bytes, int, float], list[Segment]] = {}
    for segment in signals.segments:
        found.setdefault((segment.lines.tobytes(), segment.samples, segment.sample_time), []).append(segment)
    for group in found.values():
        counts = {next(iter(segment.channels.values())).shape[0] for segment in group}
        if len(counts) > 1:
            raise RecordError(
                f"realisations have {min(counts)} to {max(counts)} periods; expected equally many: cut the longer ones"
            )
    return [tuple(group) for group in found.values()]


def mean(values: np.ndarray, axis: int = 0) -> np.ndarray:
    """Return the mean along an axis, summed in the order of the values: the same bits everywhere."""
    found: np.ndarray = np.add.reduce(values, axis=axis) / values.shape[axis]
    return found


def power(values: np.ndarray, axis: int | tuple[int, ...] = 0) -> np.ndarray:
    """Return Σ|x|² along an axis or several."""
    found: np.ndarray = np.add.reduce(values.real**2 + values.imag**2, axis=axis)
    return found


def circular(variance: np.ndarray) -> np.ndarray:
    """Return the covariance (n, 2, 2) of a circular error with E|dG|², shape (n,): both parts have half of it."""
    covariance: np.ndarray = variance[:, None, None] * (np.eye(2) / 2)
    return covariance


def combined(signals: Signals, parts: Sequence[Part], *, names: tuple[str, str], units: tuple[str, str]) -> Result:
    """Return the response that the parts make together, by ascending frequency within each of them."""
    if not parts:
        return Result(signals.outcome, signals.message)
    ratio = _joined(parts, "response")
    silent = ~np.isfinite(ratio) | (ratio == 0)
    response = FrequencyResponse(
        frequency=_joined(parts, "frequency"),
        response=np.where(silent, np.nan, ratio),
        covariance=_joined(parts, "covariance"),
        unit=f"{units[1]}/{units[0]}",
        input=names[0],
        output=names[1],
        input_amplitude=_joined(parts, "input_amplitude"),
        output_amplitude=_joined(parts, "output_amplitude"),
        settled=~silent & _per_line(parts, [_settling(part)[0] for part in parts]).astype(bool),
        settling_time=_per_line(parts, [_settling(part)[1] for part in parts]),
        residual=_per_line(parts, [_settling(part)[2] for part in parts]),
        harmonics=np.full((ratio.size, HARMONICS - 1), np.nan, dtype=complex),
        freedom=np.concatenate([np.broadcast_to(float64(p.freedom), p.frequency.shape) for p in parts]),
        noise_variance=_optional(parts, "noise_variance"),
        nonlinear_variance=_optional(parts, "nonlinear_variance"),
        coherence=_optional(parts, "coherence"),
    )
    curves = tuple(curve for part in parts for curve in part.curves)
    metrics = tuple(metric for part in parts for metric in part.metrics)
    outcome, message = signals.outcome, signals.message
    if silent.any() and outcome is Outcome.OK:
        outcome = Outcome.NO_SIGNAL
        message = f"at {silent.sum()} of {silent.size} frequencies input or output does not move"
    return Result(outcome, message, response, metrics, curves)


def float64(values: float | np.ndarray) -> np.ndarray:
    """Return values as an array of floats."""
    return np.asarray(values, dtype=float)


def _settling(part: Part) -> tuple[bool, float, float]:
    """Return whether all realisations settled, and the longest time and the greatest difference; NaN if unknown."""
    known = [segment.settling for segment in part.segments if segment.settling]
    if not known:
        return True, np.nan, np.nan
    return all(s.settled for s in known), max(s.time for s in known), max(s.residual for s in known)


def _joined(parts: Sequence[Part], name: str) -> np.ndarray:
    return np.concatenate([getattr(part, name) for part in parts])


def _optional(parts: Sequence[Part], name: str) -> np.ndarray | None:
    values = [getattr(part, name) for part in parts]
    if all(value is None for value in values):
        return None
    unknown = [np.full(part.frequency.size, np.nan) for part in parts]
    return np.concatenate([nan if value is None else value for value, nan in zip(values, unknown, strict=True)])


def _per_line(parts: Sequence[Part], values: Sequence[float | bool]) -> np.ndarray:
    return np.repeat(np.array(values, dtype=float), [part.frequency.size for part in parts])
