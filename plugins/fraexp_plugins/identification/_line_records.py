"""Records at their spectral lines: thrust, motion, their errors, and what forces along the motions leave of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    FrictionModel,
    Motion,
    RecordError,
    Segment,
    Signals,
    fourier_sums,
    phasors,
    significant_deviation,
)
from fraexp_plugins.estimators._shared.delayed_estimator import LoopDelays
from fraexp_plugins.estimators._shared.effective_input_observer import CACHE_BYTES, RUNS_AT_ONCE
from fraexp_plugins.estimators._shared.realisations import mean
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification._law_forces import LawForces
from fraexp_plugins.identification._least_squares import solve_non_negative
from fraexp_plugins.identification._usable_records import SAMPLE_TIME_TOLERANCE, with_harmonics

MIN_HARMONIC_SAMPLES = 50
"""Samples of a cycle of the highest harmonic."""
DRIFT = "drift"
"""Name of the channel with the ramp that was taken off the output."""
DRIFT_PERIODS = 2
"""Periods of a motion with drift in which friction forgets how it began."""
NOISE_SEEDS = 12
"""Other errors of the encoder from which the error of friction follows: of few a record may seem to have hardly any, as
most of them change nothing where an element only just slips."""
PRIOR_FORCE_RATIO = 0.3
"""Prior standard deviation of the force of all elements over the largest thrust, for independent elements."""
FREE_BODY_RANGE, FREE_BODY_TERMS = 3.05, 4
"""Frequencies over the lowest one up to which an axis may be a free body (the third harmonic of the lowest one too),
and terms of the power series of 1/P there."""


class LinearProblem(NamedTuple):
    """The weighted equations in the sizes of the forces alone: 1/P is linear, and projected out at each line."""

    matrix: NDArray[np.float64]
    """Shape (2 L M + 2 K, N)."""
    target: NDArray[np.float64]
    """Shape (2 L M + 2 K,)."""
    offset: NDArray[np.complex128]
    """1/P without friction [N/m], complex, shape (L,)."""
    slopes: NDArray[np.complex128]
    """Its derivative by the sizes, complex, shape (L, N)."""
    power: NDArray[np.float64]
    """Sum of the weighted squares of the motion, shape (L,)."""


class LawSolution(NamedTuple):
    """Sizes of the forces of a law, and what they leave."""

    sizes: NDArray[np.float64]
    """Force of each column [N], shape (N,)."""
    residual: NDArray[np.float64]
    """Weighted residuals, shape (2 L M,), and then those of the equations of a free body, shape (2 K,)."""
    problem: LinearProblem

    @property
    def inverse(self) -> NDArray[np.complex128]:
        """1/P [N/m], complex, shape (L,)."""
        return self.problem.offset + self.problem.slopes @ self.sizes


@dataclass(frozen=True)
class LineRecords:
    """Up to M records at each of L lines, sines with their odd harmonics, where friction alone acts."""

    signals: Signals
    groups: tuple[tuple[int, ...], ...]
    """Places of the segments with the same lines."""
    delays: LoopDelays
    """The delays that `thrust` contains."""
    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (L,)."""
    is_excited: NDArray[np.bool_]
    """Whether a line is excited, shape (L,); the others are harmonics."""
    thrust: NDArray[np.complex128]
    """G_di G_do U [N], complex, shape (L, M); 0 if there is no record."""
    motion: NDArray[np.complex128]
    """Y [m], complex, shape (L, M)."""
    known: NDArray[np.bool_]
    """Whether there is a record, shape (L, M)."""
    motions: tuple[Motion, ...]
    """What drives friction in each segment."""
    deviations: NDArray[np.float64]
    """Standard deviation of the mean position of each segment [m], shape (segments,)."""
    force_factor: NDArray[np.complex128]
    """Factor from the force of friction to that in the thrust, by lags of the position behind it, shape (L,)."""
    variance: NDArray[np.float64]
    """E|e|² of G U - F - Y/P [N²], shape (L, M)."""
    free_lines: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    """Places of lines far below the first mode, where 1/P is that of a free body, shape (K,)."""
    driven: dict[tuple[object, ...], NDArray[np.complex128]] = field(default_factory=dict, repr=False)
    """Phasors of the laws that were driven last, for all weights of these records."""

    @classmethod
    def of(cls, signals: Signals, observer: EffectiveInput, model_error: float) -> "LineRecords":
        """Return the records of all segments.

        `model_error` is the error of a record's thrust that is allowed for besides noise, over its excited lines' mean.
        """
        segments = tuple(with_harmonics(segment, MIN_HARMONIC_SAMPLES) for segment in signals.segments)
        own = replace(signals, segments=segments)
        groups = _groups(own)
        parts = [_phasors_of(observer, own, group) for group in groups]
        count = max(len(group) for group in groups)
        thrust, motion = (
            np.concatenate([np.pad(part[place], ((0, 0), (0, count - part[place].shape[1]))) for part in parts])
            for place in (0, 1)
        )
        frequency = np.concatenate([own.segments[group[0]].frequency for group in groups])
        excited = np.concatenate([np.isin(own.segments[g[0]].lines, signals.segments[g[0]].lines) for g in groups])
        known = (thrust != 0) & (motion != 0)
        if not known[excited].any(axis=1).all():
            raise RecordError(
                f"plant_and_friction: '{observer.input}' or '{observer.output}' is 0 in all records at some line from "
                f"{frequency[excited & ~known.any(axis=1)].min():.4g} Hz on; leave that line out"
            )
        motions = tuple(periodic_motion(observer, segment) for segment in own.segments)
        periods = np.array([len(segment.channels[observer.output]) for segment in own.segments])
        # rounding repeats itself from period to period, noise does not
        deviations = np.hypot(observer.noise / np.sqrt(periods), observer.resolution / np.sqrt(12))
        fields = own, groups, observer.delays, frequency, excited, thrust, motion, known, motions, deviations
        bare = cls(*fields, observer.force_factor(2 * np.pi * frequency), variance=np.ones(known.shape))
        return replace(bare, variance=bare._bare_variance(observer, model_error))

    def _bare_variance(self, observer: EffectiveInput, model_error: float) -> NDArray[np.float64]:
        """Return E|e|² [N²] by errors of the model, the encoder and the force, without friction, shape (L, M)."""
        found, inverse = np.ones(self.known.shape), self.rough_inverse()
        order = np.argsort(self.frequency[self.is_excited])
        known = np.log(self.frequency[self.is_excited][order]), np.log(np.abs(inverse[order]))
        stiffness = np.exp(np.interp(np.log(self.frequency), *known))
        inverses = np.zeros(self.frequency.size, dtype=complex)
        inverses[self.is_excited] = inverse
        for place, (rows, record) in self.places():
            segment, excited = self.signals.segments[place], self.is_excited[rows]
            floor = model_error**2 * np.mean(np.abs(self.thrust[rows, record][excited]) ** 2)
            encoder = stiffness[rows] ** 2 * self.deviations[place] ** 2 * 2 / segment.samples
            path = observer.input_path(2 * np.pi * segment.frequency, segment.sample_time)
            errors = path * phasors(segment, observer.input) - inverses[rows] * phasors(segment, observer.output)
            force = np.mean(np.maximum(_variance_of_mean(errors[:, excited]) - encoder[excited], 0.0))
            found[rows, record] = floor + encoder + force
        return found

    @property
    def sample_time(self) -> float:
        """Sample time of the first record [s], the unit of a dead time in a search."""
        return self.signals.segments[0].sample_time

    @property
    def equations(self) -> int:
        """Number of real equations once 1/P is eliminated."""
        return max(int(2 * np.sum(np.maximum(self.known.sum(axis=1) - 1, 0))) + self.free_equations, 1)

    @property
    def free_equations(self) -> int:
        """How many of them say that the axis is a free body."""
        return max(2 * self.free_lines.size - FREE_BODY_TERMS, 0)

    @property
    def speed(self) -> float:
        """Greatest velocity amplitude of a line [m/s]: beyond it nothing is known of friction."""
        return float(2 * np.pi * np.max(self.frequency[:, None] * np.abs(self.motion), initial=0.0))

    @property
    def swing(self) -> float:
        """Greatest amplitude of all records [m]."""
        return max(float(np.ptp(motion.displacement)) / 2 for motion in self.motions)

    def rough_inverse(self) -> NDArray[np.complex128]:
        """Return U/Y of the record with the largest motion at each excited line [N/m], friction included."""
        motion = np.where(self.known, np.abs(self.motion), 0.0)[self.is_excited]
        largest = np.argmax(motion, axis=1)[:, None]
        thrust, motion = (
            np.take_along_axis(each[self.is_excited], largest, 1)[:, 0] for each in (self.thrust, self.motion)
        )
        return np.asarray(thrust / motion)

    def places(self) -> Iterator[tuple[int, tuple[slice, int]]]:
        """Yield the place of each segment, with its rows among the lines and its place among their records."""
        begin = 0
        for group in self.groups:
            end = begin + self.signals.segments[group[0]].lines.size
            yield from ((place, (slice(begin, end), record)) for record, place in enumerate(group))
            begin = end

    def as_free_body(self) -> "LineRecords":
        """Return the records of an axis whose lowest frequencies are far below its first mode.

        Elements that slip in hardly any record are a spring in the others, and 1/P of each line hides a spring: one of
        1.2 N that slips after 21 mm was a part of the Coulomb force.
        """
        return replace(self, free_lines=np.flatnonzero(self.frequency <= FREE_BODY_RANGE * self.frequency.min()))

    def deflection(self, law: LawForces) -> NDArray[np.complex128]:
        """Return the phasors of each column [N/N], complex, shape (L, M, N)."""
        found = self.driven.pop(law.key, None)
        if found is None:
            found = self._drive(law)
            while sum(each.nbytes for each in self.driven.values()) > CACHE_BYTES:
                del self.driven[next(iter(self.driven))]
        self.driven[law.key] = found
        return found

    def _drive(self, law: LawForces) -> NDArray[np.complex128]:
        found = np.zeros((*self.thrust.shape, law.is_coulomb.size), dtype=complex)
        columns, begin = law.forces(self.motions), 0
        while part := list(islice(columns, RUNS_AT_ONCE)):
            for place, (rows, record) in self.places():
                sums = fourier_sums(np.stack([column[place] for column in part]), self.signals.segments[place].lines)
                found[rows, record, begin : begin + len(part)] = (sums * self.force_factor[rows]).T
            begin += len(part)
        return found

    def force(self, model: FrictionModel, motions: Sequence[Motion] = ()) -> NDArray[np.complex128]:
        """Return the phasors of a model's force [N], complex, shape (L, M)."""
        found, forces = np.zeros(self.thrust.shape, dtype=complex), model.forces(motions or self.motions)
        for place, (rows, record) in self.places():
            sums = fourier_sums(forces[place][None], self.signals.segments[place].lines)[0]
            found[rows, record] = sums * self.force_factor[rows]
        return found

    def delayed(self, dead_time: float) -> NDArray[np.complex128]:
        """Return the thrust that comes later by a dead time [s], shape (L, M); the hold's images come later too."""
        segments = [self.signals.segments[group[0]] for group in self.groups]
        times = np.concatenate([np.full(segment.lines.size, segment.sample_time) for segment in segments])
        omega, known = 2 * np.pi * self.frequency, self.delays
        later = known._replace(input_dead_time=known.input_dead_time + dead_time)
        return self.thrust * (later.input_path(omega, times) / known.input_path(omega, times))[:, None]

    def problem(self, deflection: NDArray[np.complex128], dead_time: float) -> LinearProblem:
        """Return the equations in the sizes of the columns with a dead time [s].

        At the free lines 1/P is the series D s + m s² + c s³ + ... without a spring, whose coefficients are projected
        out, too.
        """
        weight = np.where(self.known, 1 / np.sqrt(self.variance), 0.0)
        u, y, z = weight * self.delayed(dead_time), weight * self.motion, weight[..., None] * deflection
        power = np.sum(np.abs(y) ** 2, axis=1)
        projection = np.conj(y) / np.where(power > 0, power, 1.0)[:, None]
        slopes, offset = -np.einsum("la,lan->ln", projection, z), np.sum(projection * u, axis=1)
        matrix = real_parts((z + y[..., None] * slopes[:, None]).reshape(y.size, z.shape[-1]))
        target = real_parts((u - y * offset[:, None]).ravel())
        if self.free_lines.size:
            at = self.free_lines
            root, s = np.sqrt(power[at, None]), 1j * self.frequency[at, None] / self.frequency[at].max()
            rows = real_parts(root * np.column_stack([-slopes[at], offset[at]]))
            series, _ = np.linalg.qr(real_parts(root * s ** np.arange(1, FREE_BODY_TERMS + 1)))
            rows -= series @ (series.T @ rows)
            matrix, target = np.concatenate([matrix, rows[:, :-1]]), np.append(target, rows[:, -1])
        return LinearProblem(matrix, target, offset, slopes, power)

    def solve(self, law: LawForces, deflection: NDArray[np.complex128], dead_time: float) -> LawSolution:
        """Return the sizes >= 0 of the columns by least squares, with a 1/P at each line and this dead time [s]."""
        problem = self.problem(deflection, dead_time)
        prior = np.diag(1 / self.prior(law)) if law.thresholds.size else np.empty((0, problem.matrix.shape[1]))
        matrix, target = np.concatenate([problem.matrix, prior]), np.append(problem.target, np.zeros(len(prior)))
        sizes = solve_non_negative(matrix, target)
        return LawSolution(sizes, problem.target - problem.matrix @ sizes, problem)

    def prior(self, law: LawForces) -> NDArray[np.float64]:
        """Return the standard deviation of each column's force [N] that is known before, shape (N,).

        It bounds the force of elements that the records do not determine, as of those that hardly slip (ridge
        regression: A. E. Hoerl and R. W. Kennard, Technometrics 12(1), 1970, doi 10.1080/00401706.1970.10488634).
        Nothing is known of the columns of another law.
        """
        largest = max(float(np.linalg.norm(self.thrust[place])) for _, place in self.places())
        force = PRIOR_FORCE_RATIO * largest / np.sqrt(max(law.thresholds.size, 1))
        return np.full(law.is_coulomb.size, force if law.thresholds.size else np.inf)

    def with_friction_noise(self, law: LawForces, sizes: NDArray[np.float64]) -> "LineRecords":
        """Return the records with the errors that the encoder causes by way of friction in their variance.

        A small motion turns back at another time with another error: its records count less.
        """
        model = law.model(sizes, 0.0)
        force = self.force(model)
        changes = [self.force(model, self.shaken_motions(seed)) - force for seed in range(NOISE_SEEDS)]
        noise = np.mean(np.abs(changes) ** 2, axis=0)
        return replace(self, variance=self.variance + np.where(self.known, noise, 0.0))

    def shaken_motions(self, seed: int) -> list[Motion]:
        """Return the motions with another error of the encoder."""
        generator = np.random.default_rng(seed)
        return [
            motion._replace(displacement=_shaken(motion, deviation, segment.samples, generator))
            for motion, deviation, segment in zip(self.motions, self.deviations, self.signals.segments, strict=True)
        ]


def _phasors_of(
    observer: EffectiveInput, own: Signals, group: tuple[int, ...]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return thrust [N] and motion [m] of a group of segments, complex, shape (lines, records) each."""
    segments = [own.segments[place] for place in group]
    omega = 2 * np.pi * segments[0].frequency
    path = observer.input_path(omega, segments[0].sample_time) * observer.output_path(omega)
    u, y = (np.stack([mean(phasors(each, name)) for each in segments], 1) for name in (observer.input, observer.output))
    return path[:, None] * u, y


def _groups(signals: Signals) -> tuple[tuple[int, ...], ...]:
    """Return the places of the segments with the same frequencies, in the order of their first segments."""
    found: list[list[int]] = []
    for place, segment in enumerate(signals.segments):
        for group in found:
            first = signals.segments[group[0]].frequency
            is_alike = first.shape == segment.frequency.shape
            if is_alike and np.allclose(first, segment.frequency, SAMPLE_TIME_TOLERANCE, 0):
                group.append(place)
                break
        else:
            found.append([place])
    return tuple(tuple(group) for group in found)


def some_frequencies(signals: Signals, step: int) -> Signals:
    """Return the segments of every `step`th of the frequencies with which they begin."""
    first = np.round([float(segment.frequency[0]) for segment in signals.segments], 3)
    chosen = np.isin(first, np.unique(first)[::step])
    return replace(signals, segments=tuple(compress(signals.segments, chosen)))


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


def periodic_motion(observer: EffectiveInput, segment: Segment) -> Motion:
    """Return the mean period of the motion that drives friction, with the drift that was taken off its record."""
    y, periods = mean(segment.channels[observer.output]), len(segment.channels[observer.output])
    quieter = observer.model_copy(update={"noise": observer.noise / np.sqrt(periods)})
    motion = quieter.motion(replace(segment, channels={observer.output: y[None]}))
    ramp = segment.channels.get(DRIFT, np.zeros((1, 1)))
    drift = float(ramp[-1, -1] - ramp[0, 0]) / len(ramp)
    spread = observer.encoder.deviation * np.sqrt(2 / segment.samples)
    if abs(drift) <= significant_deviation() * spread:
        return motion
    y, size = motion.displacement, motion.displacement.size
    moved = np.tile(y, DRIFT_PERIODS + 1) + drift / size * np.arange((DRIFT_PERIODS + 1) * size)
    return Motion(moved[-size:], motion.time_step, False, moved[:-size], motion.time_step)


def _variance_of_mean(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the variance of the mean over periods, shape (lines,); 0 for one period, which has no scatter."""
    periods = len(values)
    if periods < 2:
        return np.zeros(values.shape[1])
    scatter = np.add.reduce(np.abs(values - mean(values)) ** 2, axis=0)
    return scatter / (periods * (periods - 1))


def _shaken(motion: Motion, deviation: float, samples: int, generator: np.random.Generator) -> NDArray[np.float64]:
    """Return a displacement with noise in those terms of its Fourier series that it has; its drift is no part of it."""
    size = motion.displacement.size
    drift = motion.displacement[0] - motion.lead_in[-size] if motion.lead_in.size else 0.0
    ramp = drift / size * np.arange(size)
    bins = np.fft.rfft(motion.displacement - ramp)
    noise = np.fft.rfft(deviation * generator.normal(size=samples)) * (size / samples)
    noise = np.concatenate([noise, np.zeros(bins.size)])[: bins.size]
    kept = np.abs(bins) > 1e-9 * np.abs(bins[1:]).max()
    return np.asarray(np.fft.irfft(bins + np.where(kept, noise, 0.0), size) + ramp)


def real_parts(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the real parts and then the imaginary parts, along the first axis."""
    return np.concatenate([values.real, values.imag])
