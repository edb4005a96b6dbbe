"""The motion above the Nyquist frequency, of which samples show nothing but aliases.

Its causes are the images of the held control input at ω + kω_s, and the friction force: where elements begin to slip,
and above all where damped ones do, that has kinks and steps. Both move the plant, which is P∞ = c/(jω)^r above its
modes. A friction model that is driven by a position interpolated from its samples is driven by the aliases, and lacks
the motion between the samples. The relative error of the force is that of y', and û_e may be a small part of the force.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, Segment, fourier_sums, image_factor, path_response, phasors
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators._shared.effective_input_observer import ObserverEstimator, resample
from fraexp_plugins.estimators._shared.friction_posterior import ForceErrors
from fraexp_plugins.estimators._shared.plant_above_modes import PlantAboveModes


class HoldImages(NamedTuple):
    """Images in the sampled position at the lines of all segments, one after another."""

    phasors: NDArray[np.complex128]
    """Phasors of the images [m], shape (n,)."""
    error: NDArray[np.float64]
    """Relative error of y'/û_e if they are left in y' and the plant counts as a chain of integrators, shape (n,)."""

    def removed_from(self, segments: Sequence[Segment], channel: str) -> tuple[Segment, ...]:
        """Return the segments without them."""
        parts = np.split(self.phasors, np.cumsum([segment.lines.size for segment in segments])[:-1])
        return tuple(_remove_lines(segment, channel, part) for segment, part in zip(segments, parts, strict=True))


def hold_images(
    observer: DelayedEstimator, segments: Sequence[Segment], response: FrequencyResponse, gain: float
) -> HoldImages:
    """Return the images in all segments, from the response without friction.

    y' = P û_e + H with H = P∞ (F - 1) G u: G is the path to the plant without images, F their factor.
    """
    degree = observer.relative_degree
    omega = 2 * np.pi * np.concatenate([segment.frequency for segment in segments])
    sample_time = np.concatenate([np.full(segment.lines.size, segment.sample_time) for segment in segments])
    u, y = (_mean_phasors(segments, name) for name in (observer.input, observer.output))
    bare = observer.model_copy(update={"relative_degree": 0})
    direct = bare.input_path(omega, sample_time) * observer.output_path(omega) * u
    delays = observer.input_dead_time + observer.output_dead_time
    lags = observer.input_time_constants + observer.output_time_constants
    folded = direct * (image_factor(omega, sample_time, delays, lags, degree) - 1)
    images = gain / (1j * omega) ** degree * folded
    order = np.argsort(response.frequency)
    plant = np.interp(omega, 2 * np.pi * response.frequency[order], response.response[order])
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        friction = np.abs(direct * plant / y - 1)
        error = (np.abs(images - plant * folded) + np.abs(images) * friction) / np.abs(y)
    return HoldImages(np.nan_to_num(images), np.nan_to_num(error, posinf=0.0))


def unsampled_errors(
    observer: ObserverEstimator, segments: Sequence[Segment], plant: PlantAboveModes
) -> list[ForceErrors]:
    """Return the errors by the motion that the friction of the only contact causes above the Nyquist frequency."""
    motions = [observer.mean_motion(segment) for segment in segments]
    along = observer.forces_along(motions)
    found = [
        _motion_above_nyquist(observer, segment, force, plant) for segment, force in zip(segments, along, strict=True)
    ]
    moved = [
        motion._replace(displacement=motion.displacement + lacking / observer.displacement_scale)
        for motion, (_, lacking) in zip(motions, found, strict=True)
    ]
    changes = zip(segments, found, along, observer.forces_along(moved), strict=True)
    errors = []
    for segment, (aliases, _), taken, true in changes:
        omega = 2 * np.pi * segment.frequency
        force = fourier_sums((taken - true)[None], segment.lines)[0] * observer.force_factor(omega)
        errors.append(ForceErrors(aliases, force + 1j * omega * observer.law.viscous * aliases))
    return errors


def _motion_above_nyquist(
    observer: ObserverEstimator, segment: Segment, force: NDArray[np.float64], plant: PlantAboveModes
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return the aliases of the motion by the terms of a friction force [N], shape (n,), above the Nyquist frequency.

    They are phasors in the sampled position [m], shape (lines,). The second value is the true displacement less the
    interpolated one [m], along a period, shape (n,). The force has several points per sample of a period. Of the
    aliases those remain that lie at multiples of the motion's own frequency: others are known as such.
    """
    points, first = force.size // segment.samples, segment.samples // 2 + 1
    bins = np.fft.rfft(force)
    omega = np.asarray(2 * np.pi * np.arange(bins.size) / (segment.samples * segment.sample_time))
    bins[first:] *= -plant.response(omega[first:])
    bins[:first] = 0
    path = path_response(omega, 0.0, observer.output_time_constants)
    sampled = np.fft.irfft(bins * path, force.size)[::points]
    aliases = np.fft.rfft(sampled)
    aliases[np.arange(aliases.size) % int(np.gcd.reduce(segment.lines)) != 0] = 0
    interpolated = resample(aliases / path[: aliases.size], segment.samples, points)
    return fourier_sums(sampled[None], segment.lines)[0], np.fft.irfft(bins, force.size) - interpolated


def _mean_phasors(segments: Sequence[Segment], channel: str) -> NDArray[np.complex128]:
    """Return the phasors of a channel at the lines of all segments, the mean over the periods, shape (n,)."""
    sums = [phasors(segment, channel) for segment in segments]
    if len({len(each) for each in sums}) == 1:  # the means of all at once
        joined = np.concatenate(sums, axis=1)
        return np.asarray(np.add.reduce(joined) / len(joined))
    return np.concatenate([np.add.reduce(each) / len(each) for each in sums])


def _remove_lines(segment: Segment, channel: str, phasors: NDArray[np.complex128]) -> Segment:
    """Return a segment without parts of a channel at its lines."""
    bins = np.zeros(segment.samples // 2 + 1, dtype=complex)
    bins[segment.lines] = phasors * (segment.samples / 2)
    position = segment.channels[channel] - np.fft.irfft(bins, segment.samples)
    return replace(segment, channels={**segment.channels, channel: position})
