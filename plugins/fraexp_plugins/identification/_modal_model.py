"""The logarithm of a measured response, and that of eq (1) with a dead time, with its derivatives."""

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ROUNDING, FrequencyResponse, RecordError
from fraexp_plugins.plants.modal import Modal


def parameter_symbol(name: str) -> str:
    """Return the literature's letter for a parameter, such as f1 for frequencies.0."""
    head, _, number = name.partition(".")
    letters = {"rigid_body_gain": "k0", "frequencies": "f", "damping_ratios": "ζ", "modal_gain_ratios": "r"}
    letters |= {"viscous_coefficient": "D", "ground_stiffness": "K", "dead_time": "L", "time_constant": "T"}
    return letters[head] + (str(int(number) + 1) if number else "") if head in letters else name


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
    common: NDArray[np.complex128]
    """Errors of ln Ĝ at all frequencies together, one standard deviation in each of k directions, shape (n, k)."""

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
        return float(self.count) if self.covariance is None else float(np.sum(self.weight[:, None] * self.variances))

    @property
    def variances(self) -> NDArray[np.float64]:
        """Variances of (log magnitude, phase [rad]) by all known errors, shape (n, parts)."""
        own = np.zeros((self.frequency.size, 2, 2)) if self.covariance is None else self.covariance
        common = np.stack([np.sum(part**2, axis=1) for part in (self.common.real, self.common.imag)], axis=1)
        return np.asarray((np.diagonal(own, axis1=1, axis2=2) + common)[:, : self.parts])

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
        common = self.common[chosen]
        return replace(
            self, frequency=frequency, response=response, weight=weight, covariance=covariance, common=common
        )


def log_response(
    response: FrequencyResponse,
    band: tuple[float, float],
    weighting: Weighting,
    model_error: float,
    parts: int,
    common: NDArray[np.complex128] | None = None,
) -> LogResponse:
    """Return the settled points of a response within a frequency range [Hz].

    `model_error` is the relative error of the model, in each of the parts, that is allowed for besides noise; `common`
    are relative errors of the response that all frequencies share, shape (n, k).
    """
    inside = (response.frequency >= band[0]) & (response.frequency <= band[1]) & (response.frequency > 0)
    usable = response.settled & np.isfinite(response.response) & (np.abs(response.response) > 0)
    chosen = np.flatnonzero(inside & usable)
    chosen = chosen[np.argsort(response.frequency[chosen], kind="stable")]
    frequency, values = response.frequency[chosen], response.response[chosen]
    shared = np.zeros((chosen.size, 0), dtype=complex) if common is None else common[chosen]
    noise = _log_covariance(values, response.covariance[chosen])
    known = bool(np.isfinite(noise).all() and noise.any())  # of an ideal encoder the errors are the model's alone
    if weighting == "noise" and not known:
        raise RecordError(
            "modal_fit: weighting 'noise' needs the response's covariance, unknown at some frequencies; record "
            "two periods or more, or choose the weighting 'relative'"
        )
    if weighting == "relative" or not known:
        return LogResponse(frequency, values, np.full(chosen.size, model_error**-2), None, parts, shared)
    freedom = np.full(chosen.size, np.inf) if response.freedom is None else response.freedom[chosen]
    variance = _smoothed_variance((noise[:, 0, 0] + noise[:, 1, 1]) / 2, freedom) + model_error**2
    variance += np.sum(np.abs(shared) ** 2, axis=1) / 2
    return LogResponse(frequency, values, 1 / variance, noise + model_error**2 * np.eye(2), parts, shared)


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


MAX_DAMPING_RATIO = 2.0
"""Limit of the damping ratios: a mode beyond has no peak, and half of it is near those that have."""
FREQUENCY_MARGIN = 3.0
"""Factor by which a natural frequency may lie outside of the frequency range; a search there begins at its root."""
GROUND = {"viscous_coefficient": 1, "ground_stiffness": 0}
"""Forces between the mass and ground, by the power of s with which each acts on the position."""


@dataclass(frozen=True)
class ModalModel:
    """G(s) = e^{-Ls}/(1 + T s)/(1/P(s) + D s + K), P(s) = k0 S(s), S(s) = 1/s² + Σ r_i / (s² + 2 ζ_i ω_i s + ω_i²).

    It is a function of p = (ln k0; ln f_i, ln ζ_i, r_i for each mode; k0 D/ω_l and k0 K/ω_l² if they are free; ω_h L
    and ω_h T if they are free), with the limits ω_l and ω_h [rad/s] of the frequency range: all of p is of the order
    of 1.
    """

    modes: int
    min_frequency: float
    """Lower limit of the frequency range [Hz]."""
    max_frequency: float
    """Upper limit of the frequency range [Hz]."""
    ground: tuple[str, ...] = ()
    """Those of `GROUND` that are free; the others are 0."""
    dead_time: float | None = None
    """L if it is fixed [s]; None if it is free."""
    time_constant: float | None = 0.0
    """T if it is fixed [s]; None if it is free."""

    @property
    def size(self) -> int:
        """Length of p."""
        return self.path_place + len(self.path)

    @property
    def path(self) -> tuple[str, ...]:
        """Names of L and T, as many as are free."""
        return tuple(name for name in ("dead_time", "time_constant") if getattr(self, name) is None)

    @property
    def path_place(self) -> int:
        """Place in p behind the ground."""
        return self.ground_place + len(self.ground)

    @property
    def ground_place(self) -> int:
        """Place in p behind the modes."""
        return 1 + 3 * self.modes

    @property
    def ground_units(self) -> NDArray[np.float64]:
        """Units of k0 D [rad/s] and k0 K [rad²/s²] in p, as many as are free."""
        powers = np.array([GROUND[name] for name in self.ground], dtype=float)
        return np.asarray((2 * np.pi * self.min_frequency) ** (2 - powers))

    @property
    def time_unit(self) -> float:
        """The reciprocal of the upper limit, 1/ω_h [s]."""
        return 1 / (2 * np.pi * self.max_frequency)

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the bounds of p, each of shape (size,)."""
        low, high = np.full((2, self.size), np.inf) * np.array([[-1], [1]])
        modes = slice(1, self.ground_place, 3), slice(2, self.ground_place, 3)
        low[modes[0]], low[modes[1]] = np.log(self.min_frequency / FREQUENCY_MARGIN), np.log(ROUNDING)
        high[modes[0]], high[modes[1]] = np.log(self.max_frequency * FREQUENCY_MARGIN), np.log(MAX_DAMPING_RATIO)
        return low, high

    def _parts(
        self, p: NDArray[np.float64], s: NDArray[np.complex128]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]:
        """Return 1/(s² + 2 ζ_i ω_i s + ω_i²), shape (modes, n), S and k0 e^{-Ls}/G, each of shape (n,)."""
        frequency, zeta = self.poles(p).T
        modes = resonators(s, 2 * np.pi * frequency, zeta)
        total = 1 / s**2 + p[3 : self.ground_place : 3] @ modes
        return modes, total, 1 / total + self.ground_columns(s) @ self.ground_forces(p) * np.exp(p[0])

    def ground_columns(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the derivative of 1/G, without its dead time, by the free ground forces, shape (n, ground)."""
        return s[:, None] ** np.array([GROUND[name] for name in self.ground], dtype=int)

    def log_response(self, p: NDArray[np.float64], s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return ln G(s), shape (n,); its imaginary part is the phase [rad] up to whole turns."""
        return p[0] - np.log(self._parts(p, s)[2]) - s * self.delay(p) - np.log1p(s * self.lag(p))

    def jacobian(self, p: NDArray[np.float64], s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the derivative of ln G(s) by p, complex, shape (n, size)."""
        modes, total, inverse = self._parts(p, s)
        found = np.empty((s.size, self.size), dtype=complex)
        found[:, 0] = 1
        slope = 1 / (total**2 * inverse)
        for i, (mode, residue) in enumerate(zip(modes, p[3 : self.ground_place : 3], strict=True)):
            omega, zeta = 2 * np.pi * np.exp(p[1 + 3 * i]), np.exp(p[2 + 3 * i])
            of_pole = -slope * residue * mode**2
            found[:, 1 + 3 * i] = of_pole * (2 * zeta * omega * s + 2 * omega**2)
            found[:, 2 + 3 * i] = of_pole * (2 * zeta * omega * s)
            found[:, 3 + 3 * i] = slope * mode
        found[:, self.ground_place : self.path_place] = -self.ground_columns(s) * self.ground_units / inverse[:, None]
        slopes = {"dead_time": -s, "time_constant": -s / (1 + s * self.lag(p))}
        for place, name in enumerate(self.path, self.path_place):
            found[:, place] = self.time_unit * slopes[name]
        return found

    def poles(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return f_i [Hz] and ζ_i of the modes of P, shape (modes, 2)."""
        return np.exp(p[1 : self.ground_place].reshape(-1, 3)[:, :2])

    def ground_forces(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return D [N s/m] and K [N/m], as many as are free."""
        return np.asarray(p[self.ground_place :][: len(self.ground)] * self.ground_units * np.exp(-p[0]))

    def delay(self, p: NDArray[np.float64]) -> float:
        """Return the dead time L [s]."""
        return float(p[self.path_place] * self.time_unit) if self.dead_time is None else self.dead_time

    def lag(self, p: NDArray[np.float64]) -> float:
        """Return the time constant T [s]."""
        return float(p[-1] * self.time_unit) if self.time_constant is None else self.time_constant

    def sort_modes(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return p with the modes in ascending order of frequency."""
        modes = p[1 : self.ground_place].reshape(-1, 3)
        return np.concatenate([p[:1], modes[np.argsort(modes[:, 0])].ravel(), p[self.ground_place :]])

    def names(self) -> tuple[str, ...]:
        """Return the names of the parameters in p; all except those of `path` are those of `Modal`."""
        modes = [
            f"{name}.{i}" for i in range(self.modes) for name in ("frequencies", "damping_ratios", "modal_gain_ratios")
        ]
        return ("rigid_body_gain", *modes, *self.ground, *self.path)

    def values(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return their values in SI units, shape (size,)."""
        values = p.copy()
        values[0] = np.exp(p[0])
        for first in (1, 2):
            values[first : self.ground_place : 3] = np.exp(p[first : self.ground_place : 3])
        values[self.ground_place : self.path_place] = self.ground_forces(p)
        values[self.path_place :] *= self.time_unit
        return values

    def slopes(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivative of the values by p, shape (size, size)."""
        values, scale = self.values(p), np.ones(self.size)
        for first in (1, 2):
            scale[first : self.ground_place : 3] = values[first : self.ground_place : 3]
        scale[0] = values[0]
        own = np.arange(self.ground_place, self.path_place)
        scale[own] = self.ground_units / values[0]
        scale[self.path_place :] = self.time_unit
        found = np.diag(scale)
        found[own, 0] = -values[own]
        return found

    def plant(self, p: NDArray[np.float64]) -> Modal:
        """Return the plant, without dead time and lag."""
        values = self.values(p)
        modes = values[1 : self.ground_place].reshape(-1, 3)
        return Modal(
            rigid_body_gain=float(values[0]),
            frequencies=tuple(map(float, modes[:, 0])),
            damping_ratios=tuple(map(float, modes[:, 1])),
            modal_gain_ratios=tuple(map(float, modes[:, 2])),
            **dict(zip(self.ground, self.ground_forces(p).tolist(), strict=True)),
        )


def resonators(
    s: NDArray[np.complex128], omega: NDArray[np.float64], zeta: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return 1/(s² + 2 ζ ω s + ω²), shape (modes, n), at s, shape (n,), for ω [rad/s] and ζ, each of shape (modes,)."""
    return 1 / (s**2 + (2 * zeta * omega)[:, None] * s + (omega**2)[:, None])
