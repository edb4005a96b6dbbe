"""What noise and rounding of the encoder do to the observer's force: a parametric bootstrap.

B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap, 1993, ch. 6 and 10, doi:10.1201/9780429246593.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse
from fraexp_plugins.estimators._shared.encoder import mean_rounding_error
from fraexp_plugins.estimators._shared.measured_terms import MeasuredTerms, motion_samples, motion_terms
from fraexp_plugins.estimators._shared.weak_terms import LikelyTerms, clear_terms, estimate_motion, likely_spread

DRAWS = 32
"""Simulated repetitions of the experiment."""


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


class DrawnMotions(NamedTuple):
    """Motions that could have given a record, and what would be found of each, by their terms, shape (draws, terms)."""

    lines: NDArray[np.int64]
    """Terms that are excited, shape (lines,)."""
    duration: float
    """Period of the motion [s]."""
    estimated: NDArray[np.complex128]
    """The estimated motion, shape (terms,)."""
    known: NDArray[np.complex128]
    """The same with likely values in place of terms that noise partly hides."""
    drawn: NDArray[np.complex128]
    found: NDArray[np.complex128]
    output: NDArray[np.complex128]
    """Phasors of the displacement [m] less the part of the rounding error that repeats, shape (lines,)."""
    output_correction: NDArray[np.complex128]
    """That part [m]."""
    output_errors: NDArray[np.complex128]
    """Errors of the displacement in each draw [m], shape (draws, lines)."""


def draw_motions(measured: MeasuredTerms, resolution: float, noise: float, likely: LikelyTerms) -> DrawnMotions:
    """Return motions that could have given a periodic record, and what an encoder would show of each.

    They are its terms that stand out of noise and rounding, and of the weaker ones as much as friction, or else their
    neighbours, make likely. Each is measured again, with new noise, and rounded. Rounding that repeats in each period
    is invisible in the scatter over periods, and terms that noise hides are missing in every period alike: both are in
    the errors of what is found.
    """
    samples, stride, lines = measured.periods.shape[1], measured.stride, measured.lines
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
    known = np.where(clear_terms(terms, scatter), motion, likely.mean)
    found, errors = estimate_motion(again, scatter, likely).terms, 2 * (again - drawn)[:, lines]
    output, repeated = 2 * (terms - rounded)[lines], 2 * rounded[lines]
    return DrawnMotions(lines, measured.duration, motion, known, drawn, found, output, repeated, errors)


def simulated_encoder_errors(
    motions: DrawnMotions,
    drawn_forces: NDArray[np.complex128],
    found_forces: NDArray[np.complex128],
    forces: Sequence[NDArray[np.complex128]],
) -> EncoderErrors:
    """Return displacement and friction force with the errors that the encoder causes.

    The phasors of the force along what is found, less those along the drawn motions, each of shape (draws, lines), are
    its errors: their mean is taken off, their scatter is the uncertainty. `forces` are the phasors along the estimated
    and the known motion, and along the estimated one at four and eight times as many points.
    """
    force_errors = found_forces - drawn_forces
    output_mean, force_mean = _mean_over_draws(motions.output_errors), _mean_over_draws(force_errors)
    estimated, known, finer, finest = forces
    return EncoderErrors(
        motions.output - output_mean,
        finest - force_mean,
        motions.output_correction + output_mean,
        force_mean,
        motions.output_errors - output_mean,
        force_errors - force_mean,
        (finest - finer) / 3,  # the error falls with the square of the points
        estimated - known,
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
