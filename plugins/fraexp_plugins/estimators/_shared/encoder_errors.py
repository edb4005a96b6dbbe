"""What noise and rounding of the encoder do to the observer's force: a parametric bootstrap.

B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap, 1993, ch. 6 and 10, doi:10.1201/9780429246593.
"""

import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, Segment, fourier_sums
from fraexp_plugins.estimators._shared.encoder import mean_rounding_error, repeated_rounding_variance

DRAWS = 32
"""Simulated repetitions of the experiment."""
CLEAR_TERM_STDS = 3.0
"""Size of a term of the Fourier series, in standard deviations of its noise, from which all of it counts as motion."""
MIN_NEIGHBOURS = 4
"""Terms on either side from which the power of a weaker one is taken, at least."""
NEIGHBOUR_SHARE = 3
"""One of so many of the terms below it: the spectrum of a motion falls over a ratio of frequencies."""
MIN_POWER_STDS = 2.0
"""Mean power above that of noise, in standard deviations, from which it counts as motion."""

ForceOfMotions = Callable[[NDArray[np.complex128], float, int], NDArray[np.float64]]
"""Returns the force [N] over one period of motions, shape (motions, n), from the coefficients of their Fourier series,
shape (motions, terms), their period [s], and the factor by which they are interpolated more finely than usual."""


class EncoderErrors(NamedTuple):
    """Phasors at the lines of a segment with what the encoder does to them."""

    output: NDArray[np.complex128]
    """Displacement [m] less the part of the rounding error that repeats, shape (lines,)."""
    force: NDArray[np.complex128]
    """Force along the motion [N] less its mean error, shape (lines,)."""
    output_correction: NDArray[np.complex128]
    """Mean error of the displacement [m] that was taken off, shape (lines,)."""
    force_correction: NDArray[np.complex128]
    """Mean error of the force [N] that was taken off, shape (lines,)."""
    output_errors: NDArray[np.complex128]
    """Errors of the displacement in each repetition around their mean [m], shape (draws, lines)."""
    force_errors: NDArray[np.complex128]
    """Errors of the force likewise [N], shape (draws, lines)."""
    interpolation_error: NDArray[np.complex128]
    """Error of the force [N] by interpolation, from a change of the points per sample, shape (lines,)."""
    weak_term_force: NDArray[np.complex128]
    """What terms that noise partly hides contribute to the force [N], shape (lines,)."""

    def scaled(self, factor: NDArray[np.complex128]) -> "EncoderErrors":
        """Return it with all forces times a factor, shape (lines,)."""
        names = ("force", "force_correction", "force_errors", "interpolation_error", "weak_term_force")
        return self._replace(**{name: getattr(self, name) * factor for name in names})


def simulated_encoder_errors(
    segment: Segment, channel: str, resolution: float, noise: float, force: ForceOfMotions
) -> EncoderErrors:
    """Return displacement and friction force of a periodic record with the errors that the encoder causes.

    Motions are drawn that could have given the record: its terms that stand out of noise and rounding, and of the
    weaker ones as much as their neighbours make likely. Each is measured again, with new noise, and rounded; the force
    along what is then found, less the force along the drawn motion, is one error of the force. Their mean is taken off,
    their scatter is the uncertainty. Rounding that repeats in each period is invisible in the scatter over periods,
    and terms that noise hides are missing in every period alike: both are in these errors.
    """
    step = int(np.gcd.reduce(segment.lines))  # the motion repeats itself so often in a period
    repeats = int(np.gcd(step, segment.samples))  # and so often at the same samples
    periods = segment.channels[channel].reshape(-1, segment.samples // repeats)
    count, samples = periods.shape
    stride, lines, duration = step // repeats, segment.lines // step, segment.samples * segment.sample_time / step
    repeated = repeated_rounding_variance(resolution, noise)
    random = max(noise**2 + resolution**2 / 12 - repeated, 0.0) / (count * samples)
    scatter = random + repeated / samples
    terms = motion_terms(np.add.reduce(periods, axis=0) / count, stride)

    def rounding(motion: NDArray[np.complex128]) -> NDArray[np.complex128]:
        position = motion_samples(motion, samples, stride)
        return motion_terms(mean_rounding_error(position, resolution, noise), stride)

    normal = _normal_terms(terms.size, zlib.crc32(periods.tobytes()))
    share = motion_shares(terms, scatter)
    spread = np.sqrt(share * scatter) * next(normal)
    rounded = _mean_over_draws(rounding(share * terms + spread))
    motion = share * (terms - rounded)
    drawn = motion + spread
    measured = drawn + np.sqrt(random) * next(normal) + rounding(drawn) - rounded
    found = motion_shares(measured, scatter) * measured
    clear = np.where(share == 1, motion, 0)
    forces = fourier_sums(force(np.concatenate([drawn, found, [motion, clear]]), duration, 1), lines)
    force_errors = forces[DRAWS : 2 * DRAWS] - forces[:DRAWS]
    output_errors = 2 * (measured - drawn)[:, lines]
    output_mean, force_mean = _mean_over_draws(output_errors), _mean_over_draws(force_errors)
    finer, finest = (fourier_sums(force(motion[None, :], duration, factor), lines)[0] for factor in (4, 8))
    return EncoderErrors(
        2 * (terms - rounded)[lines] - output_mean,
        finest - force_mean,
        2 * rounded[lines] + output_mean,
        force_mean,
        output_errors - output_mean,
        force_errors - force_mean,
        (finest - finer) / 3,  # the error falls with the square of the points
        forces[-2] - forces[-1],
    )


def motion_terms(samples: NDArray[np.float64], stride: int) -> NDArray[np.complex128]:
    """Return the Fourier coefficients of a motion at every `stride`-th line below Nyquist, shape (..., terms)."""
    size = samples.shape[-1]
    return np.fft.rfft(samples)[..., : (size + 1) // 2 : stride] / size


def motion_samples(terms: NDArray[np.complex128], samples: int, stride: int) -> NDArray[np.float64]:
    """Return the motion of such coefficients, shape (..., samples)."""
    bins = np.zeros((*terms.shape[:-1], samples // 2 + 1), dtype=complex)
    bins[..., : (samples + 1) // 2 : stride] = terms
    return np.fft.irfft(bins, samples) * samples


def with_error_vectors(
    response: FrequencyResponse, ratio: NDArray[np.complex128], errors: NDArray[np.complex128]
) -> FrequencyResponse:
    """Return a response with another value and the covariance of its errors, complex, shape (vectors, n).

    Where the periods scatter more than noise and rounding explain, the band is as wide as their scatter: something
    else disturbs the machine. The degrees of freedom are those of both parts, after Welch and Satterthwaite.
    """
    parts = np.stack([errors.real, errors.imag])
    covariance = np.moveaxis(np.add.reduce(parts[:, None] * parts[None, :], axis=2), -1, 0)
    explained, shown = (np.trace(each, axis1=1, axis2=2) for each in (covariance, response.covariance))
    total = np.fmax(explained, shown)
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        share = explained / total
        covariance = covariance / share[:, None, None]
        known = response.freedom if response.freedom is not None else np.inf
        freedom = 1 / (share**2 / (DRAWS - 1) + (1 - share) ** 2 / known)
    ratio = np.where(np.isfinite(response.response), ratio, np.nan)
    return replace(response, response=ratio, covariance=covariance, freedom=freedom)


def motion_shares(terms: NDArray[np.complex128], scatter: float) -> NDArray[np.float64]:
    """Return the share of each term of Fourier series that is motion rather than scatter, 0 … 1, shape (..., terms).

    `scatter` is the variance of a term. A clear term is kept whole. A weaker one is shrunk by Wiener's v/(v + s): v is
    the mean power of its neighbours of the same parity less the scatter s, because the even terms of a motion that is
    odd about its middle vanish. Terms that are cut off entirely are missing in the force, all in the same direction.
    """
    power = np.abs(terms) ** 2 / scatter
    share = np.ones(power.shape)
    for first in (1, 2):
        share[..., first::2] = _wiener_shares(power[..., first::2])
    return share


def _wiener_shares(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shares of terms from their power in units of the scatter, shape (..., terms)."""
    excess = np.minimum(power, CLEAR_TERM_STDS**2) - 1
    number = np.arange(power.shape[-1])
    reach = np.maximum(MIN_NEIGHBOURS, number // NEIGHBOUR_SHARE)
    first, behind = np.maximum(number - reach, 0), np.minimum(number + reach + 1, number.size)
    sums = np.concatenate([np.zeros((*power.shape[:-1], 1)), np.cumsum(excess, axis=-1)], axis=-1)
    neighbours = behind - first
    mean = (sums[..., behind] - sums[..., first]) / neighbours
    likely = np.where(mean * np.sqrt(neighbours) > MIN_POWER_STDS, mean, 0.0)
    return np.where(power >= CLEAR_TERM_STDS**2, 1.0, likely / (likely + 1))


def _mean_over_draws(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the mean over the first axis, summed in a fixed order."""
    return np.add.reduce(values, axis=0) / len(values)


def _normal_terms(count: int, seed: int) -> Iterator[NDArray[np.complex128]]:
    """Yield Fourier coefficients of white noise, each with a variance of 1, of shape (draws, count).

    Their mean over the draws is zero: the mean error is then free of the noise that merely passes through.
    """
    generator = np.random.default_rng(seed)
    while True:
        noise = generator.standard_normal((DRAWS, 2 * count)).view(complex) * np.sqrt(0.5)
        yield noise - _mean_over_draws(noise)
