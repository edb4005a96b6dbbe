"""The fit of forces whose sizes are linear and whose shape is not: free thresholds of elements, or a whole law."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, Motion, ParameterError, RecordError
from fraexp_plugins.identification._shared.law_numbers import LawNumbers
from fraexp_plugins.identification._shared.stop_operator import threshold_sensitivity
from fraexp_plugins.identification.friction._friction_record import FrictionRecord
from fraexp_plugins.identification.friction._friction_regression import (
    CompressedRows,
    RegressionRows,
    long_run_variance,
    pseudo_inverse,
)
from fraexp_plugins.identification.friction._friction_task import IdentificationTask

DIFFERENCE_STEP = 1e-5
"""Step of a coordinate over which differences are taken."""
COST_TOLERANCE, STEP_TOLERANCE = 1e-8, 1e-10
"""Relative change of the squared error, and of the coordinates, with which a search ends."""


class ForceShape(ABC):
    """Forces per unit of their sizes, along a record, for the coordinates of a shape."""

    @abstractmethod
    def columns(self, record: FrictionRecord, shape: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return each force [N] per unit of its size, shape (n, N)."""

    @abstractmethod
    def slopes(
        self, record: FrictionRecord, shape: NDArray[np.float64], sizes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the derivative of the force with these sizes by the shape, shape (n, q)."""

    def upper(self, start: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the bounds of the coordinates above, shape (q,)."""
        return np.full(start.size, np.inf)


@dataclass(frozen=True)
class FreeElements(ForceShape):
    """Elasto-slide elements with free thresholds Y_i and, if they are damped, relaxation times D_i/K_i.

    The coordinates are the logarithms of thresholds and then of relaxation times; the sizes are the K_i. The gradient
    goes through the whole record: ∂z_i/∂Y_i is the direction of the element's last slip, which it remembers while it
    sticks. It is computed forward in time, which is exact and equal to back-propagation (R. J. Williams and D. Zipser,
    Neural Computation 1(2), 1989, doi:10.1162/neco.1989.1.2.270).
    """

    count: int
    max_threshold: float
    """[m]"""

    def columns(self, record: FrictionRecord, shape: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force of each element over its stiffness [m], shape (n, N)."""
        thresholds, damped = self._split(shape)
        deflection = record.deflections(thresholds)
        if not damped.size:
            return deflection
        return np.clip(deflection + damped * _velocity(record), -thresholds, thresholds)

    def slopes(
        self, record: FrictionRecord, shape: NDArray[np.float64], sizes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the derivative of the force with these stiffnesses by the logarithms, shape (n, q)."""
        thresholds, damped = self._split(shape)
        deflection = record.deflections(thresholds)
        by_threshold = threshold_sensitivity(deflection, thresholds)
        if not damped.size:
            return sizes * thresholds * by_threshold
        rate = damped * _velocity(record)
        force = deflection + rate
        is_limited = np.abs(force) >= thresholds
        by_threshold = np.where(is_limited, np.sign(force), by_threshold)
        return np.concatenate([sizes * thresholds * by_threshold, sizes * np.where(is_limited, 0.0, rate)], axis=1)

    def upper(self, start: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the bounds of the coordinates above, shape (q,)."""
        limits = np.full(start.size, np.inf)
        limits[: self.count] = np.maximum(np.log(self.max_threshold), start[: self.count])
        return limits

    def _split(self, shape: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return np.exp(shape[: self.count]), np.exp(shape[self.count :])


def _velocity(record: FrictionRecord) -> NDArray[np.float64]:
    """Return the velocity [m/s] at the samples, to second order, as elements of the rolling model have it that move."""
    change = np.diff(record.displacement, prepend=record.displacement[0])
    before = np.concatenate([np.zeros(1), change[:-1]])
    return np.asarray((1.5 * change - 0.5 * before) / record.sample_time)[:, None]


@dataclass(frozen=True)
class LawShape(ForceShape):
    """The force of a law, whichever it is, that the measured motion drives; the size is a factor on it."""

    numbers: LawNumbers

    def columns(self, record: FrictionRecord, shape: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the law's force [N], shape (n, 1); 0 for numbers that the law does not allow."""
        try:
            model = self.numbers.model(shape)
        except ParameterError:
            return np.zeros((record.displacement.size, 1))
        return force_along(model, record)[:, None]

    def slopes(
        self, record: FrictionRecord, shape: NDArray[np.float64], sizes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the derivative of the force by the coordinates, shape (n, q)."""
        here = self.columns(record, shape)
        moved = [self.columns(record, shape + DIFFERENCE_STEP * row) for row in np.eye(shape.size)]
        return np.concatenate([sizes * (each - here) / DIFFERENCE_STEP for each in (*moved, here[:, :0])], axis=1)


def force_along(model: FrictionModel, record: FrictionRecord) -> NDArray[np.float64]:
    """Return a law's force [N] along a record, from its state before the record, shape (n,)."""
    motion = Motion(record.displacement, record.sample_time, False, record.before, record.sample_time)
    return model.forces([motion])[0]


@dataclass(frozen=True)
class ShapedForces:
    """Forces of a shape beside the terms of a task, with the sizes of least squared error."""

    task: IdentificationTask
    forces: ForceShape
    shape: NDArray[np.float64]

    @cached_property
    def rows(self) -> list[RegressionRows]:
        """Terms, then the forces, in each record."""
        return self.task.rows_with([self.forces.columns(record, self.shape) for record in self.task.records])

    @cached_property
    def coefficients(self) -> NDArray[np.float64]:
        """Those of the terms, then the sizes, shape (p,)."""
        compressed = CompressedRows(self.rows, self.task.cycles)
        return compressed.solve(np.ones(self.rows[0].columns.shape[1], dtype=bool))

    @property
    def sizes(self) -> NDArray[np.float64]:
        """Sizes of the forces, shape (N,)."""
        return self.coefficients[len(self.task.terms) :]

    @cached_property
    def residuals(self) -> list[NDArray[np.float64]]:
        """Measured less modelled force in the rows of each record [N]."""
        return [each.force - each.columns @ self.coefficients for each in self.rows]

    def of_fitted_cycles(self, parts: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
        """Return what belongs to the cycles that are fitted, of each record."""
        pairs = zip(parts, self.rows, strict=True)
        return [part[np.isin(rows.cycle, self.task.cycles)] for part, rows in pairs]

    @property
    def cost(self) -> float:
        """Sum of the squared residuals of the fitted cycles [N²]."""
        return float(sum(np.sum(part**2) for part in self.of_fitted_cycles(self.residuals)))

    @cached_property
    def jacobian(self) -> NDArray[np.float64]:
        """Derivatives of the modelled force by the shape, then by the coefficients, in all fitted rows."""
        slopes = [self.forces.slopes(record, self.shape, self.sizes) for record in self.task.records]
        count = len(self.task.terms)
        rows = zip(self.task.rows_with(slopes), self.rows, strict=True)
        parts = [np.column_stack([slope.columns[:, count:], own.columns]) for slope, own in rows]
        return np.concatenate(self.of_fitted_cycles(parts))

    @property
    def projected_slopes(self) -> NDArray[np.float64]:
        """Derivative of the residual by the shape, with the sizes of least squares at each shape (L. Kaufman, 1975)."""
        slopes, columns = np.split(self.jacobian, [self.shape.size], axis=1)
        used = columns[:, self.coefficients != 0]  # a size that stays at 0 does not follow the shape
        scale = np.linalg.norm(used, axis=0)
        basis, _ = np.linalg.qr(used / np.where(scale > 0, scale, 1.0))
        return np.asarray(basis @ (basis.T @ slopes) - slopes)

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of shape and coefficients, with the residuals' correlation, shape (q + p, q + p)."""
        size = np.linalg.norm(self.jacobian, axis=0)
        size[size == 0] = 1.0
        root = pseudo_inverse(self.jacobian / size) / size[:, None]
        variance = long_run_variance(self.of_fitted_cycles(self.residuals), size.size)
        return np.asarray(root @ root.T * variance)


def fit_shape(
    task: IdentificationTask, forces: ForceShape, start: NDArray[np.float64], max_iterations: int
) -> ShapedForces:
    """Return the shape of least squared error near a start; RecordError if the search does not converge.

    Sizes and terms are those of least squares at each shape (variable projection: G. H. Golub and V. Pereyra, SIAM J.
    Numerical Analysis 10(2), 1973, doi:10.1137/0710036).
    """
    found, has_converged = search_shape(task, forces, start, max_iterations)
    if not has_converged:
        raise RecordError(
            f"friction_identification did not converge in {max_iterations} steps: the record does not suit this law; "
            "raise max_iterations, use fewer elements, or record more speeds"
        )
    return found


def search_shape(
    task: IdentificationTask, forces: ForceShape, start: NDArray[np.float64], max_iterations: int
) -> tuple[ShapedForces, bool]:
    """Return where a search ends, and whether it has converged."""
    from scipy.optimize import least_squares  # slow to import: only when something is estimated

    known: list[ShapedForces] = []

    def at(shape: NDArray[np.float64]) -> ShapedForces:
        if not known or not np.array_equal(known[-1].shape, shape):
            known[:] = [ShapedForces(task, forces, np.array(shape))]
        return known[-1]

    def residual(shape: NDArray[np.float64]) -> NDArray[np.float64]:
        here = at(shape)
        return np.concatenate(here.of_fitted_cycles(here.residuals))

    found = least_squares(
        residual, start, jac=lambda shape: at(shape).projected_slopes,
        bounds=(-np.inf, forces.upper(start) + 1e-9), x_scale="jac",
        ftol=COST_TOLERANCE, xtol=STEP_TOLERANCE, gtol=None, max_nfev=max_iterations,
    )  # fmt: skip
    return at(found.x), bool(found.status > 0)
