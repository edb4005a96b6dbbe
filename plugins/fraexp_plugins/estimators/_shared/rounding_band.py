"""A response with the rounding of its output that repeats in every period: what the scatter over periods lacks."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, Segment, phasors
from fraexp_plugins.estimators._shared.encoder import (
    mean_rounding_error,
    noise_from_scatter,
    repeated_rounding_variance,
)
from fraexp_plugins.estimators._shared.measured_terms import motion_samples, motion_terms
from fraexp_plugins.estimators._shared.weak_terms import motion_shares


class RepeatedRounding(NamedTuple):
    """Rounding error of the output at the lines of a segment that repeats in every period."""

    error: NDArray[np.complex128]
    """Its phasors as far as the record shows them, relative to the output's, shape (lines,)."""
    variance: NDArray[np.float64]
    """Variance of what is left [m²], shape (lines,)."""


def with_rounding(
    response: FrequencyResponse, segments: Sequence[Segment], output: str, resolution: float
) -> FrequencyResponse:
    """Return a response less the rounding of its output that repeats in every period, the rest in its covariance.

    Scatter over the periods does not show it. It is the smaller, the more the periods differ: noise is dither. A record
    of one period is left as it is: its covariance is unknown.
    """
    if not resolution or min(len(segment.channels[output]) for segment in segments) < 2:
        return response
    found = [_repeated_rounding(segment, output, resolution) for segment in segments]
    error, variance = (np.concatenate(each) for each in zip(*found, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        known = variance / response.input_amplitude**2
        shown = response.standard_deviation**2
        freedom = np.inf if response.freedom is None else response.freedom
        freedom = np.where(shown > 0, freedom * (1 + known / shown) ** 2, np.inf)  # Welch and Satterthwaite
    covariance = response.covariance + known[:, None, None] * (np.eye(2) / 2)
    return replace(response, response=response.response * (1 - error), covariance=covariance, freedom=freedom)


def _repeated_rounding(segment: Segment, output: str, resolution: float) -> RepeatedRounding:
    """Return the rounding error along the motion that the mean of the periods shows.

    Only samples at different places of the motion count. The motion is known as well as its terms; what it lacks blurs
    the rounding error like noise does. A sine about a whole or half quantisation step is rounded alike on both sides:
    all of the error is then in its odd harmonics.
    """
    step = int(np.gcd.reduce(segment.lines))
    repeats = int(np.gcd(step, segment.samples))
    periods = segment.channels[output].reshape(-1, segment.samples // repeats)
    count, samples = periods.shape
    mean = np.add.reduce(periods, axis=0) / count
    variance = float(np.add.reduce((periods - mean) ** 2, axis=None)) / (samples * (count - 1))
    noise = noise_from_scatter(variance, resolution)
    repeated = repeated_rounding_variance(resolution, noise)
    scatter = (variance / count + repeated) / samples
    terms = motion_terms(mean, step // repeats)
    share = motion_shares(terms, scatter)
    blur = np.hypot(noise, np.sqrt(2 * scatter * np.add.reduce(share)))
    position = motion_samples(share * terms, samples, step // repeats)
    error = motion_terms(mean_rounding_error(position, resolution, blur), step // repeats)[segment.lines // step]
    is_symmetric = segment.lines.size == 1 and samples % 2 == 0
    alike = 2 * np.cos(2 * np.pi * terms[0].real / resolution) ** 2 if is_symmetric else 1.0
    left = 4 * (repeated - repeated_rounding_variance(resolution, blur)) / samples * max(alike, 1.0)
    measured = np.add.reduce(phasors(segment, output), axis=0) / len(segment.channels[output])
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        return RepeatedRounding(2 * error / measured, np.full(segment.lines.size, left))
