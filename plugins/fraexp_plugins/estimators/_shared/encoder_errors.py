"""What noise and rounding of the encoder do to the observer's force: a parametric bootstrap.

B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap, 1993, ch. 6 and 10, doi:10.1201/9780429246593.
"""

import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, fourier_sums
from fraexp_plugins.estimators._shared.encoder import mean_rounding_error
from fraexp_plugins.estimators._shared.measured_terms import MeasuredTerms, motion_samples, motion_terms
from fraexp_plugins.estimators._shared.weak_terms import LikelyTerms, clear_terms, estimate_motion, likely_spread

DRAWS = 32
"""Simulated repetitions of the experiment."""
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
    measured: MeasuredTerms, resolution: float, noise: float, likely: LikelyTerms, force: ForceOfMotions
) -> EncoderErrors:
    """Return displacement and friction force of a periodic record with the errors that the encoder causes.

    Motions are drawn that could have given the record: its terms that stand out of noise and rounding, and of the
    weaker ones as much as friction, or else their neighbours, make likely. Each is measured again, with new noise, and
    rounded; the force along what is then found, less the force along the drawn motion, is one error of the force. Their
    mean is taken off, their scatter is the uncertainty. Rounding that repeats in each period is invisible in the
    scatter over periods, and terms that noise hides are missing in every period alike: both are in these errors.
    """
    samples, stride, lines, duration = measured.periods.shape[1], measured.stride, measured.lines, measured.duration
    terms, scatter = measured.terms, measured.scatter

    def rounding(motion: NDArray[np.complex128]) -> NDArray[np.complex128]:
        position = motion_samples(motion, samples, stride)
        return motion_terms(mean_rounding_error(position, resolution, noise), stride)

    normal = _normal_terms(terms.size, zlib.crc32(measured.periods.tobytes()))
    motion, share = estimate_motion(terms, scatter, likely)
    spread = likely_spread(likely, share, scatter, next(normal))
    rounded = _mean_over_draws(rounding(motion + spread))
    motion = motion - share * rounded
    drawn = motion + spread
    again = drawn + np.sqrt(measured.random) * next(normal) + rounding(drawn) - rounded
    found = estimate_motion(again, scatter, likely).terms
    known = np.where(clear_terms(terms, scatter), motion, likely.mean)
    forces = fourier_sums(force(np.concatenate([drawn, found, [motion, known]]), duration, 1), lines)
    force_errors = forces[DRAWS : 2 * DRAWS] - forces[:DRAWS]
    output_errors = 2 * (again - drawn)[:, lines]
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
