"""The logarithm of a measured response, with weights and covariance: what a model is fitted to."""

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from fraexp.api import FrequencyResponse, RecordError

Weighting = Literal["automatic", "noise", "relative"]
ENOUGH = 30.0
"""Degrees of freedom of a variance from which it makes a good weight."""


@dataclass(frozen=True)
class LogResponse:
    """ln Ĝ at n frequencies: log magnitude and phase, of which the errors are relative ones.

    In the logarithm circular noise of a small response has no mean: unlike |Ĝ|² the fit is not drawn to large values.
    """

    frequency: np.ndarray
    """Frequency [Hz], ascending, shape (n,)."""
    response: np.ndarray
    """Complex response, shape (n,)."""
    weight: np.ndarray
    """Weight of the squared error of each part of ln Ĝ, shape (n,)."""
    covariance: np.ndarray | None
    """Covariance of (log magnitude, phase [rad]), shape (n, 2, 2); None where it is taken from the residuals."""
    parts: int
    """2 for magnitude and phase, 1 for magnitude alone."""

    @property
    def s(self) -> np.ndarray:
        """Return jω [rad/s], shape (n,)."""
        return 2j * np.pi * self.frequency

    @property
    def count(self) -> int:
        """Number of real residuals."""
        return self.parts * self.frequency.size

    @property
    def expected(self) -> float:
        """What the covariance makes of Σ w|e|², before anything is fitted; the number of residuals if it is unknown."""
        if self.covariance is None:
            return float(self.count)
        variances = np.diagonal(self.covariance, axis1=1, axis2=2)[:, : self.parts]
        return float(np.sum(self.weight[:, None] * variances))

    def stacked(self, values: np.ndarray) -> np.ndarray:
        """Return complex values as weighted real ones, shape (count, ...): all log magnitudes, then all phases."""
        weighted = values * np.sqrt(self.weight).reshape(-1, *[1] * (values.ndim - 1))
        return np.concatenate([weighted.real, weighted.imag][: self.parts])

    def error(self, log_model: np.ndarray) -> np.ndarray:
        """Return ln(G_m/Ĝ), shape (n,), with the phase between -π and π."""
        error = log_model - np.log(self.response)
        return error.real + 1j * (np.mod(error.imag + np.pi, 2 * np.pi) - np.pi)

    def scatter(self, jacobian: np.ndarray) -> np.ndarray:
        """Return Σ w_k² J_kᵀ C_k J_k of stated covariances C_k, shape (p, p), with the unweighted J, shape (n, p)."""
        assert self.covariance is not None
        parts = np.stack([jacobian.real, jacobian.imag], axis=1)[:, : self.parts]
        covariance = self.covariance[:, : self.parts, : self.parts] * (self.weight**2)[:, None, None]
        return np.einsum("kip,kij,kjq->pq", parts, covariance, parts)

    def thinned(self, bins: int) -> Self:
        """Return the points of greatest and least |ω² Ĝ| of each of some bins of ln f, all if they are few.

        Peaks and dips stay, so that what is left will do for a search.
        """
        if self.frequency.size <= 2 * bins:
            return self
        share = np.log(self.frequency / self.frequency[0]) / np.log(self.frequency[-1] / self.frequency[0])
        of = np.minimum((share * bins).astype(int), bins - 1)
        size = np.abs(self.response) * self.frequency**2
        order = np.lexsort((size, of))
        ends = np.flatnonzero(np.diff(of)) + 1
        return self.at(np.unique(order[[0, *ends, *(ends - 1), -1]]))

    def at(self, chosen: np.ndarray) -> Self:
        """Return the points of these indices."""
        covariance = None if self.covariance is None else self.covariance[chosen]
        taken = {"frequency": self.frequency, "response": self.response, "weight": self.weight}
        return replace(self, covariance=covariance, **{name: values[chosen] for name, values in taken.items()})


def log_response(
    response: FrequencyResponse, band: tuple[float, float], weighting: Weighting, floor: float, parts: int
) -> LogResponse:
    """Return what is to be fitted of a response: settled points within a band [Hz].

    `floor` is a relative error that is allowed for besides noise, in each of the parts.
    """
    inside = (response.frequency >= band[0]) & (response.frequency <= band[1]) & (response.frequency > 0)
    usable = response.settled & np.isfinite(response.response) & (np.abs(response.response) > 0)
    chosen = np.flatnonzero(inside & usable)
    chosen = chosen[np.argsort(response.frequency[chosen], kind="stable")]
    frequency, values = response.frequency[chosen], response.response[chosen]
    noise = _log_covariance(values, response.covariance[chosen])
    known = bool(np.isfinite(noise).all()) and chosen.size > 0
    if weighting == "noise" and not known:
        raise RecordError(
            "modal_fit: weights by noise need the response's covariance, which is not known at all frequencies: record "
            "two periods at least, or choose the weighting 'relative'"
        )
    if weighting == "relative" or not known:
        return LogResponse(frequency, values, np.full(chosen.size, floor**-2), None, parts)
    freedom = np.full(chosen.size, np.inf) if response.freedom is None else response.freedom[chosen]
    variance = _smoothed((noise[:, 0, 0] + noise[:, 1, 1]) / 2, freedom) + floor**2
    return LogResponse(frequency, values, 1 / variance, noise + floor**2 * np.eye(2), parts)


def _log_covariance(response: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the covariance of (log magnitude, phase) to first order, shape (n, 2, 2)."""
    turn = np.array([[response.real, response.imag], [-response.imag, response.real]]) / np.abs(response) ** 2
    turn = np.moveaxis(turn, -1, 0)
    return turn @ covariance @ np.swapaxes(turn, 1, 2)


def _smoothed(variance: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """Return variances from which weights are made, shape (n,).

    A weight of a variance of few degrees of freedom is wild, and with its own variance the smaller the more it counts:
    the covariance of the fit would come out too small. It is therefore the mean of its neighbours', without its own.
    """
    if not np.isfinite(freedom).all():
        return variance
    each = float(np.min(freedom))
    reach = min(int(np.ceil(ENOUGH / (2 * each))), (variance.size - 1) // 2)
    if reach < 1:
        return variance
    padded = np.pad(variance, reach, mode="reflect")
    window = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    return (window.sum(axis=1) - variance) / (2 * reach)
