"""The plant in the inverse response beside friction: eq (1), viscous friction and a spring.

Amplitude invariance does not separate a force that is linear in the motion from the plant. The assumption that a rigid
body is neither damped nor held by a spring does.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Fit, FrequencyResponse, Result
from fraexp_plugins.identification.plant._modal_model import GROUND
from fraexp_plugins.identification.plant._modal_solver import Solution
from fraexp_plugins.identification.plant.modal_fit import ModalFit

MAX_RELATIVE_STD = 0.2
"""Relative standard deviation of P̂ above which its logarithm has no normal errors, and is not fitted."""
MIN_PLANT_MODEL_ERROR = 3e-4
"""Relative error of a plant's model that is allowed for in any case."""


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

    def friction_covariance(self) -> NDArray[np.float64]:
        """Return the covariance of (real, imaginary) part by friction, shape (L, 2, 2)."""
        parts = np.stack([self.columns.real, self.columns.imag], axis=1)
        return np.asarray(parts @ parts.transpose(0, 2, 1))

    def without(
        self, ground: NDArray[np.complex128], columns: NDArray[np.complex128], errors: NDArray[np.float64]
    ) -> "InverseResponse":
        """Return 1/P̂ without forces of ground [N/m], shape (L,), whose errors are some of such columns."""
        return replace(self, values=self.values - ground, columns=np.concatenate([self.columns, columns @ errors], 1))

    def response(self, like: FrequencyResponse) -> FrequencyResponse:
        """Return P̂ with its covariance by noise; points that friction leaves uncertain count as not settled."""
        values, common = 1 / self.values, self.relative_columns
        variance = np.abs(values) ** 2 * self.noise + np.sum(np.abs(common) ** 2, axis=1)
        noise = np.abs(values) ** 4 * self.noise
        return replace(
            like,
            response=values,
            covariance=noise[:, None, None] * np.eye(2) / 2,
            settled=like.settled & (np.sqrt(variance) <= MAX_RELATIVE_STD),
            freedom=None,
            model_covariance=self.friction_covariance(),
        )

    @property
    def relative_columns(self) -> NDArray[np.complex128]:
        """The effect of the errors of friction on ln P̂, complex, shape (L, N)."""
        return -self.columns / self.values[:, None]


@dataclass(frozen=True)
class IdentifiedPlant:
    """The plant, and the linear forces beside it."""

    fit: Result
    """Response and plant as from `modal_fit`, with the friction model in the covariance."""
    viscous: float
    viscous_std: float
    """D [N s/m] and its standard deviation."""
    spring: float
    """K [N/m]; 0 if it is not significant."""
    dead_time: float
    """Dead time that is left in P̂ [s]; 0 unless it was free."""
    fall: float
    """How many standard deviations D was below 0 before it was fixed at 0."""
    cost: float
    """Mean square of what the plant leaves of P̂ over its errors."""


def identify_plant(inverse: InverseResponse, response: FrequencyResponse, modal: ModalFit) -> IdentifiedPlant:
    """Return the plant in 1/P̂; its response is `response` with other values. RecordError if there is none.

    The error of the friction model is common to all frequencies, not independent at each. If the plant leaves less than
    the model error of `modal`, that is taken for its error.
    """
    found = modal.model_copy(update={"fit_ground": True}).solve(inverse.response(response), inverse.relative_columns)
    cost, solution = found.solution.excess, _with_smaller_error(found.solution, modal.model_error)
    model, covariance = solution.model, solution.model.slopes(solution.p) @ square_root(solution.covariance)
    own = slice(model.ground_place, model.ground_place + len(model.ground))
    s = np.complex128(2j * np.pi) * inverse.frequency
    columns, forces = model.ground_columns(s), model.ground_forces(solution.p)
    free = inverse.without(columns @ forces, columns, covariance[own])
    kept = np.delete(np.arange(model.size), np.arange(model.size)[own])
    bare = modal.log_data(free.response(response), free.relative_columns)
    plant = Solution(replace(model, ground=()), bare, solution.p[kept])
    fit = modal.report(plant, found.causes, replace(free.response(response), settled=response.settled))
    fit = replace(fit, fits=tuple(_with_covariance(each, covariance[kept]) for each in fit.fits))
    known = dict(zip(model.ground, zip(forces, np.linalg.norm(covariance[own], axis=1), strict=True), strict=True))
    (viscous, viscous_std), (spring, _) = (known.get(name, (0.0, 0.0)) for name in GROUND)
    delay = model.delay(solution.p) if model.dead_time is None else 0.0
    return IdentifiedPlant(fit, float(viscous), float(viscous_std), float(spring), delay, found.fall, cost)


def _with_smaller_error(solution: Solution, model_error: float) -> Solution:
    """Return a fit with the model error that its residuals show, if that is less than what was allowed for."""
    data = solution.data
    if data.covariance is None:
        return solution
    smaller = max(model_error * np.sqrt(min(solution.excess, 1.0)), min(MIN_PLANT_MODEL_ERROR, model_error))
    return replace(solution, data=replace(data, covariance=data.covariance - (model_error**2 - smaller**2) * np.eye(2)))


def square_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a matrix whose product with its transpose is the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _with_covariance(fit: Fit, root: NDArray[np.float64]) -> Fit:
    """Return the plant's fit with the covariance of a root, shape (p, q); a dead time that is fixed has none."""
    return replace(fit, covariance=np.pad(root @ root.T, (0, fit.values.size - len(root))))
