"""The logarithm of a measured response, with weights and covariance: the data of a plant fit."""

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, RecordError

Weighting = Literal["automatic", "noise", "relative"]
MIN_WEIGHT_FREEDOM = 30.0
"""Degrees of freedom from which a variance makes a good weight."""


@dataclass(frozen=True)
class LogResponse:
    """ln Ĝ at n frequencies: log magnitude and phase, whose errors are relative errors.

    In the logarithm circular noise of a small response has no mean: unlike |Ĝ|² it does not favour large values.
    """

    frequency: NDArray[np.float64]
    """Frequency [Hz], ascending, shape (n,)."""
    response: NDArray[np.complex128]
    """Complex response, shape (n,)."""
    weight: NDArray[np.float64]
    """Weight of the squared error of each part of ln Ĝ, shape (n,)."""
    covariance: NDArray[np.float64] | None
    """Covariance of (log magnitude, phase [rad]), shape (n, 2, 2); None if it is to be taken from the residuals."""
    parts: int
    """2 for magnitude and phase, 1 for the magnitude only."""

    @property
    def s(self) -> NDArray[np.complex128]:
        """Return jω [rad/s], shape (n,)."""
        return np.complex128(2j * np.pi) * self.frequency

    @property
    def count(self) -> int:
        """Number of real residuals."""
        return self.parts * self.frequency.size

    @property
    def expected(self) -> float:
        """Expectation of Σ w|e|² by the covariance, before a fit; the number of residuals if it is unknown."""
        if self.covariance is None:
            return float(self.count)
        variances = np.diagonal(self.covariance, axis1=1, axis2=2)[:, : self.parts]
        return float(np.sum(self.weight[:, None] * variances))

    def weighted_parts(self, values: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return complex values as weighted real ones, shape (count, ...): all log magnitudes, then all phases."""
        weighted = values * np.sqrt(self.weight).reshape(-1, *[1] * (values.ndim - 1))
        return np.concatenate([weighted.real, weighted.imag][: self.parts])

    def error(self, log_model: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return ln(G_m/Ĝ), shape (n,), with the phase between -π and π."""
        error = log_model - np.log(self.response)
        return error.real + 1j * (np.mod(error.imag + np.pi, 2 * np.pi) - np.pi)

    def scatter(self, jacobian: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return Σ w_k² J_kᵀ C_k J_k of known covariances C_k, shape (p, p), with the unweighted J, shape (n, p)."""
        assert self.covariance is not None
        parts = np.stack([jacobian.real, jacobian.imag], axis=1)[:, : self.parts]
        covariance = self.covariance[:, : self.parts, : self.parts] * (self.weight**2)[:, None, None]
        return np.einsum("kip,kij,kjq->pq", parts, covariance, parts)

    def search_points(self, bins: int) -> Self:
        """Return the points of largest and smallest |ω² Ĝ| in each of some bins of ln f; all if they are few.

        Peaks and dips stay, so that the remaining points suffice for a search.
        """
        if self.frequency.size <= 2 * bins:
            return self
        position = np.log(self.frequency / self.frequency[0]) / np.log(self.frequency[-1] / self.frequency[0])
        bin_of = np.minimum((position * bins).astype(int), bins - 1)
        size = np.abs(self.response) * self.frequency**2
        order = np.lexsort((size, bin_of))
        ends = np.flatnonzero(np.diff(bin_of)) + 1
        return self.subset(np.unique(order[[0, *ends, *(ends - 1), -1]]))

    def subset(self, chosen: NDArray[np.int64]) -> Self:
        """Return the points of these indices."""
        covariance = None if self.covariance is None else self.covariance[chosen]
        frequency, response, weight = self.frequency[chosen], self.response[chosen], self.weight[chosen]
        return replace(self, frequency=frequency, response=response, weight=weight, covariance=covariance)


def log_response(
    response: FrequencyResponse, band: tuple[float, float], weighting: Weighting, model_error: float, parts: int
) -> LogResponse:
    """Return the settled points of a response within a frequency range [Hz].

    `model_error` is the relative error of the model, in each of the parts, that is allowed for besides noise.
    """
    inside = (response.frequency >= band[0]) & (response.frequency <= band[1]) & (response.frequency > 0)
    usable = response.settled & np.isfinite(response.response) & (np.abs(response.response) > 0)
    chosen = np.flatnonzero(inside & usable)
    chosen = chosen[np.argsort(response.frequency[chosen], kind="stable")]
    frequency, values = response.frequency[chosen], response.response[chosen]
    noise = _log_covariance(values, response.covariance[chosen])
    known = bool(np.isfinite(noise).all() and noise.any())  # of an ideal encoder the errors are the model's alone
    if weighting == "noise" and not known:
        raise RecordError(
            "modal_fit: weighting 'noise' needs the response's covariance, unknown at some frequencies; record "
            "two periods or more, or choose the weighting 'relative'"
        )
    if weighting == "relative" or not known:
        return LogResponse(frequency, values, np.full(chosen.size, model_error**-2), None, parts)
    freedom = np.full(chosen.size, np.inf) if response.freedom is None else response.freedom[chosen]
    variance = _smoothed_variance((noise[:, 0, 0] + noise[:, 1, 1]) / 2, freedom) + model_error**2
    return LogResponse(frequency, values, 1 / variance, noise + model_error**2 * np.eye(2), parts)


def _log_covariance(response: NDArray[np.complex128], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the covariance of (log magnitude, phase) to first order, shape (n, 2, 2)."""
    turn = np.array([[response.real, response.imag], [-response.imag, response.real]]) / np.abs(response) ** 2
    turn = np.moveaxis(turn, -1, 0)
    return turn @ covariance @ np.swapaxes(turn, 1, 2)


def _smoothed_variance(variance: NDArray[np.float64], freedom: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return variances for weights, shape (n,).

    A variance with few degrees of freedom is uncertain, and a point would weigh more the smaller its own variance comes
    out by chance: the covariance of the fit would be too small. So it is the mean of its neighbours', without its own.
    """
    if not np.isfinite(freedom).all():
        return variance
    least = float(np.min(freedom))
    reach = min(int(np.ceil(MIN_WEIGHT_FREEDOM / (2 * least))), (variance.size - 1) // 2)
    if reach < 1:
        return variance
    padded = np.pad(variance, reach, mode="reflect")
    window = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    return (window.sum(axis=1) - variance) / (2 * reach)
