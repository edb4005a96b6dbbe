"""The records of a joint identification at each line: thrust, motion, and the deflections of friction elements."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Motion, RecordError, Segment, Signals, fourier_sums, phasors
from fraexp_plugins.estimators._shared.delayed_estimator import LoopDelays
from fraexp_plugins.estimators._shared.realisations import mean
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification._shared.stop_operator import stop_operators

FREQUENCY_TOLERANCE = 1e-4
"""Relative difference up to which two frequencies are equal."""
SMOOTHING_NEIGHBOURS = 2
"""Lines on either side over which a variance is averaged, since that of few periods is uncertain."""
DRIFT = "drift"
"""Name of the channel with the ramp that was taken off the output."""
MIN_DRIFT_STDS, DRIFT_PERIODS = 5.0, 2
"""Drift in a period from which it counts, in its standard deviations by the encoder, and periods of a motion with drift
in which friction forgets how it began."""
ROUNDING_SEED = 0
"""Seed of the alternative rounding errors."""

NO_THRESHOLDS = np.empty(0)
SegmentPlaces = tuple[int, ...]
"""Places of the segments with the same frequencies: records of the same lines at several amplitudes or phases."""


class ElementObserver(EffectiveInput):
    """The effective control input observer, and the deflections of elements with given thresholds."""

    name: ClassVar[str] = ""  # not a component: it must not be found as effective_input

    def thrust_of(self, segment: Segment) -> NDArray[np.complex128]:
        """Return the mean phasors of G_di G_do u [N], complex, shape (lines,)."""
        omega = 2 * np.pi * segment.frequency
        path = self.input_path(omega, segment.sample_time) * self.output_path(omega)
        return path * mean(phasors(segment, self.input))

    def deflections(self, segment: Segment, thresholds: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the phasors [m] of the deflections of elements with thresholds [m], shape (lines, N)."""
        motion = self.with_drift(self.periodic_motion(segment), segment)
        # the state before the first slip has no effect after one period
        columns = stop_operators(history(motion), thresholds)[-motion.displacement.size :]
        return fourier_sums(np.ascontiguousarray(columns.T), segment.lines).T

    def periodic_motion(self, segment: Segment) -> Motion:
        """Return the mean period of the motion that drives friction."""
        y, periods = mean(segment.channels[self.output]), len(segment.channels[self.output])
        quieter = self.model_copy(update={"noise": self.noise / np.sqrt(periods)})
        return quieter.motion(replace(segment, channels={self.output: y[None]}))

    def with_drift(self, motion: Motion, segment: Segment) -> Motion:
        """Return a period of motion with the drift that was taken off its record, after periods that lead to it."""
        ramp = segment.channels.get(DRIFT, np.zeros((1, 1)))
        drift = float(ramp[-1, -1] - ramp[0, 0]) / len(ramp)
        spread = np.hypot(self.noise, self.resolution / np.sqrt(12)) * np.sqrt(2 / segment.samples)
        if abs(drift) <= MIN_DRIFT_STDS * spread:
            return motion
        y, size = motion.displacement, motion.displacement.size
        moved = np.tile(y, DRIFT_PERIODS + 1) + drift / size * np.arange((DRIFT_PERIODS + 1) * size)
        return Motion(moved[-size:], motion.time_step, False, moved[:-size], motion.time_step)


@dataclass(frozen=True)
class SpectralLines:
    """Mean phasors at L lines of up to M records each."""

    groups: tuple[SegmentPlaces, ...]
    delays: LoopDelays
    """The delays that `thrust` contains."""
    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (L,)."""
    thrust: NDArray[np.complex128]
    """G_di G_do U [N], complex, shape (L, M); 0 if there is no record."""
    motion: NDArray[np.complex128]
    """Y [m], complex, shape (L, M)."""
    deflection: NDArray[np.complex128]
    """Deflection of each element [m], complex, shape (L, M, N)."""
    known: NDArray[np.bool_]
    """Whether there is a record, shape (L, M)."""
    sample_time: NDArray[np.float64]
    """Sample time [s], shape (L,)."""

    @property
    def equations(self) -> int:
        """Number of real equations once P is eliminated at each line."""
        return int(2 * np.sum(np.maximum(self.known.sum(axis=1) - 1, 0)))

    def places(self, signals: Signals) -> Iterator[tuple[int, tuple[slice, int]]]:
        """Yield the place of each segment, with its rows among the lines and its place among their records."""
        begin = 0
        for group in self.groups:
            end = begin + signals.segments[group[0]].lines.size
            yield from ((place, (slice(begin, end), record)) for record, place in enumerate(group))
            begin = end


def _groups(signals: Signals) -> tuple[SegmentPlaces, ...]:
    """Return the places of the segments with the same frequencies, in the order of their first segments."""
    found: list[list[int]] = []
    for place, segment in enumerate(signals.segments):
        for group in found:
            first = signals.segments[group[0]].frequency
            if first.shape == segment.frequency.shape and np.allclose(first, segment.frequency, FREQUENCY_TOLERANCE, 0):
                group.append(place)
                break
        else:
            found.append([place])
    return tuple(tuple(group) for group in found)


def remove_drift(signals: Signals, output: str) -> Signals:
    """Return the signals without the slow change of their means from period to period, and that of the output beside.

    A ramp has terms at all lines, so that it is no part of the response; friction is driven by the motion with it.
    """
    segments = []
    for segment in signals.segments:
        ramps = {name: _ramp(values) for name, values in segment.channels.items()}
        channels = {name: values - ramps[name] for name, values in segment.channels.items()}
        segments.append(replace(segment, channels={**channels, DRIFT: ramps[output]}))
    return replace(signals, segments=tuple(segments))


def _ramp(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the ramp in the periods of a channel, of the same shape (periods, n)."""
    means, time = values.mean(axis=1), np.arange(values.size) - (values.size - 1) / 2
    return (means[-1] - means[0]) / (max(len(means) - 1, 1) * values.shape[1]) * time.reshape(values.shape)


def history(motion: Motion) -> NDArray[np.float64]:
    """Return a motion after what leads to it [m]: a motion without a drift repeats itself."""
    before = motion.lead_in if motion.lead_in.size else motion.displacement
    return np.concatenate([before, motion.displacement])


def spectral_lines(
    signals: Signals, observer: ElementObserver, thresholds: NDArray[np.float64] = NO_THRESHOLDS
) -> SpectralLines:
    """Return thrust and motion of all records at each line, and the deflections of elements with thresholds [m]."""
    groups = _groups(signals)
    records = max(len(group) for group in groups)
    parts = []
    for group in groups:
        lines = signals.segments[group[0]].lines.size
        u, y = np.zeros((2, lines, records), dtype=complex)
        z = np.zeros((lines, records, thresholds.size), dtype=complex)
        for record, place in enumerate(group):
            segment = signals.segments[place]
            u[:, record], y[:, record] = observer.thrust_of(segment), mean(phasors(segment, observer.output))
            z[:, record] = observer.deflections(segment, thresholds)
        frequency, known = signals.segments[group[0]].frequency, (u != 0) & (y != 0)
        if not known.any(axis=1).all():
            raise RecordError(
                f"plant_and_friction: '{observer.input}' or '{observer.output}' is 0 in all records at some line from "
                f"{frequency[0]:.4g} Hz on; leave that line out"
            )
        times = np.full(lines, signals.segments[group[0]].sample_time)
        parts.append((frequency, u, y, z, known, times))
    return SpectralLines(groups, observer.delays, *(np.concatenate(column) for column in zip(*parts, strict=True)))


def delayed_lines(lines: SpectralLines, dead_time: float) -> SpectralLines:
    """Return the lines with a thrust that comes later by a dead time [s]; the hold's images come later too."""
    omega, known = 2 * np.pi * lines.frequency, lines.delays
    later = known._replace(input_dead_time=known.input_dead_time + dead_time)
    turn = later.input_path(omega, lines.sample_time) / known.input_path(omega, lines.sample_time)
    return replace(lines, thrust=lines.thrust * turn[:, None], delays=later)


def noise_variances(
    signals: Signals, lines: SpectralLines, observer: ElementObserver, inverse: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return E|e|² [N²] by noise of e = G_di G_do U - F̂ - Y/P̂, given 1/P̂ [N/m], shape (L, M).

    One part is the variance of the mean over the periods by their scatter, which includes noise of thrust and encoder
    that acts through the friction model. The other part is the effect of another rounding error of the encoder.
    """
    generator = np.random.default_rng(ROUNDING_SEED)
    rounded = [_with_other_rounding(segment, observer, generator) for segment in signals.segments]
    errors = zip(
        observer.effective_phasors(signals.segments),
        observer.effective_phasors(rounded) if observer.resolution else [None] * len(rounded),
        strict=True,
    )
    of_segment = list(errors)
    found = np.full(lines.thrust.shape, np.nan)
    for place, (rows, record) in lines.places(signals):
        first, other = of_segment[place]
        error = first - inverse[rows] * phasors(signals.segments[place], observer.output)
        found[rows, record] = _variance_of_mean(error)
        if other is not None:
            again = other - inverse[rows] * phasors(rounded[place], observer.output)
            found[rows, record] += np.abs(mean(again) - mean(error)) ** 2
    return _smoothed_variances(lines, found)


def _with_other_rounding(segment: Segment, observer: ElementObserver, generator: np.random.Generator) -> Segment:
    """Return a segment with another rounding error, the same in each period, as in the steady state."""
    change = generator.uniform(-observer.resolution / 2, observer.resolution / 2, segment.samples)
    return replace(segment, channels={**segment.channels, observer.output: segment.channels[observer.output] + change})


def scatter_noise(
    signals: Signals, lines: SpectralLines, observer: ElementObserver, inverse: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return the variance [N²] of G U - Y/P̂ by the scatter of the periods and by rounding, shape (L, M)."""
    found = np.zeros(lines.thrust.shape)
    for place, (rows, record) in lines.places(signals):
        segment = signals.segments[place]
        path = observer.input_path(2 * np.pi * segment.frequency, segment.sample_time)
        error = path * phasors(segment, observer.input) - inverse[rows] * phasors(segment, observer.output)
        rounding = observer.resolution**2 / 6 / (segment.samples * len(error))
        found[rows, record] = _variance_of_mean(error) + np.abs(inverse[rows]) ** 2 * rounding
    return found


def _variance_of_mean(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the variance of the mean over periods, shape (lines,); 0 for one period, which has no scatter."""
    periods = len(values)
    if periods < 2:
        return np.zeros(values.shape[1])
    scatter = np.add.reduce(np.abs(values - mean(values)) ** 2, axis=0)
    return scatter / (periods * (periods - 1))


def _smoothed_variances(lines: SpectralLines, variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return variances [N²], averaged relative to the thrust's power over neighbouring lines of the same record."""
    order = np.argsort(lines.frequency, kind="stable")
    power = np.where(lines.known, np.abs(lines.thrust) ** 2, np.nan)
    found = np.zeros_like(variance)
    for record in range(variance.shape[1]):
        rows = order[lines.known[order, record]]
        found[rows, record] = _running_mean(variance[rows, record] / power[rows, record]) * power[rows, record]
    return found


def _running_mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    reach = min(SMOOTHING_NEIGHBOURS, max(values.size - 1, 0))
    padded = np.pad(values, reach, mode="reflect") if reach else values
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    return np.mean(windows, axis=1)
