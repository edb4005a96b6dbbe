"""Confidence limits of 95 % of a response, from its covariance and its degrees of freedom; and how far they reach."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import FrequencyResponse

CONFIDENCE_LEVEL = 0.95
NORMAL_QUANTILE = 1.959963984540054
"""The quantile of the normal distribution that leaves as much beyond it as the confidence level leaves on one side."""
USUAL_MAGNITUDE, USUAL_PHASE = 0.5, math.radians(3)
"""Error of magnitude [dB] and phase [rad] within which a response has to lie if its study asks for nothing else."""
ELLIPSE_POINTS = 180
"""Points of an ellipse at which its extremes are looked for."""


class ConfidenceLimits(NamedTuple):
    """Lower and upper limits of a response."""

    magnitude: NDArray[np.float64]
    """Relative to the response's magnitude, shape (2, n)."""
    phase: NDArray[np.float64]
    """Less the response's phase [rad], shape (2, n)."""


class RelativeDeviations(NamedTuple):
    """Standard deviations of a complex response relative to its magnitude."""

    along: NDArray[np.float64]
    """Along the response: to first order that of ln|G| [1], shape (n,)."""
    across: NDArray[np.float64]
    """Across the response: to first order that of its phase [rad], shape (n,)."""


class InverseCovariance(NamedTuple):
    """Uncertainty of 1/Ĝ."""

    covariance: NDArray[np.float64]
    """Covariance of (real, imaginary) part [1/unit²], shape (n, 2, 2)."""
    freedom: NDArray[np.float64]
    """Its degrees of freedom, shape (n,)."""


def interval_factor(freedom: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return by how many standard deviations an interval of 95 % reaches to either side: Student's t.

    A standard deviation that is known has infinitely many degrees of freedom, and a factor of 1.96. Fewer than one give
    NaN.
    """
    if np.isposinf(freedom).all():
        return np.full(np.shape(freedom), NORMAL_QUANTILE)
    from scipy.special import stdtrit  # a tenth of a second, and only limits from few periods need it

    return np.asarray(stdtrit(np.where(np.asarray(freedom) >= 1, freedom, np.nan), (1 + CONFIDENCE_LEVEL) / 2))


def circle_factor(freedom: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return √F₀.₉₅(2, ν): a circle of this many standard deviations √E|Ĝ - G|² covers 95 %; 1.731 for a known one.

    R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, eq. (2-40).
    """
    freedom = np.asarray(freedom, dtype=float)
    finite = np.where(np.isinf(freedom), 1.0, freedom)
    with np.errstate(divide="ignore", invalid="ignore"):
        quantile = finite / 2 * np.expm1(-2 / finite * np.log(1 - CONFIDENCE_LEVEL))  # exact for any number
    return np.sqrt(np.where(np.isinf(freedom), -np.log(1 - CONFIDENCE_LEVEL), quantile))


def degrees_of_freedom(response: FrequencyResponse) -> NDArray[np.float64]:
    """Return the degrees of freedom of a response's covariance, shape (n,); infinite if the covariance is known."""
    return np.full(response.frequency.size, np.inf) if response.freedom is None else response.freedom


def relative_deviations(response: NDArray[np.complex128], covariance: NDArray[np.float64]) -> RelativeDeviations:
    """Return the standard deviations along and across a complex response, shape (n,), relative to its magnitude.

    `covariance` is that of (real, imaginary) part, shape (n, 2, 2).
    """
    size = np.abs(response)
    size = np.where(size > 0, size, np.nan)
    real, imaginary = response.real / size, response.imag / size
    rr, ri, ii = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    along = real**2 * rr + 2 * real * imaginary * ri + imaginary**2 * ii
    across = imaginary**2 * rr - 2 * real * imaginary * ri + real**2 * ii
    return RelativeDeviations(np.sqrt(np.maximum(along, 0)) / size, np.sqrt(np.maximum(across, 0)) / size)


def confidence_limits(response: FrequencyResponse) -> ConfidenceLimits:
    """Return the 95 % limits of magnitude and phase; NaN where nothing is known.

    Where the friction model is uncertain they are those of 1/Ĝ, because its error adds to that: 1/P̂ - 1/P = N - N̂. If
    1/G may be zero, the magnitude has no upper limit. A numerical error is no scatter: the limits move outwards by all
    of it.
    """
    magnitude, phase = _inverse_limits(response) if response.model_covariance is not None else _noise_limits(response)
    if response.numerical_error is None:
        return ConfidenceLimits(magnitude, phase)
    outwards = np.array([[-1.0], [1.0]]) * np.nan_to_num(response.numerical_error, posinf=np.inf)
    return ConfidenceLimits(magnitude + outwards, phase + outwards)


def _noise_limits(response: FrequencyResponse) -> ConfidenceLimits:
    along, across = relative_deviations(response.response, response.covariance)
    factor = interval_factor(degrees_of_freedom(response))
    return ConfidenceLimits(
        magnitude=np.stack([1 - factor * along, 1 + factor * along]),
        phase=np.stack([-factor * across, factor * across]),
    )


def _inverse(response: FrequencyResponse) -> NDArray[np.complex128]:
    """Return 1/Ĝ, shape (n,); NaN where nothing moves."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(1 / np.where(response.response == 0, np.nan, response.response))


def inverse_covariance(response: FrequencyResponse) -> InverseCovariance:
    """Return the covariance of 1/Ĝ by noise and friction model, with its degrees of freedom.

    These follow from Welch and Satterthwaite: the friction model's part is stated, not estimated. Unknown noise counts
    as none where the friction model's part is known.
    """
    model = np.zeros_like(response.covariance) if response.model_covariance is None else response.model_covariance
    slope = -(_inverse(response) ** 2)  # of 1/G, which as a matrix acts on (real, imaginary) parts
    jacobian = np.moveaxis(np.array([[slope.real, -slope.imag], [slope.imag, slope.real]]), -1, 0)
    noise = jacobian @ response.covariance @ np.swapaxes(jacobian, 1, 2)
    noise = np.where(np.isfinite(noise), noise, 0.0)
    model_variance, noise_variance = (np.trace(part, axis1=1, axis2=2) for part in (model, noise))
    with np.errstate(divide="ignore", invalid="ignore"):
        combined = degrees_of_freedom(response) * (1 + model_variance / noise_variance) ** 2
    return InverseCovariance(model + noise, np.where(noise_variance > 0, combined, np.inf))


def _inverse_limits(response: FrequencyResponse) -> ConfidenceLimits:
    """Return the limits of Ĝ from an ellipse of 1/Ĝ.

    The extremes of an ellipse of 1.96 standard deviations are those of an interval of 95 %, of the magnitude as of the
    phase. Where the ellipse that covers 95 % of the plane contains the origin, its extremes are the limits.
    """
    inverse, (covariance, freedom) = _inverse(response), inverse_covariance(response)
    values, vectors = np.linalg.eigh(np.where(np.isfinite(covariance), covariance, 0.0))
    axes = vectors * np.sqrt(np.maximum(values, 0))[:, None, :]
    plane = np.sqrt(2) * circle_factor(freedom)
    with np.errstate(divide="ignore", invalid="ignore"):  # an ellipse may be a line, or a point
        along = np.einsum("nij,ni->nj", vectors, np.stack([inverse.real, inverse.imag], axis=1))
        distance = np.sqrt(np.nansum(along**2 / np.maximum(values, 0), axis=1))
    has_origin = distance < plane  # G may be arbitrarily large
    angle = np.linspace(0, 2 * np.pi, ELLIPSE_POINTS, endpoint=False)
    edge = np.where(has_origin, plane, interval_factor(freedom))[:, None, None] * (
        axes @ np.stack([np.cos(angle), np.sin(angle)])
    )
    with np.errstate(invalid="ignore"):  # where nothing moves
        ratio = (inverse[:, None] + edge[:, 0] + 1j * edge[:, 1]) / inverse[:, None]  # of 1/G to 1/Ĝ: on the limit
    size, phase = np.abs(ratio), np.unwrap(np.angle(ratio), axis=1)
    with np.errstate(divide="ignore"):
        magnitude = np.stack([1 / size.max(axis=1), np.where(has_origin, np.inf, 1 / size.min(axis=1))])
    phases = np.stack([-phase.max(axis=1), -phase.min(axis=1)])
    phases[:, has_origin] = np.array([[-np.pi], [np.pi]])
    unknown = ~np.isfinite(covariance).all(axis=(1, 2))
    magnitude[:, unknown], phases[:, unknown] = np.nan, np.nan
    return ConfidenceLimits(magnitude, phases)


class BandReach(NamedTuple):
    """How far the band of a response reaches, shape (n,); infinite where it has no end or is not known."""

    magnitude: NDArray[np.float64]
    """Greatest distance of the magnitude [dB]."""
    phase: NDArray[np.float64]
    """Greatest distance of the phase [rad]."""

    @classmethod
    def of(cls, response: FrequencyResponse) -> "BandReach":
        """Return the reach of a response's 95 % limits."""
        with np.errstate(divide="ignore", invalid="ignore"):
            magnitude, phase = confidence_limits(response)
            level = 20 * np.abs(np.log10(np.maximum(magnitude, 0.0)))
        is_known = np.isfinite(response.covariance).all(axis=(1, 2)) & np.isfinite(level + phase).all(axis=0)
        return cls(*(np.where(is_known, each.max(axis=0), np.inf) for each in (level, np.abs(phase))))

    def over(self, magnitude: float, phase: float) -> NDArray[np.float64]:
        """Return the band over a magnitude [dB] and a phase [rad], shape (n,): at most 1 where it lies within both."""
        return np.asarray(np.maximum(self.magnitude / magnitude, self.phase / phase))

    def is_within(self, magnitude: float = USUAL_MAGNITUDE, phase: float = USUAL_PHASE) -> NDArray[np.bool_]:
        """Return where the whole band lies within a magnitude [dB] and a phase [rad], shape (n,)."""
        return self.over(magnitude, phase) <= 1
