"""The plant in the inverse response beside friction elements: eq (1), viscous friction and a spring.

Amplitude invariance does not separate a force that is linear in the motion from the plant. The assumption that a rigid
body is neither damped nor held by a spring does.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Fit, FrequencyResponse, RecordError, Result, Signals
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.realisations import Part, circular_covariance, combine_parts
from fraexp_plugins.identification.autonomous._autonomous_elements import AutonomousElements
from fraexp_plugins.identification.autonomous._autonomous_lines import SpectralLines
from fraexp_plugins.identification.plant._modal_model import ModalModel, log_response
from fraexp_plugins.identification.plant._modal_solver import Solution, fit_of_order
from fraexp_plugins.identification.plant.modal_fit import ModalFit

MAX_ITERATIONS, CONVERGED_STDS = 6, 0.01
"""Steps of the linear forces, and the size of the last step in standard deviations."""
MIN_LOW_LINES, LOW_FREQUENCY_RATIO = 8, 10.0
"""Lowest lines for the start value of the viscous coefficient: their number, and their range in frequency."""
MAX_RELATIVE_STD = 0.2
"""Relative standard deviation of P̂ above which its logarithm has no normal errors, and is not fitted."""
MIN_SPRING_STDS = 4.0
"""Standard deviations from 0 from which a spring is significant."""


@dataclass(frozen=True)
class InverseResponse:
    """1/P̂ and its errors."""

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (L,)."""
    values: NDArray[np.complex128]
    """1/P̂ [N/m], complex, shape (L,)."""
    noise: NDArray[np.float64]
    """E|d(1/P̂)|² by noise [N²/m²], shape (L,)."""
    columns: NDArray[np.complex128]
    """The effect of one standard deviation of the friction model, in uncorrelated directions, complex, shape (L, N)."""

    @property
    def s(self) -> NDArray[np.complex128]:
        """Return jω [rad/s]."""
        return np.complex128(2j * np.pi) * self.frequency

    def friction_covariance(self, *more: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the covariance of (real, imaginary) part by friction and `more` such columns, shape (L, 2, 2)."""
        columns = np.concatenate([self.columns, *(column[:, None] for column in more)], axis=1)
        parts = np.stack([columns.real, columns.imag], axis=1)
        return parts @ parts.transpose(0, 2, 1)


def response_of(
    signals: Signals, channels: tuple[str, str], lines: SpectralLines, elements: AutonomousElements
) -> tuple[Result, InverseResponse]:
    """Return P̂ between control input and position, before linear forces are removed, and 1/P̂."""
    effective = np.abs(lines.thrust - lines.deflection @ elements.stiffness)
    inverse = InverseResponse(lines.frequency, elements.inverse, elements.noise, elements.inverse_columns)
    response, count = 1 / elements.inverse, lines.known.sum(axis=1)
    band = circular_covariance(np.abs(response) ** 4 * elements.noise)
    amplitudes = np.where(lines.known, effective, 0.0).sum(axis=1) / count, np.abs(lines.motion).sum(axis=1) / count
    parts, begin = [], 0
    for group in lines.groups:
        segments = tuple(signals.segments[place] for place in group)
        rows = slice(begin, begin + segments[0].lines.size)
        begin = rows.stop
        sizes = (amplitudes[0][rows], amplitudes[1][rows])
        parts.append(Part(segments, lines.frequency[rows], response[rows], band[rows], np.inf, *sizes))
    units = signals.unit(channels[0]), signals.unit(channels[1])
    found = combine_parts(signals, parts, names=(EFFECTIVE_INPUT, channels[1]), units=units)
    assert found.response is not None
    return replace(found, response=replace(found.response, model_covariance=inverse.friction_covariance())), inverse


@dataclass(frozen=True)
class LinearForces:
    """Forces linear in the motion that are removed: D v and K y."""

    values: NDArray[np.float64]
    """D [N s/m] and K [N/m], shape (2,)."""
    free: tuple[int, ...]
    """Places of those that are estimated; the others are fixed."""

    def response(self, inverse: InverseResponse) -> NDArray[np.complex128]:
        """Return P̂ without them, shape (L,)."""
        return 1 / (inverse.values - self.values[0] * inverse.s - self.values[1])


@dataclass(frozen=True)
class PlantSolution:
    """The plant that is fitted once these linear forces are removed."""

    linear: LinearForces
    solution: Solution
    places: NDArray[np.int64]
    """Places of the fitted points among the lines, shape (points,)."""


@dataclass(frozen=True)
class IdentifiedPlant:
    """The plant, and the linear forces beside it."""

    fit: Result
    """Response and plant as from `modal_fit`, with the friction model in the covariance."""
    viscous: float
    viscous_std: float
    """D [N s/m] and its standard deviation."""
    spring: float
    """K [N/m] of elements that never slip; 0 if it is not significant."""
    fall: float = 0.0
    """How many standard deviations D was below 0 before it was fixed at 0."""


def plant_cost(plant: IdentifiedPlant) -> float:
    """Return the mean square of what the plant leaves of P̂ over its errors."""
    return next(metric.value for metric in plant.fit.metrics if metric.name == "cost")


def identify_plant(inverse: InverseResponse, response: FrequencyResponse, modal: ModalFit) -> IdentifiedPlant:
    """Return the plant in 1/P̂; its response is `response` with other values."""
    start = _start_forces(inverse)
    modes = modal.modes
    if modes is None:
        fit = modal.fit_response(_response(inverse, start, response))
        modes = int(next(metric.value for metric in fit.metrics if metric.name == "modes"))
    while True:
        try:
            return _identify(inverse, start, response, modal.model_copy(update={"modes": modes}))
        except RecordError:  # without damping and spring, a mode that stood for them vanishes
            if modal.modes is not None or modes == 0:
                raise
        modes -= 1


def _identify(
    inverse: InverseResponse, start: LinearForces, response: FrequencyResponse, modal: ModalFit
) -> IdentifiedPlant:
    """Return the plant with modal.modes modes."""
    fitted = _solve(inverse, replace(start, free=(0, 1)), response, modal)
    values = fitted.linear.values
    if values[1] < MIN_SPRING_STDS * np.sqrt(_covariance(inverse, fitted, modal.model_error)[-1, -1]):
        fitted = _solve(inverse, LinearForces(values * [1, 0], (0,)), response, modal)
    values, free, fall = fitted.linear.values, fitted.linear.free, 0.0
    if values[0] < 0:
        place = fitted.solution.model.size
        fall = -values[0] / np.sqrt(_covariance(inverse, fitted, modal.model_error)[place, place])
        fitted = _solve(inverse, LinearForces(values * [0, 1], free[1:]), response, modal)
    linear, covariance = fitted.linear, _covariance(inverse, fitted, modal.model_error)
    size = fitted.solution.model.size
    final = modal.fit_response(_response(inverse, linear, response))
    errors = _square_root(covariance[size:, size:])
    own = inverse.friction_covariance(*(errors.T @ _force_derivatives(inverse, linear).T))
    complete = replace(_response(inverse, linear, response, own), settled=response.settled)
    final = replace(
        final,
        response=replace(complete, covariance=_noise_covariance(inverse, linear)),
        fits=tuple(_with_covariance(fit, fitted.solution, covariance) for fit in final.fits),
    )
    viscous = float(np.sqrt(covariance[size, size])) if 0 in linear.free else 0.0
    return IdentifiedPlant(final, float(linear.values[0]), viscous, float(linear.values[1]), float(fall))


def _square_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a matrix whose product with its transpose is the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _force_derivatives(inverse: InverseResponse, linear: LinearForces) -> NDArray[np.complex128]:
    """Return the derivative of 1/P by the free linear forces, complex, shape (L, free)."""
    return np.stack([inverse.s, np.ones_like(inverse.s)], axis=1)[:, list(linear.free)]


def _start_forces(inverse: InverseResponse) -> LinearForces:
    """Return D and K by Im 1/P̂ = D ω + b ω³ and Re 1/P̂ = K - m ω² at the lowest lines; K if it is significant."""
    order = np.argsort(inverse.frequency)
    low = order[: max(MIN_LOW_LINES, int(np.sum(inverse.frequency < LOW_FREQUENCY_RATIO * inverse.frequency.min())))]
    omega, covariance = 2 * np.pi * inverse.frequency[low], inverse.friction_covariance()[low]
    values = inverse.values[low]
    viscous, _ = _first_coefficient(omega, omega**3, values.imag, inverse.noise[low] / 2 + covariance[:, 1, 1])
    spring, std = _first_coefficient(
        np.ones(low.size), omega**2, values.real, inverse.noise[low] / 2 + covariance[:, 0, 0]
    )
    return LinearForces(np.array([max(viscous, 0.0), spring if spring > MIN_SPRING_STDS * std else 0.0]), (0,))


def _first_coefficient(
    first: NDArray[np.float64], second: NDArray[np.float64], values: NDArray[np.float64], variance: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the coefficient of the first of two columns by weighted least squares, and its standard deviation."""
    columns = np.stack([first, second], axis=1) / np.sqrt(variance)[:, None]
    scale = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.pinv(columns / scale) / scale[:, None]
    return float((inverse @ (values / np.sqrt(variance)))[0]), float(np.linalg.norm(inverse[0]))


def _response_covariance(
    inverse: InverseResponse, linear: LinearForces, covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the covariance of (real, imaginary) part of P̂ from that of 1/P̂, each of shape (L, 2, 2)."""
    slope = -(linear.response(inverse) ** 2)
    turn = np.moveaxis(np.array([[slope.real, -slope.imag], [slope.imag, slope.real]]), -1, 0)
    found = turn @ covariance @ turn.transpose(0, 2, 1)
    return (found + found.transpose(0, 2, 1)) / 2


def _noise_covariance(inverse: InverseResponse, linear: LinearForces) -> NDArray[np.float64]:
    return _response_covariance(inverse, linear, inverse.noise[:, None, None] * np.eye(2) / 2)


def _response(
    inverse: InverseResponse,
    linear: LinearForces,
    response: FrequencyResponse,
    model: NDArray[np.float64] | None = None,
) -> FrequencyResponse:
    """Return P̂ with the covariance by noise and friction together; uncertain points count as not settled."""
    whole = inverse.noise[:, None, None] * np.eye(2) / 2 + inverse.friction_covariance()
    values, covariance = linear.response(inverse), _response_covariance(inverse, linear, whole)
    uncertain = np.sqrt(np.trace(covariance, axis1=1, axis2=2)) > MAX_RELATIVE_STD * np.abs(values)
    return replace(
        response,
        response=values,
        covariance=covariance,
        settled=response.settled & ~uncertain,
        freedom=None,
        model_covariance=model,
    )


def _solve(
    inverse: InverseResponse, linear: LinearForces, response: FrequencyResponse, modal: ModalFit
) -> PlantSolution:
    """Return plant and linear forces by Gauss-Newton steps of the forces, with a new fit of the plant at each step."""
    fitted = _fit(inverse, linear, response, modal)
    for _ in range(MAX_ITERATIONS if linear.free else 0):
        jacobian = _jacobian(inverse, fitted)
        scale = np.linalg.norm(jacobian, axis=0)
        residual = fitted.solution.data.weighted_parts(fitted.solution.error)
        step = np.linalg.lstsq(jacobian / scale, -residual, rcond=None)[0] / scale
        moved = step[fitted.solution.model.size :]
        stds = np.sqrt(np.diag(_covariance(inverse, fitted, modal.model_error)))[fitted.solution.model.size :]
        values = fitted.linear.values.copy()
        values[list(linear.free)] += moved
        fitted = _fit(inverse, replace(linear, values=values), response, modal)
        if np.all(np.abs(moved) <= CONVERGED_STDS * stds):
            break
    return fitted


def _fit(inverse: InverseResponse, linear: LinearForces, response: FrequencyResponse, modal: ModalFit) -> PlantSolution:
    """Return the plant fitted once these linear forces are removed."""
    remaining = _response(inverse, linear, response)
    max_frequency = np.inf if modal.max_frequency is None else modal.max_frequency
    data = log_response(remaining, (modal.min_frequency, max_frequency), "automatic", modal.model_error, 2)
    if not data.frequency.size:
        raise RecordError(
            "plant_and_friction: P̂ is not identifiable at any line within the frequency range of the plant fit; widen "
            "it, or raise the amplitude"
        )
    model = ModalModel(modal.modes or 0, float(data.frequency[0]), float(data.frequency[-1]), False, 0.0)
    places = np.flatnonzero(
        remaining.settled & (inverse.frequency >= modal.min_frequency) & (inverse.frequency <= max_frequency)
    )
    places = places[np.argsort(inverse.frequency[places], kind="stable")]
    return PlantSolution(linear, fit_of_order(model, data), places)


def _jacobian(inverse: InverseResponse, fitted: PlantSolution) -> NDArray[np.float64]:
    """Return the derivative of the residuals by the plant's parameters and the free linear forces."""
    response = fitted.linear.response(inverse)[fitted.places]
    columns = response[:, None] * _force_derivatives(inverse, fitted.linear)[fitted.places]
    return np.concatenate([fitted.solution.jacobian, -fitted.solution.data.weighted_parts(columns)], axis=1)


def _covariance(inverse: InverseResponse, fitted: PlantSolution, model_error: float) -> NDArray[np.float64]:
    """Return the covariance of the plant's vector p and the free linear forces, with `model_error` included.

    The error of the friction model is common to all lines, not independent at each line.
    """
    solution, places = fitted.solution, fitted.places
    response = fitted.linear.response(inverse)[places]
    back = np.linalg.pinv(_jacobian(inverse, fitted), rcond=1e-12)
    friction = back @ solution.data.weighted_parts(response[:, None] * inverse.columns[places])
    spread = np.sqrt(np.abs(response) ** 2 * inverse.noise[places] / 2 + model_error**2)
    noise = (
        back
        * solution.data.weighted_parts(spread * (1 + 1j))
        * np.sqrt(solution.excess if solution.has_model_error else 1.0)
    )
    return friction @ friction.T + noise @ noise.T


def _with_covariance(fit: Fit, solution: Solution, covariance: NDArray[np.float64]) -> Fit:
    """Return the plant's fit with the friction model in its covariance; the dead time is fixed."""
    size = solution.model.size
    slopes = solution.model.slopes(solution.p)
    own = slopes @ covariance[:size, :size] @ slopes.T
    return replace(fit, covariance=np.pad(own, (0, fit.values.size - size)))
