"""What autonomous identification sees of records: at each line the thrust, the motion and what elements make of it."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from fraexp.api import RecordError, Segment, Signals, fourier_sums, phasors
from fraexp_plugins.estimators.effective_input import from_rest
from fraexp_plugins.estimators.proposed import Proposed
from fraexp_plugins.identification.stop_operator import stop_operators

ALIKE = 1e-4
"""Relative distance at which two frequencies are one."""
NEIGHBOURS = 2
"""Lines on either side over which the variance of a record is averaged: that of few periods is wild."""
SEED = 0
"""Of the rounding errors that are tried."""

Group = tuple[int, ...]
"""Places of the segments with the same frequencies: records of the same lines at several amplitudes or phases."""


class ElementObserver(Proposed):
    """The effective control input observer, and what elements of given thresholds make of the motion it sees."""

    name: ClassVar[str] = ""  # no component: it is not found by that of the proposed method

    def thrust(self, segment: Segment) -> np.ndarray:
        """Return the mean phasors of G_di G_do u [N], complex, shape (lines,)."""
        omega = 2 * np.pi * segment.frequency
        path = self.input_path(omega, segment.sample_time) * self.output_path(omega)
        delayed: np.ndarray = path * mean(phasors(segment, self.input))
        return delayed

    def deflections(self, segment: Segment, thresholds: np.ndarray) -> np.ndarray:
        """Return the phasors [m] of the deflections of elements with these thresholds [m], shape (lines, N)."""
        y = mean(segment.channels[self.output])
        periods = len(segment.channels[self.output])
        quieter = self.model_copy(update={"noise": self.noise / np.sqrt(periods)})
        motion = quieter._motion(replace(segment, channels={self.output: y[None]})).displacement
        # what an element did before the first slip is over after one period
        periodic = stop_operators(np.concatenate([motion, motion]), thresholds)[motion.size :]
        return fourier_sums(np.ascontiguousarray(periodic.T), segment.lines).T


@dataclass(frozen=True)
class SpectralLines:
    """Mean phasors at L lines of at most M records each."""

    groups: tuple[Group, ...]
    frequency: np.ndarray
    """Frequency [Hz], shape (L,)."""
    thrust: np.ndarray
    """G_di G_do U [N], complex, shape (L, M); 0 where there is no record."""
    motion: np.ndarray
    """Y [m], complex, shape (L, M)."""
    deflection: np.ndarray
    """Of each element [m], complex, shape (L, M, N)."""
    known: np.ndarray
    """Whether there is a record, shape (L, M)."""

    @property
    def equations(self) -> int:
        """Number of real equations that are left when P is eliminated at each line."""
        return int(2 * np.sum(np.maximum(self.known.sum(axis=1) - 1, 0)))


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean over the rows, summed in their order: the same bits everywhere."""
    found: np.ndarray = np.add.reduce(values, axis=0) / len(values)
    return found


def groups_of(signals: Signals) -> tuple[Group, ...]:
    """Return the places of the segments that have their frequencies in common, in the order of their first ones."""
    found: list[list[int]] = []
    for place, segment in enumerate(signals.segments):
        for group in found:
            first = signals.segments[group[0]].frequency
            if first.shape == segment.frequency.shape and np.allclose(first, segment.frequency, ALIKE, 0):
                group.append(place)
                break
        else:
            found.append([place])
    return tuple(tuple(group) for group in found)


def usable(signals: Signals, output: str) -> Signals:
    """Return the signals with the settled segments that move; RecordError for those that tell nothing."""
    if any(from_rest(segment) for segment in signals.segments):
        raise RecordError("autonomous needs settled motion, but the record begins at rest: set transient = false")
    settled = [s for s in signals.segments if s.settling is None or s.settling.settled]
    moving = tuple(s for s in settled if np.ptp(s.channels[output]) > 0)
    if not moving:
        raise RecordError("autonomous: no settled segment moves; raise excitation.amplitude or excitation.settle_limit")
    return replace(signals, segments=moving)


def lines_of(signals: Signals, observer: ElementObserver, thresholds: np.ndarray) -> SpectralLines:
    """Return what all records tell at each line, with what elements of these thresholds [m] make of it."""
    groups = groups_of(signals)
    records = max(len(group) for group in groups)
    parts: list[tuple[np.ndarray, ...]] = []
    for group in groups:
        lines = signals.segments[group[0]].lines.size
        u, y = np.zeros((2, lines, records), dtype=complex)
        z = np.zeros((lines, records, thresholds.size), dtype=complex)
        for record, place in enumerate(group):
            segment = signals.segments[place]
            u[:, record], y[:, record] = observer.thrust(segment), mean(phasors(segment, observer.output))
            z[:, record] = observer.deflections(segment, thresholds)
        parts.append((signals.segments[group[0]].frequency, u, y, z, (u != 0) & (y != 0)))
        if not parts[-1][-1].any(axis=1).all():
            raise RecordError(
                f"autonomous: at some line from {parts[-1][0][0]:.4g} Hz on, '{observer.input}' or '{observer.output}' "
                "is 0 in all records; leave that line out"
            )
    return SpectralLines(groups, *(np.concatenate(column) for column in zip(*parts, strict=True)))


def variances(signals: Signals, lines: SpectralLines, observer: ElementObserver, inverse: np.ndarray) -> np.ndarray:
    """Return E|e|² [N²] by noise of e = G_di G_do U - F̂ - Y/P̂, given 1/P̂ [N/m], shape (L, M).

    It is that of the mean over the periods by their scatter, so that noise of the thrust and of the scale count as much
    as they do by way of the friction model, and that by another rounding error of the scale, which is tried.
    """
    generator = np.random.default_rng(SEED)
    rounded = [_rounded(segment, observer, generator) for segment in signals.segments]
    errors = zip(
        observer.effective_phasors(signals.segments),
        observer.effective_phasors(rounded) if observer.resolution else [None] * len(rounded),
        strict=True,
    )
    of_segment = list(errors)
    found = np.full(lines.thrust.shape, np.nan)
    begin = 0
    for group in lines.groups:
        end = begin + signals.segments[group[0]].lines.size
        for record, place in enumerate(group):
            first, other = of_segment[place]
            error = first - inverse[begin:end] * phasors(signals.segments[place], observer.output)
            found[begin:end, record] = _of_mean(error)
            if other is not None:
                again = other - inverse[begin:end] * phasors(rounded[place], observer.output)
                found[begin:end, record] += np.abs(mean(again) - mean(error)) ** 2
        begin = end
    return _smoothed(lines, found)


def _rounded(segment: Segment, observer: ElementObserver, generator: np.random.Generator) -> Segment:
    """Return a segment with another rounding error, the same in each period, as that of a settled motion is."""
    change = generator.uniform(-observer.resolution / 2, observer.resolution / 2, segment.samples)
    return replace(segment, channels={**segment.channels, observer.output: segment.channels[observer.output] + change})


def _of_mean(values: np.ndarray) -> np.ndarray:
    """Return the variance of the mean over periods, shape (lines,); 0 for one period, which tells none."""
    periods = len(values)
    if periods < 2:
        return np.zeros(values.shape[1])
    scatter = np.add.reduce(np.abs(values - mean(values)) ** 2, axis=0)
    found: np.ndarray = scatter / (periods * (periods - 1))
    return found


def _smoothed(lines: SpectralLines, variance: np.ndarray) -> np.ndarray:
    """Return variances [N²] whose share of the thrust's power is that of the neighbouring lines of the same record."""
    order = np.argsort(lines.frequency, kind="stable")
    power = np.where(lines.known, np.abs(lines.thrust) ** 2, np.nan)
    found = np.zeros_like(variance)
    for record in range(variance.shape[1]):
        rows = order[lines.known[order, record]]
        found[rows, record] = _running_mean(variance[rows, record] / power[rows, record]) * power[rows, record]
    return found


def _running_mean(values: np.ndarray) -> np.ndarray:
    reach = min(NEIGHBOURS, max(values.size - 1, 0))
    padded = np.pad(values, reach, mode="reflect") if reach else values
    windows: np.ndarray = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    found: np.ndarray = np.mean(windows, axis=1)
    return found
