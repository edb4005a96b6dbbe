"""The images of the hold in a sampled position: they are no motion at the frequency at which they appear.

The control input is held between samples. Its images at ω + kω_s move the plant too, and the sampled position contains
them at ω: y' = P û_e + H with H = P∞ (F - 1) G u. G is the path to the plant without images, F their factor, and
P∞ = c/(jω)^r the plant above its modes. A friction model that is driven by y' is driven by too much. The relative error
of the force is that of y', and û_e may be a small part of the force.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, Segment, image_factor, phasors
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator

UPPER_RANGE = 2.0
"""Ratio of the highest frequency to the lowest one at which the plant counts as above its modes."""


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
    """Return the images in all segments, from the response without friction and the plant's c above its modes."""
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


def gain_above_modes(response: FrequencyResponse, relative_degree: int) -> float:
    """Return c of a plant that falls as c/(jω)^r [m/(N s^r)], from the highest frequencies of its response."""
    usable = np.isfinite(response.response) & (response.frequency > 0)
    frequency, values = response.frequency[usable], response.response[usable]
    upper = frequency >= frequency.max(initial=0.0) / UPPER_RANGE
    gains = np.real(values[upper] * (2j * np.pi * frequency[upper]) ** relative_degree)
    return float(np.median(gains)) if gains.size else 0.0
