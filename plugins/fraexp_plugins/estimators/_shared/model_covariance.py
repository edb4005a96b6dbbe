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


def with_inverse(
    response: FrequencyResponse, change: NDArray[np.complex128], covariance: NDArray[np.float64]
) -> FrequencyResponse:
    """Return the response whose inverse is changed, shape (n,), and has this covariance by the model, shape (n, 2, 2).

    The band by noise keeps its size in 1/response. Where it is unknown, all of the covariance is that by the model.
    """
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        ratio = 1 / (1 + change * response.response)
    freedom = response.freedom
    if freedom is not None:
        freedom = np.where(np.isfinite(response.covariance).all(axis=(1, 2)), freedom, np.inf)
    turn = np.moveaxis(np.array([[ratio.real, -ratio.imag], [ratio.imag, ratio.real]]), -1, 0)
    turn = turn @ turn  # 1/response changes by δ where response changes by -δ response²
    return replace(
        response,
        response=response.response * ratio,
        covariance=turn @ response.covariance @ np.swapaxes(turn, 1, 2),
        input_amplitude=response.input_amplitude / np.abs(ratio),
        freedom=freedom,
        model_covariance=covariance,
    )


def relative_radius(response: FrequencyResponse) -> NDArray[np.float64]:
    """Return the radius of the 95 % circle relative to the response, shape (n,); NaN where it is unknown."""
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        return np.asarray(
            circle_factor(degrees_of_freedom(response)) * response.standard_deviation / np.abs(response.response)
        )
