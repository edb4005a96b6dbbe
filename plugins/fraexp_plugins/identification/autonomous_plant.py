"""The plant in the inverse response that friction elements leave: eq (1), viscous friction and a spring.

Amplitude invariance does not tell a force that is linear in the motion from the plant. That a rigid body is neither
damped nor held by a spring does.
"""

from dataclasses import dataclass, replace

import numpy as np

from fraexp.api import Fit, FrequencyResponse, RecordError, Result
from fraexp_plugins.identification.log_response import log_response
from fraexp_plugins.identification.modal_fit import ModalFit
from fraexp_plugins.identification.modal_model import ModalModel
from fraexp_plugins.identification.modal_order import of_order
from fraexp_plugins.identification.modal_solver import Solution

ITERATIONS, CONVERGED = 6, 0.01
"""Steps of the linear forces, and how many standard deviations a step may be at the end."""
FEW, DECADE = 8, 10.0
"""Lowest lines of which a first guess of the viscous coefficient is made, and how far up they go."""
VAGUE = 0.2
"""Relative standard deviation of P̂ beyond which its logarithm has no normal errors, and is not fitted."""
CERTAIN = 4.0
"""Standard deviations from 0 at which a spring counts as found."""


@dataclass(frozen=True)
class Inverse:
    """1/P̂ and its errors."""

    frequency: np.ndarray
    """Frequency [Hz], shape (L,)."""
    values: np.ndarray
    """1/P̂ [N/m], complex, shape (L,)."""
    noise: np.ndarray
    """E|d(1/P̂)|² by noise [N²/m²], shape (L,)."""
    columns: np.ndarray
    """What one standard deviation of the friction model does, in uncorrelated directions, complex, shape (L, N)."""

    @property
    def s(self) -> np.ndarray:
        """Return jω [rad/s]."""
        return 2j * np.pi * self.frequency

    def of_friction(self, *more: np.ndarray) -> np.ndarray:
        """Return the covariance of (real, imaginary) part by friction and `more` such columns, shape (L, 2, 2)."""
        columns = np.concatenate([self.columns, *(column[:, None] for column in more)], axis=1)
        parts = np.stack([columns.real, columns.imag], axis=1)
        found: np.ndarray = parts @ parts.transpose(0, 2, 1)
        return found


@dataclass(frozen=True)
class Linear:
    """Forces linear in the motion that are taken off: D v [N s/m] and K y [N/m]."""

    values: np.ndarray
    """D and K, shape (2,)."""
    free: tuple[int, ...]
    """Which of them are looked for; the others are held."""

    def response(self, inverse: Inverse) -> np.ndarray:
        """Return P̂ without them, shape (L,)."""
        found: np.ndarray = 1 / (inverse.values - self.values[0] * inverse.s - self.values[1])
        return found


@dataclass(frozen=True)
class Fitted:
    """The plant that is fitted once these linear forces are taken off."""

    linear: Linear
    solution: Solution
    places: np.ndarray
    """Where the fitted points stand among the lines, shape (points,)."""


@dataclass(frozen=True)
class PlantFound:
    """The plant, and the linear forces beside it."""

    fit: Result
    """Response and plant as `modal_fit` gives them, the covariance with the friction model's."""
    viscous: float
    viscous_deviation: float
    """D [N s/m] and its standard deviation."""
    spring: float
    """K [N/m] of what never slips; 0 if none is told."""


def plant_of(inverse: Inverse, response: FrequencyResponse, modal: ModalFit) -> PlantFound:
    """Return the plant in 1/P̂; `response` is the one whose values are to be replaced."""
    start = _start(inverse)
    modes = modal.modes
    if modes is None:
        fit = modal.fit_of(_response(inverse, start, response))
        modes = int(next(metric.value for metric in fit.metrics if metric.name == "modes"))
    while True:
        try:
            return _found(inverse, start, response, modal.model_copy(update={"modes": modes}))
        except RecordError:  # a mode that stood for damping or spring is gone with them
            if modal.modes is not None or modes == 0:
                raise
        modes -= 1


def _found(inverse: Inverse, start: Linear, response: FrequencyResponse, modal: ModalFit) -> PlantFound:
    """Return the plant with modal.modes modes."""
    fitted = _solved(inverse, replace(start, free=(0, 1)), response, modal)
    values = fitted.linear.values
    if values[1] < CERTAIN * np.sqrt(_covariance(inverse, fitted, modal.floor)[-1, -1]):
        fitted = _solved(inverse, Linear(values * [1, 0], (0,)), response, modal)
    values, free = fitted.linear.values, fitted.linear.free
    if values[0] < 0:
        fitted = _solved(inverse, Linear(values * [0, 1], free[1:]), response, modal)
    linear, covariance = fitted.linear, _covariance(inverse, fitted, modal.floor)
    size = fitted.solution.model.size
    final = modal.fit_of(_response(inverse, linear, response))
    errors = _square_root(covariance[size:, size:])
    own = inverse.of_friction(*(errors.T @ _of_linear(inverse, linear).T))
    stated = replace(_response(inverse, linear, response, own), settled=response.settled)
    final = replace(
        final,
        response=replace(stated, covariance=_noise(inverse, linear)),
        fits=tuple(_with_covariance(fit, fitted.solution, covariance) for fit in final.fits),
    )
    viscous = float(np.sqrt(covariance[size, size])) if 0 in linear.free else 0.0
    return PlantFound(final, float(linear.values[0]), viscous, float(linear.values[1]))


def _square_root(covariance: np.ndarray) -> np.ndarray:
    """Return a matrix whose product with its transpose is the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _of_linear(inverse: Inverse, linear: Linear) -> np.ndarray:
    """Return the derivative of 1/P by the free linear forces, complex, shape (L, free)."""
    columns: np.ndarray = np.stack([inverse.s, np.ones_like(inverse.s)], axis=1)[:, list(linear.free)]
    return columns


def _start(inverse: Inverse) -> Linear:
    """Return D and K by Im 1/P̂ = D ω + b ω³ and Re 1/P̂ = K - m ω² at the lowest lines; K where it is certain."""
    order = np.argsort(inverse.frequency)
    low = order[: max(FEW, int(np.sum(inverse.frequency < DECADE * inverse.frequency.min())))]
    omega, covariance = 2 * np.pi * inverse.frequency[low], inverse.of_friction()[low]
    values = inverse.values[low]
    viscous, _ = _line(omega, omega**3, values.imag, inverse.noise[low] / 2 + covariance[:, 1, 1])
    spring, deviation = _line(np.ones(low.size), omega**2, values.real, inverse.noise[low] / 2 + covariance[:, 0, 0])
    return Linear(np.array([max(viscous, 0.0), spring if spring > CERTAIN * deviation else 0.0]), (0,))


def _line(first: np.ndarray, second: np.ndarray, values: np.ndarray, variance: np.ndarray) -> tuple[float, float]:
    """Return the coefficient of the first of two columns by weighted least squares, and its standard deviation."""
    columns = np.stack([first, second], axis=1) / np.sqrt(variance)[:, None]
    scale = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.pinv(columns / scale) / scale[:, None]
    return float((inverse @ (values / np.sqrt(variance)))[0]), float(np.linalg.norm(inverse[0]))


def _turned(inverse: Inverse, linear: Linear, covariance: np.ndarray) -> np.ndarray:
    """Return the covariance of (real, imaginary) part of P̂ that one of 1/P̂ makes, each (L, 2, 2)."""
    slope = -(linear.response(inverse) ** 2)
    turn = np.moveaxis(np.array([[slope.real, -slope.imag], [slope.imag, slope.real]]), -1, 0)
    found: np.ndarray = turn @ covariance @ turn.transpose(0, 2, 1)
    return (found + found.transpose(0, 2, 1)) / 2


def _noise(inverse: Inverse, linear: Linear) -> np.ndarray:
    return _turned(inverse, linear, inverse.noise[:, None, None] * np.eye(2) / 2)


def _response(
    inverse: Inverse, linear: Linear, response: FrequencyResponse, model: np.ndarray | None = None
) -> FrequencyResponse:
    """Return P̂ with the covariance by noise and friction together, vague points left out as if not settled."""
    whole = inverse.noise[:, None, None] * np.eye(2) / 2 + inverse.of_friction()
    values, covariance = linear.response(inverse), _turned(inverse, linear, whole)
    uncertain = np.sqrt(np.trace(covariance, axis1=1, axis2=2)) > VAGUE * np.abs(values)
    return replace(
        response,
        response=values,
        covariance=covariance,
        settled=response.settled & ~uncertain,
        freedom=None,
        model_covariance=model,
    )


def _solved(inverse: Inverse, linear: Linear, response: FrequencyResponse, modal: ModalFit) -> Fitted:
    """Return plant and linear forces by Gauss-Newton steps of the forces, the plant being fitted anew at each."""
    fitted = _fit(inverse, linear, response, modal)
    for _ in range(ITERATIONS if linear.free else 0):
        jacobian = _jacobian(inverse, fitted)
        scale = np.linalg.norm(jacobian, axis=0)
        residual = fitted.solution.data.stacked(fitted.solution.error)
        step = np.linalg.lstsq(jacobian / scale, -residual, rcond=None)[0] / scale
        moved = step[fitted.solution.model.size :]
        deviation = np.sqrt(np.diag(_covariance(inverse, fitted, modal.floor)))[fitted.solution.model.size :]
        values = fitted.linear.values.copy()
        values[list(linear.free)] += moved
        fitted = _fit(inverse, replace(linear, values=values), response, modal)
        if np.all(np.abs(moved) <= CONVERGED * deviation):
            break
    return fitted


def _fit(inverse: Inverse, linear: Linear, response: FrequencyResponse, modal: ModalFit) -> Fitted:
    """Return the plant fitted once these linear forces are taken off."""
    stated = _response(inverse, linear, response)
    highest = np.inf if modal.highest is None else modal.highest
    data = log_response(stated, (modal.lowest, highest), "automatic", modal.floor, 2)
    if not data.frequency.size:
        raise RecordError(
            "autonomous: no line of which P̂ is told lies within the band of the plant fit; widen it, or raise the "
            "amplitude"
        )
    model = ModalModel(modal.modes or 0, float(data.frequency[0]), float(data.frequency[-1]), False, 0.0)
    places = np.flatnonzero(stated.settled & (inverse.frequency >= modal.lowest) & (inverse.frequency <= highest))
    places = places[np.argsort(inverse.frequency[places], kind="stable")]
    return Fitted(linear, of_order(model, data), places)


def _jacobian(inverse: Inverse, fitted: Fitted) -> np.ndarray:
    """Return the derivative of the residuals by the plant's parameters and the free linear forces."""
    response = fitted.linear.response(inverse)[fitted.places]
    columns = response[:, None] * _of_linear(inverse, fitted.linear)[fitted.places]
    return np.concatenate([fitted.solution.jacobian, -fitted.solution.data.stacked(columns)], axis=1)


def _covariance(inverse: Inverse, fitted: Fitted, floor: float) -> np.ndarray:
    """Return the covariance of the plant's vector p and the free linear forces, with `floor` allowed for.

    The friction model's error is one at all lines, and not an error of each line by itself.
    """
    solution, places = fitted.solution, fitted.places
    response = fitted.linear.response(inverse)[places]
    back = np.linalg.pinv(_jacobian(inverse, fitted), rcond=1e-12)
    friction = back @ solution.data.stacked(response[:, None] * inverse.columns[places])
    spread = np.sqrt(np.abs(response) ** 2 * inverse.noise[places] / 2 + floor**2)
    noise = back * solution.data.stacked(spread * (1 + 1j)) * np.sqrt(solution.excess if solution.errs else 1.0)
    return friction @ friction.T + noise @ noise.T


def _with_covariance(fit: Fit, solution: Solution, covariance: np.ndarray) -> Fit:
    """Return the plant's fit with the covariance that the friction model's makes; the dead time is held."""
    size = solution.model.size
    slopes = solution.model.slopes(solution.p)
    own = slopes @ covariance[:size, :size] @ slopes.T
    return replace(fit, covariance=np.pad(own, (0, fit.values.size - size)))
