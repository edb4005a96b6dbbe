"""The motion above the Nyquist frequency, which friction causes and samples do not show.

Where elements begin to slip, and above all where damped ones do, the friction force has kinks and steps. Its terms
above the Nyquist frequency move the plant: x = -P∞ f with P∞ = c/(jω)^r above the modes. A position that is
interpolated from its samples lacks this motion, and has its aliases instead.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Segment, fourier_sums, path_response
from fraexp_plugins.estimators._shared.interpolation import resample
from fraexp_plugins.estimators._shared.plant_above_modes import PlantAboveModes


class UnsampledMotion(NamedTuple):
    """What the motion above the Nyquist frequency does to an interpolated position."""

    aliases: NDArray[np.complex128]
    """Phasors of its aliases in the sampled position [m], shape (lines,)."""
    interpolation_error: NDArray[np.float64]
    """The true displacement less the interpolated one [m], along the whole record, shape (n,)."""


class UnsampledErrors(NamedTuple):
    """Phasors at the lines of a segment with what this motion does to them."""

    output: NDArray[np.complex128]
    """Error of the displacement [m], shape (lines,)."""
    force: NDArray[np.complex128]
    """Error of the friction force along the interpolated displacement [N], shape (lines,)."""


def motion_above_nyquist(
    segment: Segment, force: NDArray[np.float64], plant: PlantAboveModes, lags: tuple[float, ...]
) -> UnsampledMotion:
    """Return the motion by the terms of a friction force [N], shape (n,), above the Nyquist frequency of a segment.

    The force has several points per sample of the whole record; `lags` [s] lie between displacement and samples. Of the
    aliases those remain that lie at multiples of the motion's own frequency: others are known as such.
    """
    periods = len(next(iter(segment.channels.values())))
    samples = periods * segment.samples
    points, first = force.size // samples, samples // 2 + 1
    bins = np.fft.rfft(force)
    omega = np.asarray(2 * np.pi * np.arange(bins.size) / (samples * segment.sample_time))
    bins[first:] *= -plant.response(omega[first:])
    bins[:first] = 0
    path = path_response(omega, 0.0, lags)
    sampled = np.fft.irfft(bins * path, force.size)[::points]
    aliases = np.fft.rfft(sampled)
    aliases[np.arange(aliases.size) % (int(np.gcd.reduce(segment.lines)) * periods) != 0] = 0
    interpolated = resample(aliases / path[: aliases.size], samples, points)
    return UnsampledMotion(mean_phasors(segment, sampled), np.fft.irfft(bins, force.size) - interpolated)


def mean_phasors(segment: Segment, values: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the phasors of the mean over the periods, shape (lines,), of values along a whole record, shape (n,)."""
    periods = values.reshape(len(next(iter(segment.channels.values()))), -1)
    return fourier_sums(np.add.reduce(periods, axis=0)[None] / len(periods), segment.lines)[0]
