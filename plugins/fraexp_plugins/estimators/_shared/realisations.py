"""Realisations of one experiment, the bases of broadband estimators, and a response combined from groups of them."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    HARMONICS,
    Curve,
    Finding,
    FrequencyResponse,
    Metric,
    Outcome,
    RecordError,
    Result,
    Segment,
    Settling,
    Signals,
    param,
    phasors,
    silence,
    steady_leakage,
    with_steady_motion,
)
from fraexp_plugins.estimators._shared.delayed_estimator import PlantReferredEstimator

Number = TypeVar("Number", np.float64, np.complex128)
Group = tuple[Segment, ...]
"""Segments with the same lines, samples and sample time: realisations, or repetitions, of one experiment."""


@dataclass(frozen=True)
class Part:
    """The response from one group of segments; the fields are those of FrequencyResponse."""

    segments: Group
    frequency: NDArray[np.float64]
    response: NDArray[np.complex128]
    covariance: NDArray[np.float64]
    freedom: float | NDArray[np.float64]
    input_amplitude: NDArray[np.float64]
    output_amplitude: NDArray[np.float64]
    noise_variance: NDArray[np.float64] | None = None
    nonlinear_variance: NDArray[np.float64] | None = None
    coherence: NDArray[np.float64] | None = None
    curves: tuple[Curve, ...] = ()
    metrics: tuple[Metric, ...] = ()
    remarks: tuple[Finding, ...] = ()
    """What users should know of a sound response."""
    doubts: tuple[Finding, ...] = ()
    """How far, and where, the response may be off; empty for a sound one."""


class BroadbandEstimator(PlantReferredEstimator, ABC):
    """An estimator that combines the realisations of an experiment."""

    removes_motion: ClassVar[bool] = False
    """Whether a steady motion during the record does no harm."""

    def estimate(self, signals: Signals) -> Result:
        """Return the response, one group of realisations after another."""
        units = (signals.unit(self.input), signals.unit(self.output))
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            parts = [self._checked_part(signals, group) for group in realisation_groups(signals)]
        return combine_parts(signals, parts, names=(self.input, self.output), units=units)

    def _checked_part(self, signals: Signals, group: Group) -> Part:
        found = self.part(signals, group)
        error = mean(np.stack([steady_leakage(segment, self.output) for segment in group]))
        if self.removes_motion or error.size != found.frequency.size:
            return found
        measured = found.frequency, found.response, found.covariance
        covariance, moving = with_steady_motion(group, self.output, signals.unit(self.output), error, *measured)
        return replace(found, covariance=covariance, remarks=(*found.remarks, moving)) if moving else found

    @abstractmethod
    def part(self, signals: Signals, group: Group) -> Part:
        """Return the response from one group of realisations."""


class ReferencedEstimator(BroadbandEstimator, ABC):
    """An estimator that needs the excitation, which is free of noise and friction."""

    excitation_channel: str = param("", "channel of the excitation", "excitation")

    def excitation_phasors(self, signals: Signals, group: Group) -> list[NDArray[np.complex128]]:
        """Return the phasors of the excitation, complex, each of shape (periods, lines)."""
        self.check_excitation(signals)
        return [phasors(segment, self.excitation_channel) for segment in group]

    def check_excitation(self, signals: Signals) -> None:
        """Raise RecordError if the signals lack the excitation."""
        if self.excitation_channel not in signals.units:
            raise RecordError(
                f"{self.name}: the signals have no channel '{self.excitation_channel}'; set excitation_channel to that "
                f"of the excitation, or to the input, '{self.input}', if no feedback acts on it "
                f"(--set estimator.excitation_channel={self.input})"
            )

    def relative_phasors(self, signals: Signals, group: Group) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return phasors of input and output relative to the phase of the excitation, (realisations, periods, lines).

        Realisations have random phases of their own: only relative to them can they be averaged. A single realisation
        stays as it is.
        """
        path = self.path(group[0].frequency, group[0].sample_time)
        u: NDArray[np.complex128] = np.stack([phasors(segment, self.input) for segment in group]) * path
        y: NDArray[np.complex128] = np.stack([phasors(segment, self.output) for segment in group])
        if len(group) == 1:
            return u, y
        r = np.stack([mean(each) for each in self.excitation_phasors(signals, group)])
        back = (np.conj(r) / np.abs(r))[:, None]
        return u * back, y * back


def realisation_groups(signals: Signals) -> list[Group]:
    """Return the segments in groups of equal lines, samples and sample time, in the order of their first segments."""
    found: dict[tuple[bytes, int, float], list[Segment]] = {}
    for segment in signals.segments:
        found.setdefault((segment.lines.tobytes(), segment.samples, segment.sample_time), []).append(segment)
    for group in found.values():
        counts = {next(iter(segment.channels.values())).shape[0] for segment in group}
        if len(counts) > 1:
            raise RecordError(
                f"the realisations have {min(counts)} to {max(counts)} periods; expected equally many; cut the others"
            )
    return [tuple(group) for group in found.values()]


def mean(values: NDArray[Number], axis: int = 0) -> NDArray[Number]:
    """Return the mean along an axis, summed in the order of the values: the same bits everywhere."""
    return np.add.reduce(values, axis=axis) / values.shape[axis]


def sum_of_squares(values: NDArray[Number], axis: int | tuple[int, ...] = 0) -> NDArray[np.float64]:
    """Return Σ|x|² along an axis or several."""
    return np.add.reduce(values.real**2 + values.imag**2, axis=axis)


def circular_covariance(variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the covariance (n, 2, 2) of a circular error with E|dG|², shape (n,): half of it for each part."""
    return variance[:, None, None] * (np.eye(2) / 2)


def combine_parts(signals: Signals, parts: Sequence[Part], *, names: tuple[str, str], units: tuple[str, str]) -> Result:
    """Return the response of all parts together, by ascending frequency within each part."""
    if not parts:
        return Result(signals.outcome, signals.findings)
    ratio = _concatenated(parts, "response")
    silent = ~np.isfinite(ratio) | (ratio == 0)
    settlings = [_settling(part) for part in parts]
    response = FrequencyResponse(
        frequency=_concatenated(parts, "frequency"),
        response=np.where(silent, np.nan, ratio),
        covariance=_concatenated(parts, "covariance"),
        unit=f"{units[1]}/{units[0]}",
        input=names[0],
        output=names[1],
        input_amplitude=_concatenated(parts, "input_amplitude"),
        output_amplitude=_concatenated(parts, "output_amplitude"),
        settled=~silent & _per_line(parts, [one.settled for one in settlings]).astype(bool),
        settling_time=_per_line(parts, [one.time for one in settlings]),
        residual=_per_line(parts, [one.residual for one in settlings]),
        harmonics=np.full((ratio.size, HARMONICS - 1), np.nan, dtype=complex),
        freedom=np.concatenate([np.broadcast_to(_as_array(p.freedom), p.frequency.shape) for p in parts]),
        noise_variance=_optional(parts, "noise_variance"),
        nonlinear_variance=_optional(parts, "nonlinear_variance"),
        coherence=_optional(parts, "coherence"),
    )
    curves = tuple(curve for part in parts for curve in part.curves)
    metrics = tuple(metric for part in parts for metric in part.metrics)
    found = Result(signals.outcome, signals.findings, response, metrics, curves)
    if silent.any() and signals.outcome is Outcome.OK:
        outcome = Outcome.NO_MOTION if silent.all() else Outcome.INACCURATE
        found = replace(found, outcome=outcome, findings=(silence(response.frequency, silent),))
    found = found.with_findings(*dict.fromkeys(doubt for part in parts for doubt in part.doubts), is_doubt=True)
    return found.with_findings(*dict.fromkeys(remark for part in parts for remark in part.remarks))


def _as_array(values: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values as an array of floats."""
    return np.asarray(values, dtype=float)


def _settling(part: Part) -> Settling:
    """Return whether all realisations settled, the longest settling time and the largest residual; NaN if unknown."""
    known = [segment.settling for segment in part.segments if segment.settling]
    if not known:
        return Settling(True, np.nan, np.nan)
    return Settling(all(s.settled for s in known), max(s.time for s in known), max(s.residual for s in known))


def _concatenated(parts: Sequence[Part], name: str) -> NDArray[np.float64]:
    return np.concatenate([getattr(part, name) for part in parts])


def _optional(parts: Sequence[Part], name: str) -> NDArray[np.float64] | None:
    values = [getattr(part, name) for part in parts]
    if all(value is None for value in values):
        return None
    unknown = [np.full(part.frequency.size, np.nan) for part in parts]
    return np.concatenate([nan if value is None else value for value, nan in zip(values, unknown, strict=True)])


def _per_line(parts: Sequence[Part], values: Sequence[float | bool]) -> NDArray[np.float64]:
    return np.repeat(np.array(values, dtype=float), [part.frequency.size for part in parts])
