"""Where the true response lies with a probability of 95 %: from covariance and degrees of freedom."""

import numpy as np

from fraexp.data.results import FrequencyResponse

LEVEL = 0.95
CORNERS = 180
"""Points of an ellipse that are looked at."""


def interval_factor(freedom: np.ndarray | float) -> np.ndarray:
    """Return how many standard deviations of one part hold 95 % on both sides: Student's t, 1.96 for known ones."""
    from scipy.special import stdtrit  # slow to import: most screens and commands need none of it

    freedom = np.asarray(freedom, dtype=float)
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(freedom), 1.959964, stdtrit(np.where(np.isinf(freedom), 1e9, freedom), 0.975))


def circle_factor(freedom: np.ndarray | float) -> np.ndarray:
    """Return √F₀.₉₅(2, ν): a circle of this many standard deviations E|Ĝ - G|² holds 95 %; 1.731 for a known one.

    R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, eq. (2-40).
    """
    freedom = np.asarray(freedom, dtype=float)
    finite = np.where(np.isinf(freedom), 1.0, freedom)
    with np.errstate(divide="ignore", invalid="ignore"):
        quantile = finite / 2 * ((1 - LEVEL) ** (-2 / finite) - 1)
    return np.sqrt(np.where(np.isinf(freedom), -np.log(1 - LEVEL), quantile))


def freedom_of(response: FrequencyResponse) -> np.ndarray:
    """Return the degrees of freedom of its covariance, shape (n,); infinite where they are not told."""
    return np.full(response.frequency.size, np.inf) if response.freedom is None else response.freedom


def relative_deviations(response: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard deviations along and across a complex response, relative to it, each of shape (n,).

    To first order these are the deviations of ln|G| [1] and of the phase [rad]; `covariance` has shape (n, 2, 2).
    """
    size = np.abs(response)
    size = np.where(size > 0, size, np.nan)
    real, imaginary = response.real / size, response.imag / size
    rr, ri, ii = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    along = real**2 * rr + 2 * real * imaginary * ri + imaginary**2 * ii
    across = imaginary**2 * rr - 2 * real * imaginary * ri + real**2 * ii
    return np.sqrt(np.maximum(along, 0)) / size, np.sqrt(np.maximum(across, 0)) / size


def limits(response: FrequencyResponse) -> tuple[np.ndarray, np.ndarray]:
    """Return the 95 % limits of magnitude, relative to it, and of phase [rad], less it; each of shape (2, n).

    NaN where nothing is known. Where the friction model is uncertain they are those of an ellipse around 1/Ĝ, of
    which the friction model's error is a part: 1/P̂ - 1/P = N - N̂. A response may then be infinite for all that is
    known.
    """
    if response.model_covariance is not None:
        return _inverse_limits(response)
    along, across = relative_deviations(response.response, response.covariance)
    factor = interval_factor(freedom_of(response))
    return np.stack([1 - factor * along, 1 + factor * along]), np.stack([-factor * across, factor * across])


def inverse_covariance(response: FrequencyResponse) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance of (real, imaginary) part of 1/Ĝ [1/unit²] by noise and friction model, (n, 2, 2).

    And its degrees of freedom, shape (n,), by Welch and Satterthwaite: the friction model's part is stated, not
    estimated. Unknown noise counts as none where the friction model's part is known.
    """
    model = np.zeros_like(response.covariance) if response.model_covariance is None else response.model_covariance
    slope = -1 / response.response**2
    turn = np.moveaxis(np.array([[slope.real, -slope.imag], [slope.imag, slope.real]]), -1, 0)
    noise = turn @ response.covariance @ np.swapaxes(turn, 1, 2)
    noise = np.where(np.isfinite(noise), noise, 0.0)
    parts = [np.trace(part, axis1=1, axis2=2) for part in (model, noise)]
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = np.where(parts[1] > 0, freedom_of(response) * (1 + parts[0] / parts[1]) ** 2, np.inf)
    return model + noise, freedom


def _inverse_limits(response: FrequencyResponse) -> tuple[np.ndarray, np.ndarray]:
    inverse, (covariance, freedom) = 1 / response.response, inverse_covariance(response)
    values, vectors = np.linalg.eigh(np.where(np.isfinite(covariance), covariance, 0.0))
    angle = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    factor = np.sqrt(2) * circle_factor(freedom)
    axes = vectors * np.sqrt(np.maximum(values, 0))[:, None, :]
    edge = factor[:, None, None] * (axes @ circle)
    ratio = (inverse[:, None] + edge[:, 0] + 1j * edge[:, 1]) / inverse[:, None]  # of 1/G to 1/Ĝ: on the limit
    size, phase = np.abs(ratio), np.unwrap(np.angle(ratio), axis=1)
    around = np.abs(phase[:, -1] - phase[:, 0]) > np.pi  # the ellipse holds the origin: G may be anything large
    with np.errstate(divide="ignore"):
        magnitude = np.stack([1 / size.max(axis=1), np.where(around, np.inf, 1 / size.min(axis=1))])
    phases = np.stack([-phase.max(axis=1), -phase.min(axis=1)])
    phases[:, around] = np.array([[-np.pi], [np.pi]])
    unknown = ~np.isfinite(covariance).all(axis=(1, 2))
    magnitude[:, unknown], phases[:, unknown] = np.nan, np.nan
    return magnitude, phases
