"""The Fourier series of a periodic motion that an encoder measured, and the scatter of its terms."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Segment
from fraexp_plugins.estimators._shared.encoder import repeated_rounding_variance


class MeasuredTerms(NamedTuple):
    """The mean over all repetitions of a motion in a segment."""

    periods: NDArray[np.float64]
    """The samples of each repetition [m], shape (count, samples); a motion may repeat itself within a period."""
    stride: int
    """Lines of a repetition from one term of the motion to the next: samples may repeat places of several turns."""
    lines: NDArray[np.int64]
    """Terms that are excited, shape (lines,)."""
    duration: float
    """Period of the motion [s]."""
    terms: NDArray[np.complex128]
    """Coefficients of the series [m], shape (terms,)."""
    random: float
    """Variance of a term by noise and by rounding that differs from repetition to repetition [m²]."""
    scatter: float
    """The same with the rounding that repeats."""

    @property
    def omega(self) -> NDArray[np.float64]:
        """Frequencies of the terms [rad/s], shape (terms,)."""
        return np.asarray(2 * np.pi / self.duration * np.arange(self.terms.size))


def measured_terms(segment: Segment, channel: str, resolution: float, noise: float) -> MeasuredTerms:
    """Return the terms of the position in a segment, measured with a quantisation step [m] and noise [m]."""
    step = int(np.gcd.reduce(segment.lines))  # the motion repeats itself so often in a period
    repeats = int(np.gcd(step, segment.samples))  # and so often at the same samples
    periods = segment.channels[channel].reshape(-1, segment.samples // repeats)
    count, samples = periods.shape
    stride, lines, duration = step // repeats, segment.lines // step, segment.samples * segment.sample_time / step
    repeated = repeated_rounding_variance(resolution, noise)
    random = max(noise**2 + resolution**2 / 12 - repeated, 0.0) / (count * samples)
    terms = motion_terms(np.add.reduce(periods, axis=0) / count, stride)
    return MeasuredTerms(periods, stride, lines, duration, terms, random, random + repeated / samples)


def motion_terms(samples: NDArray[np.float64], stride: int) -> NDArray[np.complex128]:
    """Return the Fourier coefficients of a motion at every `stride`-th line below Nyquist, shape (..., terms)."""
    size = samples.shape[-1]
    return np.fft.rfft(samples)[..., : (size + 1) // 2 : stride] / size


def motion_samples(terms: NDArray[np.complex128], samples: int, stride: int) -> NDArray[np.float64]:
    """Return the motion of such coefficients, shape (..., samples)."""
    bins = np.zeros((*terms.shape[:-1], samples // 2 + 1), dtype=complex)
    bins[..., : (samples + 1) // 2 : stride] = terms
    return np.fft.irfft(bins, samples) * samples
