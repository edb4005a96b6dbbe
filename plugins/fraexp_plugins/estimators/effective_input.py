"""The effective control input observer: what of the control input moves the plant once friction is taken off."""

import itertools
from abc import ABC
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from fraexp.api import (
    FrictionModel,
    Motion,
    Segment,
    Signals,
    fourier_sums,
    param,
    path_response,
    phasors,
    spectrum_of,
)
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.delayed import DelayedEstimator

EFFECTIVE_INPUT = "u_e"
"""Name of the channel û_e."""
TABULATED = 4096
"""Samples of a record up to which the shifts of its Fourier series are kept: many sweeps have the same ones."""
CLEAR = 3.0
"""How many standard deviations of its scatter a term of the Fourier series must have to be kept."""
AT_ONCE = 8192
"""Frequencies at which the images of sampling are summed at once: a hundred numbers each."""


class EffectiveInputEstimator(DelayedEstimator, ABC):
    """An estimator that knows a friction model: û_e = G_di G_do u - f̂, the observer of eqs (2)-(5).

    The friction model is driven by y' in the time domain, the delays are applied at each frequency. Between its
    samples y' is interpolated by its Fourier series, which is exact for a periodic response; a friction model fed
    with the samples alone would miss the peaks by A(1 - cos(ωTs/2)). Terms of the series that the scale's
    resolution and noise hide are left out: the model would take them for reversals.
    """

    friction: FrictionModel = param("", "friction model FM of the observer", inherit="friction")
    force_scale: float = param("1", "factor on the model's force, such as 1.1 for a ΣF_m 10 % too large", 1.0, above=0)
    width_scale: float = param("1", "factor on the model's deflections Y_m, at the same ΣF_m", 1.0, above=0)
    resolution: float = param("m", "resolution of the scale", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the scale's noise", 0.0, at_least=0, inherit="loop.noise")
    interpolation: int = param(
        "1", "points per sample at which the friction model is driven", 4, at_least=1, at_most=64
    )

    def effective_phasors(self, segments: Sequence[Segment]) -> list[np.ndarray]:
        """Return the phasors of û_e [N] at the excited lines per segment, each of shape (periods, lines), eq (2)."""
        if not segments:
            return []
        counts = [segment.lines.size for segment in segments]
        omega = 2 * np.pi * np.concatenate([segment.frequency for segment in segments])
        times = {segment.sample_time for segment in segments}
        sample_time = times.pop() if len(times) == 1 else np.repeat([s.sample_time for s in segments], counts)
        path = self.input_path(omega, sample_time) * self.output_path(omega)
        viscous = 1j * omega * self.friction.viscous
        factors = zip(*(np.split(factor, np.cumsum(counts)[:-1]) for factor in (path, viscous)), strict=True)
        forces = self._friction_phasors(segments)
        return [
            delayed * phasors(segment, self.input) - damping * phasors(segment, self.output) - force
            for segment, (delayed, damping), force in zip(segments, factors, forces, strict=True)
        ]

    def with_effective_input(self, signals: Signals) -> Signals:
        """Return the signals with û_e [N] as one more channel, at the samples and limited to their band.

        Delays, hold and viscous friction act on the spectrum of the whole record. Where it does not repeat itself they
        treat its end as what came before its beginning: their difference is as smooth over frequency as the
        transient itself, and estimators that take off the transient take it off too.
        """
        unit = signals.unit(self.input)
        delays = Conventional(**{name: getattr(self, name) for name in DelayedEstimator.model_fields})
        found = []
        for segment, force in zip(signals.segments, self._forces(signals.segments), strict=True):
            shape, size = segment.channels[self.output].shape, segment.channels[self.output].size
            path = _path(delays, size, segment.sample_time)
            effective = np.fft.irfft(self._effective_bins(segment, force.ravel(), path), size)
            more = replace(segment, channels={**segment.channels, EFFECTIVE_INPUT: effective.reshape(shape)})
            more.cache.update(segment.cache)
            found.append(more)
        return replace(signals, segments=tuple(found), units={**signals.units, EFFECTIVE_INPUT: unit})

    def _effective_bins(self, segment: Segment, force: np.ndarray, path: np.ndarray) -> np.ndarray:
        size = segment.channels[self.output].size
        omega = 2 * np.pi * np.fft.rfftfreq(size, segment.sample_time)
        friction = np.fft.rfft(force)[: omega.size] * (self.force_scale / self.interpolation)
        if self.output_lags:
            friction = friction * path_response(omega, 0.0, self.output_lags)
        viscous = 1j * omega * self.friction.viscous * spectrum_of(segment, self.output)
        bins: np.ndarray = path * spectrum_of(segment, self.input) - viscous - friction
        return bins

    def _friction_phasors(self, segments: Sequence[Segment]) -> list[np.ndarray]:
        """Return the phasors of the friction model's force [N] per segment, each of shape (periods, lines)."""
        found = []
        for segment, periods in zip(segments, self._forces(segments), strict=True):
            lagged = path_response(2 * np.pi * segment.frequency, 0.0, self.output_lags)
            found.append(fourier_sums(periods, segment.lines) * (self.force_scale * lagged))
        return found

    def _forces(self, segments: Sequence[Segment]) -> list[np.ndarray]:
        """Return the friction model's force [N] along each segment, each (periods, samples interpolation).

        Their mean over the periods is that along the whole record, whose terms are told best from noise. Where noise is
        cleared away the periods there are alike: their scatter is that of the forces along each period alone, so that
        a covariance holds what noise does by way of friction. That is most of it where friction is most of the input.
        """
        motions = [self._motion(segment) for segment in segments]
        alone = [self._motions_of_periods(*pair) for pair in zip(segments, motions, strict=True)]
        forces = self.friction.forces([*motions, *itertools.chain.from_iterable(alone)])
        others, found = iter(forces[len(motions) :]), []
        for segment, force, some in zip(segments, forces[: len(motions)], alone, strict=True):
            periods = force.reshape(-1, segment.samples * self.interpolation)
            if some:
                single = np.stack([next(others) for _ in some])
                mean = np.add.reduce(periods, axis=0) / len(periods)
                periods = mean + single - np.add.reduce(single, axis=0) / len(single)
            found.append(periods)
        return found

    def _motions_of_periods(self, segment: Segment, whole: Motion) -> list[Motion]:
        """Return the motion of each period as if it were all, with the terms that the whole record tells from noise."""
        y = segment.channels[self.output]
        if len(y) < 2 or from_rest(segment) or not (self.noise or self.resolution):
            return []
        kept = self._bins(segment)[:: len(y)] != 0
        bins = np.where(kept, np.fft.rfft(y, axis=1), 0)
        unlagged = [self._unlagged(row, y.shape[1], segment.sample_time) for row in bins]
        motions = [_between(row, y.shape[1], self.interpolation) for row in unlagged]
        return [whole._replace(displacement=motion / self.width_scale) for motion in motions]

    def _motion(self, segment: Segment) -> Motion:
        """Return what the friction model sees of a segment: all its periods, after what came before."""
        repeats = not from_rest(segment)
        fine = self._interpolated(segment) if repeats else self._interpolated_from_rest(segment)
        before = np.empty(0) if self.friction.forgets else segment.lead_in.get(self.output, np.empty(0))
        time_step = segment.sample_time / self.interpolation
        if self.width_scale != 1.0:
            fine, before = fine / self.width_scale, before / self.width_scale
        return Motion(fine, time_step, repeats, before, segment.sample_time)

    def _interpolated(self, segment: Segment) -> np.ndarray:
        """Return all periods of a record, one after another, at `interpolation` times as many points."""
        size = segment.channels[self.output].size
        return _between(self._unlagged(self._bins(segment), size, segment.sample_time), size, self.interpolation)

    def _bins(self, segment: Segment) -> np.ndarray:
        """Return the Fourier series of a record without the terms that the scale hides."""
        periods, samples = segment.channels[self.output].shape
        # rounding repeats itself from period to period and adds up, noise does not
        scatter = self.noise**2 * periods + self.resolution**2 / 12 * periods**2
        return _cleared(spectrum_of(segment, self.output), scatter * samples)

    def _interpolated_from_rest(self, segment: Segment) -> np.ndarray:
        """Return the same of a record that begins at rest and does not return to it.

        It is mirrored at its end: a Fourier series rings where its end and its beginning differ, and the friction
        model would take that for reversals.
        """
        record = segment.channels[self.output].ravel()
        mirrored = np.concatenate([record, record[::-1]])
        scatter = self.noise**2 + self.resolution**2 / 12
        bins = _cleared(np.fft.rfft(mirrored), scatter * mirrored.size)
        bins = self._unlagged(bins, mirrored.size, segment.sample_time)
        fine = _between(bins, mirrored.size, self.interpolation)
        return fine[: record.size * self.interpolation]

    def _unlagged(self, bins: np.ndarray, size: int, sample_time: float) -> np.ndarray:
        """Return a Fourier series of `size` samples without G_do's lags, which change the motion that friction sees."""
        if not self.output_lags:
            return bins
        omega = 2 * np.pi * np.fft.rfftfreq(size, sample_time)
        return bins / path_response(omega, 0.0, self.output_lags)


@lru_cache(8)
def _path(delays: Conventional, size: int, sample_time: float) -> np.ndarray:
    """Return G_di G_do with hold and images at all frequencies of a record, shape (size // 2 + 1,).

    It takes longer than all the rest, and the same again for each realisation and each other friction model.
    """
    omega = 2 * np.pi * np.fft.rfftfreq(size, sample_time)
    parts = np.array_split(omega, -(-omega.size // AT_ONCE))
    return np.concatenate([delays.input_path(part, sample_time) * delays.output_path(part) for part in parts])


def _cleared(bins: np.ndarray, variance: float) -> np.ndarray:
    """Return a Fourier series without the terms that scatter of this variance hides."""
    return np.where(np.abs(bins) < CLEAR * np.sqrt(variance), 0, bins) if variance else bins


def from_rest(segment: Segment) -> bool:
    """Say whether a segment was recorded from rest, its transient included; measured ones count as periodic."""
    return segment.settling is not None and segment.settling.time == 0


def _between(bins: np.ndarray, samples: int, points: int) -> np.ndarray:
    """Return a Fourier series at `points` points per sample, shape (samples points,)."""
    if samples <= TABULATED:  # as many transforms of a record's own length, whose factors are known to be small
        found: np.ndarray = np.fft.irfft(bins * _shifts(samples, points), samples, axis=1).T.ravel()
        return found
    if samples % 2 == 0:
        bins = np.append(bins[:-1], bins[-1] / 2)  # the Nyquist line stands for two
    return np.fft.irfft(bins, samples * points) * points


@lru_cache(512)
def _shifts(samples: int, points: int) -> np.ndarray:
    """Return what moves a Fourier series by 0, 1… of `points` parts of a sample, shape (points, samples // 2 + 1)."""
    parts = np.arange(points)[:, None] / points
    shifts: np.ndarray = np.exp(2j * np.pi * parts * np.arange(samples // 2 + 1) / samples)
    return shifts
