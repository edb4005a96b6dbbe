"""The effective control input observer: the part of the control input that moves the plant, without friction."""

import itertools
from abc import ABC
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import PrivateAttr

from fraexp.api import (
    Encoder,
    FrictionModel,
    Motion,
    ParameterError,
    PositionDependentFriction,
    Segment,
    Signals,
    cached_arrays,
    fourier_sums,
    param,
    path_response,
    phasors,
    record_spectrum,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator, LoopDelays
from fraexp_plugins.estimators._shared.measured_motion import clear_power

EFFECTIVE_INPUT = "u_e"
"""Name of the channel û_e."""
CACHE_BYTES = 1 << 26
"""Memory of all that is cached of one kind, 64 MiB: half of it computes the shifts of long records again."""
RUNS_AT_ONCE = 16
"""Motions, or columns of a law, that are run side by side: they fill the lanes, in some 50 MB. Half of them leave lanes
empty."""
LEAST_POINTS, MOST_POINTS = 4, 64
"""Least and greatest number of points per sample that is chosen."""
TOLERANCE_RATIO = 10.0
"""Tolerated error of y'/û_e over that of y'/u, and of y'/u over that of a replay: the effective input is a small
difference. Half of it makes replays a third faster, and their error twice as large."""


class _TriedForce(NamedTuple):
    """The friction model's force along a segment, which was found while the points per sample were chosen."""

    segment: Segment
    driving: tuple[object, ...]
    """All on which it depends."""
    force: NDArray[np.float64]
    """[N], shape (periods, samples × points)."""


class ObserverEstimator(DelayedEstimator, ABC):
    """An estimator that knows a friction model: û_e = G_di G_do u - f̂, the observer of eqs (2)-(5).

    y' drives the friction model in the time domain; the delays act at each frequency. Between its samples y' is
    interpolated by its Fourier series, which is exact for a periodic response; a friction model driven by the samples
    only would miss the peaks by A(1 - cos(ωTs/2)). Terms of the series below the encoder's resolution and noise are
    removed, because the model would take them for reversals.
    """

    friction: FrictionModel | None = param("", "friction model FM of the observer", None, inherit="friction")
    force_scale: float = param("1", "factor on the model's force, such as 1.1 for a ΣF_m 10 % too large", 1.0, above=0)
    displacement_scale: float = param("1", "factor on the model's deflections Y_m, at the same ΣF_m", 1.0, above=0)
    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the encoder's noise", 0.0, at_least=0, inherit="loop.noise")
    oversampling: int = param(
        "1",
        "points per sample at which y' drives the friction model; 0 for what the tolerance needs",
        0,
        at_least=0,
        at_most=MOST_POINTS,
    )
    interpolation_tolerance: float = param(
        "1",
        "relative error of y'/u that is tolerated; ten times as much of y'/û_e",
        1e-4,
        at_least=1e-5,
        at_most=0.1,
        inherit="numerics.tolerance",
    )

    def model_post_init(self, context: object) -> None:
        """Check that there is a friction model, and that deflections are not scaled where the position matters."""
        if not getattr(self, "frictions", None):
            self.law  # noqa: B018  # it raises the error
        is_positioned = isinstance(self.friction, PositionDependentFriction)
        for key, expected in (("displacement_scale", 1.0), ("displacement_std", 0.0)):
            found = getattr(self, key, None)
            if is_positioned and found not in (None, expected):
                raise ParameterError(
                    f"{self.name}.{key} is {found:g}, which would scale the friction model's position_dependence too; "
                    f"expected {expected:g}: change the model's own parameters, or state deviations of those"
                )

    _points: dict[float, int] = PrivateAttr(default_factory=dict)
    """Points per sample that were chosen for segments, by their first frequency [Hz]."""
    _tried: dict[int, _TriedForce] = PrivateAttr(default_factory=dict)
    """The forces with them, by the identity of the segment."""

    @property
    def law(self) -> FrictionModel:
        """Friction model of the one contact; ParameterError if there is none."""
        if self.friction is None:
            raise ParameterError(f"{self.name} lacks 'friction'; state it here, or 'friction' in the study")
        return self.friction

    @property
    def encoder(self) -> Encoder:
        """Noise and resolution of the measured position."""
        return Encoder(self.noise, self.resolution)

    def matched(self, machine: Mapping[str, object]) -> Self:
        """Return the observer of the machine itself, with an ideal encoder."""
        known = {name: value for name, value in machine.items() if name in type(self).model_fields}
        ideal = {"resolution": 0.0, "noise": 0.0, "force_scale": 1.0, "displacement_scale": 1.0}
        return self.model_copy(update={**known, **ideal})

    def effective_phasors(
        self, segments: Sequence[Segment], forces: Sequence[NDArray[np.float64]] | None = None
    ) -> list[NDArray[np.complex128]]:
        """Return the phasors of û_e [N] at the excited lines per segment, each of shape (periods, lines), eq (2).

        `forces` are those of `_forces`, if they are known.
        """
        if segments and not (self.oversampling or self._points):
            return self.resolve_oversampling(segments).effective_phasors(segments)
        friction = self._friction_phasors(segments, forces)
        return [linear - force for linear, force in zip(self.linear_phasors(segments), friction, strict=True)]

    def linear_phasors(self, segments: Sequence[Segment]) -> list[NDArray[np.complex128]]:
        """Return the phasors of G_di G_do u less viscous friction [N] per segment, each of shape (periods, lines)."""
        thrusts, viscous = self.thrust_phasors(segments), self._viscous_phasors(segments)
        return [thrust - force for thrust, force in zip(thrusts, viscous, strict=True)]

    def _viscous_phasors(self, segments: Sequence[Segment]) -> list[NDArray[np.complex128]]:
        """Return the phasors of viscous friction [N] per segment, each of shape (periods, lines)."""
        slopes = at_lines(segments, lambda omega: np.asarray(1j * omega * self.law.viscous))
        return [slope * phasors(segment, self.output) for slope, segment in zip(slopes, segments, strict=True)]

    def thrust_phasors(self, segments: Sequence[Segment]) -> list[NDArray[np.complex128]]:
        """Return the phasors of G_di G_do u [N] per segment, each of shape (periods, lines)."""
        if not segments:
            return []
        counts = [segment.lines.size for segment in segments]
        omega = 2 * np.pi * np.concatenate([segment.frequency for segment in segments])
        times = {segment.sample_time for segment in segments}
        sample_time = times.pop() if len(times) == 1 else np.repeat([s.sample_time for s in segments], counts)
        path = np.split(self.input_path(omega, sample_time) * self.output_path(omega), np.cumsum(counts)[:-1])
        return [delayed * phasors(segment, self.input) for segment, delayed in zip(segments, path, strict=True)]

    def resolve_oversampling(self, segments: Sequence[Segment]) -> Self:
        """Return the estimator with the points per sample that its friction model needs along each of these segments.

        How many that are follows from the widths of the friction model's elements and from the motion, and is tried:
        until twice as many change the effective input by less than the tolerance.
        """
        if self.oversampling or self._points:
            return self
        waiting, points = _examined(segments), LEAST_POINTS
        chosen, tried = dict[float, int](), dict[int, _TriedForce]()
        tolerance = TOLERANCE_RATIO * self.interpolation_tolerance
        finer = self._oversampled(points)
        motions = finer._motions(waiting)
        thinned, forces = finer._forces_along(waiting, _every_second_point(motions), motions)
        coarse = finer._friction_phasors(waiting, thinned)
        while True:
            chosen |= {float(segment.frequency[0]): points for segment in waiting}
            fine = finer._friction_phasors(waiting, forces)
            found = (_TriedForce(of, finer._driving(of), force) for of, force in zip(waiting, forces, strict=True))
            tried |= {id(each.segment): each for each in found}
            given = zip(self.linear_phasors(waiting), coarse, fine, strict=True)
            is_coarse = [_relative_change(*each) > tolerance for each in given]
            waiting, coarse = list(itertools.compress(waiting, is_coarse)), list(itertools.compress(fine, is_coarse))
            points *= 2
            if points == MOST_POINTS or not waiting:
                break
            finer = self._oversampled(points)
            forces = finer._forces(waiting)
        chosen |= {float(segment.frequency[0]): points for segment in waiting}
        return self._with_points(chosen, tried)

    def resolve_for(self, signals: Signals) -> Self:
        """Return the estimator with the points per sample that it takes: its certificate is that of the same points."""
        is_sampled = signals.segments and not signals.are_stated
        return self.resolve_oversampling(signals.segments) if is_sampled else self

    def points(self, segment: Segment) -> int:
        """Return the points per sample at which the motion in a segment drives the friction model."""
        return self.oversampling or self._points.get(float(segment.frequency[0]), max(self._points.values()))

    def _with_points(self, points: Mapping[float, int], tried: Mapping[int, _TriedForce] | None = None) -> Self:
        """Return the same estimator with the points per sample of segments, by their first frequency [Hz]."""
        chosen = self.model_copy()
        chosen._points, chosen._tried = dict(points), dict(tried or {})
        return chosen

    def _oversampled(self, points: int) -> Self:
        """Return the same estimator with a number of points per sample."""
        return self.model_copy(update={"oversampling": points})

    def thrust_spectrum(self, segment: Segment) -> NDArray[np.complex128]:
        """Return the spectrum of G_di G_do u [N] over the whole record of a segment, shape (n // 2 + 1,)."""
        path = _record_path(self.delays, segment.channels[self.input].size, segment.sample_time)
        return path * record_spectrum(segment, self.input)

    def force_spectrum(self, segment: Segment, force: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the spectrum of all friction [N] over the whole record of a segment, shape (n // 2 + 1,).

        `force` is that of `_forces`.
        """
        omega = 2 * np.pi * np.fft.rfftfreq(segment.channels[self.output].size, segment.sample_time)
        friction = np.fft.rfft(force.ravel())[: omega.size] * (self.force_scale / self.points(segment))
        if self.output_time_constants:
            friction = friction * path_response(omega, 0.0, self.output_time_constants)
        return friction + 1j * omega * self.law.viscous * record_spectrum(segment, self.output)

    def _friction_phasors(
        self, segments: Sequence[Segment], forces: Sequence[NDArray[np.float64]] | None = None
    ) -> list[NDArray[np.complex128]]:
        """Return the phasors of the friction model's force [N] per segment, each of shape (periods, lines)."""
        forces = self._forces(segments) if forces is None else forces
        given = zip(segments, forces, at_lines(segments, self.force_factor), strict=True)
        return [fourier_sums(periods, segment.lines) * factor for segment, periods, factor in given]

    def friction_phasors(
        self, segments: Sequence[Segment], forces: Sequence[NDArray[np.float64]] | None = None
    ) -> list[NDArray[np.complex128]]:
        """Return the phasors of all friction [N], viscous friction included, each of shape (periods, lines)."""
        pairs = zip(self._friction_phasors(segments, forces), self._viscous_phasors(segments), strict=True)
        return [force + viscous for force, viscous in pairs]

    def force_factor(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the factor from the model's force to that in û_e, shape (n,), at ω [rad/s]."""
        return self.force_scale * path_response(omega, 0.0, self.output_time_constants)

    def lead_in(self, segment: Segment) -> NDArray[np.float64]:
        """Return the displacement before the record that drives the friction model [m]; empty if it does not matter."""
        if self.law.has_unique_periodic_force or self.output not in segment.lead_in:
            return np.empty(0)
        return segment.lead_in[self.output] / self.displacement_scale

    def _forces(self, segments: Sequence[Segment]) -> list[NDArray[np.float64]]:
        """Return the friction model's force [N] along each segment, each of shape (periods, samples × points).

        The mean over the periods is the force along the whole record, in which noise hides the fewest terms. Removing
        those terms makes its periods alike, so their scatter is taken from the forces along each single period: a
        covariance then includes the noise that acts through friction, which is most of it if friction is most of the
        input.
        """
        found = [self._kept_force(segment) for segment in segments]
        missing = [segment for segment, force in zip(segments, found, strict=True) if force is None]
        computed = iter(*self._forces_along(missing, self._motions(missing)) if missing else [()])
        return [next(computed) if force is None else force for force in found]

    def _kept_force(self, segment: Segment) -> NDArray[np.float64] | None:
        kept = self._tried.get(id(segment))
        return kept.force if kept and kept.segment is segment and kept.driving == self._driving(segment) else None

    def _driving(self, segment: Segment) -> tuple[object, ...]:
        """Return all on which the friction model's force along a segment depends."""
        lags, points = self.output_time_constants, self.points(segment)
        return id(self.law), self.displacement_scale, self.noise, self.resolution, self.output, lags, points

    def _motions(self, segments: Sequence[Segment]) -> list[list[Motion]]:
        """Return the motion along each whole segment, and those of its single periods if noise tells them apart."""
        whole = [self.motion(segment) for segment in segments]
        return [[motion, *self._motions_of_periods(of, motion)] for of, motion in zip(segments, whole, strict=True)]

    def _forces_along(
        self, segments: Sequence[Segment], *motions: Sequence[Sequence[Motion]]
    ) -> list[list[NDArray[np.float64]]]:
        """Return the force along each segment for each of several sets of motions, which are run side by side."""
        forces = iter(self.forces_along([motion for of_set in motions for own in of_set for motion in own]))
        return [
            [_with_scatter([next(forces) for _ in own], len(segment.channels[self.output])) for segment, own in pairs]
            for pairs in (zip(segments, of_set, strict=True) for of_set in motions)
        ]

    def forces_along(self, motions: Sequence[Motion]) -> list[NDArray[np.float64]]:
        """Return the friction model's force [N] along motions, each of its displacement's shape.

        Of a motion that repeats, the turns are all that a model without memory of its speed needs of the period before.
        """
        if self.law.has_unique_periodic_force:
            motions = [motion._replace(lead_in=_turns(motion)) if motion.periodic else motion for motion in motions]
        return self.law.forces(motions)

    def _motions_of_periods(self, segment: Segment, whole: Motion) -> list[Motion]:
        """Return the motion of each single period, with the terms that stand out of the noise of the whole record."""
        y = segment.channels[self.output]
        if len(y) < 2 or is_from_rest(segment) or not (self.noise or self.resolution):
            return []
        kept = self._bins(segment)[:: len(y)] != 0
        bins = np.where(kept, np.fft.rfft(y, axis=1), 0)
        unlagged = [self._without_output_lags(row, y.shape[1], segment.sample_time) for row in bins]
        motions = [resample(row, y.shape[1], self.points(segment)) for row in unlagged]
        return [whole._replace(displacement=motion / self.displacement_scale) for motion in motions]

    def motion(self, segment: Segment) -> Motion:
        """Return the motion that drives the friction model: all periods of a segment, after its lead-in."""
        repeats = not is_from_rest(segment)
        fine = self._fine_displacement(segment) if repeats else self._fine_displacement_from_rest(segment)
        time_step = segment.sample_time / self.points(segment)
        return Motion(fine / self.displacement_scale, time_step, repeats, self.lead_in(segment), segment.sample_time)

    def _fine_displacement(self, segment: Segment) -> NDArray[np.float64]:
        """Return all periods of a record, one after another, at several points per sample."""
        size = segment.channels[self.output].size
        bins = self._without_output_lags(self._bins(segment), size, segment.sample_time)
        return resample(bins, size, self.points(segment))

    def _bins(self, segment: Segment) -> NDArray[np.complex128]:
        """Return the Fourier series of a record without the terms below the encoder's resolution and noise."""
        periods, samples = segment.channels[self.output].shape
        # rounding repeats itself from period to period and adds up, noise does not
        scatter = self.noise**2 * periods + self.resolution**2 / 12 * periods**2
        return _significant_terms(record_spectrum(segment, self.output), scatter * samples)

    def mean_motion(self, segment: Segment) -> Motion:
        """Return the motion of the mean over the periods, in which noise hides fewer terms."""
        exact = self.model_copy(update={"noise": 0.0, "resolution": 0.0})
        return exact.motion(replace(segment, channels={self.output: self.clear_period(segment, self.output)}))

    def clear_period(self, segment: Segment, channel: str) -> NDArray[np.float64]:
        """Return the mean period of a position [m] without the terms that noise and rounding hide, (1, samples)."""
        count, samples = segment.channels[channel].shape
        bins = record_spectrum(segment, channel)[::count] / count
        scatter = (self.noise**2 / count + self.resolution**2 / 12) * samples
        return np.fft.irfft(_significant_terms(bins, scatter), samples)[None]

    def _fine_displacement_from_rest(self, segment: Segment) -> NDArray[np.float64]:
        """Return the same for a record that begins at rest and does not return to it.

        The record is mirrored at its end: a Fourier series rings if its end and its beginning differ, and the friction
        model would take that for reversals.
        """
        record = segment.channels[self.output].ravel()
        mirrored = np.concatenate([record, record[::-1]])
        scatter = self.noise**2 + self.resolution**2 / 12
        bins = _significant_terms(np.fft.rfft(mirrored), scatter * mirrored.size)
        bins = self._without_output_lags(bins, mirrored.size, segment.sample_time)
        points = self.points(segment)
        return resample(bins, mirrored.size, points)[: record.size * points]

    def _without_output_lags(
        self, bins: NDArray[np.complex128], size: int, sample_time: float
    ) -> NDArray[np.complex128]:
        """Return a Fourier series of `size` samples without G_do's lags, which act behind the friction."""
        if not self.output_time_constants:
            return bins
        omega = 2 * np.pi * np.fft.rfftfreq(size, sample_time)
        return bins / path_response(omega, 0.0, self.output_time_constants)


def at_lines(
    segments: Sequence[Segment], ratio: Callable[[NDArray[np.float64]], NDArray[np.complex128]]
) -> list[NDArray[np.complex128]]:
    """Return a function of ω [rad/s] at the excited lines of each segment, shape (lines,) each; it is called once."""
    if not segments:
        return []
    omega = 2 * np.pi * np.concatenate([segment.frequency for segment in segments])
    return np.split(ratio(omega), np.cumsum([segment.lines.size for segment in segments])[:-1])


def _turns(motion: Motion) -> NDArray[np.float64]:
    """Return the displacement where a motion begins, turns and ends [m]."""
    rises, is_kept = np.diff(motion.displacement) > 0, np.ones(motion.displacement.size, dtype=bool)
    is_kept[1:-1] = rises[1:] != rises[:-1]
    return motion.displacement[is_kept]


def _examined(segments: Sequence[Segment]) -> Sequence[Segment]:
    """Return the segments that are tried: one of several realisations, which are alike."""
    return segments[:1] if any(segment.lines.size > 1 for segment in segments) else segments


def _every_second_point(motions: Sequence[Sequence[Motion]]) -> list[list[Motion]]:
    return [
        [of._replace(displacement=of.displacement[::2], time_step=2 * of.time_step) for of in own] for own in motions
    ]


def _with_scatter(forces: Sequence[NDArray[np.float64]], periods: int) -> NDArray[np.float64]:
    """Return the force along a record by its periods, with the scatter of those along single periods, if there are."""
    whole, *single = forces
    found = whole.reshape(periods, -1)
    if not single:
        return found
    mean = np.add.reduce(found, axis=0) / len(found)
    return np.asarray(mean + np.stack(single) - np.add.reduce(single, axis=0) / len(single))


def _relative_change(
    linear: NDArray[np.complex128], coarse: NDArray[np.complex128], fine: NDArray[np.complex128]
) -> float:
    """Return the relative change of the mean effective input over periods, over all lines, by the friction force."""
    change, effective = (coarse - fine).mean(axis=0), (linear - fine).mean(axis=0)
    size = float(np.linalg.norm(effective))
    return float(np.linalg.norm(change)) / size if size else 0.0


@lru_cache(8)
def _record_path(delays: LoopDelays, size: int, sample_time: float) -> NDArray[np.complex128]:
    """Return G_di G_do with hold and images at all frequencies of a record, shape (size // 2 + 1,).

    This is the slowest part, and the same for each realisation and each friction model: hence the cache.
    """
    omega = np.asarray(2 * np.pi * np.fft.rfftfreq(size, sample_time), dtype=np.float64)
    return delays.input_path(omega, sample_time) * delays.output_path(omega)


def _significant_terms(bins: NDArray[np.complex128], variance: float) -> NDArray[np.complex128]:
    """Return a Fourier series without the terms that scatter of this variance can explain."""
    return np.where(np.abs(bins) ** 2 < clear_power(bins.size) * variance, 0, bins) if variance else bins


def is_from_rest(segment: Segment) -> bool:
    """Say whether a segment was recorded from rest, its transient included; measured segments count as periodic."""
    return segment.settling is not None and segment.settling.time == 0


def resample(bins: NDArray[np.complex128], samples: int, points: int) -> NDArray[np.float64]:
    """Return a Fourier series at `points` points per sample, shape (samples points,).

    By `points` transforms of the record's own length, whose factors are small.
    """
    return np.fft.irfft(bins * _shifts(samples, points), samples, axis=1).T.ravel()


@cached_arrays(CACHE_BYTES)
def _shifts(samples: int, points: int) -> NDArray[np.complex128]:
    """Return the factors that shift a Fourier series by 0, 1/points… of a sample, shape (points, samples // 2 + 1)."""
    parts = np.arange(points)[:, None] / points
    return np.exp(2j * np.pi * parts * np.arange(samples // 2 + 1) / samples)
