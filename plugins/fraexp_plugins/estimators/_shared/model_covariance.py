"""The covariance of 1/P̂ that an uncertain model causes: the error law 1/P̂ - 1/P is linear in the model's force."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, Result, circle_factor, degrees_of_freedom


def inverse_response(result: Result) -> NDArray[np.complex128]:
    """Return 1/P̂, complex, shape (n,)."""
    response = result.response.response if result.response else np.empty(0)
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        return np.asarray(1 / response)


def outer_parts(change: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the products of (real, imaginary) part of each change, shape (n, 2, 2)."""
    parts = np.stack([change.real, change.imag], axis=1)
    return np.asarray(parts[:, :, None] * parts[:, None, :])


def with_model_covariance(response: FrequencyResponse, covariance: NDArray[np.float64]) -> FrequencyResponse:
    """Return the response with the covariance by the model: all of it where that by noise is unknown."""
    freedom = response.freedom
    if freedom is not None:
        freedom = np.where(np.isfinite(response.covariance).all(axis=(1, 2)), freedom, np.inf)
    return replace(response, freedom=freedom, model_covariance=covariance)


def relative_radius(response: FrequencyResponse) -> NDArray[np.float64]:
    """Return the radius of the 95 % circle relative to the response, shape (n,); NaN where it is unknown."""
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        return np.asarray(
            circle_factor(degrees_of_freedom(response)) * response.standard_deviation / np.abs(response.response)
        )
