"""Rolling friction by a gradient fit through time: stiffness, damping and limit force of all elements at once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    FrictionModel,
    ParameterError,
    PositionDependentFriction,
    RecordError,
    Result,
    Signals,
    param,
)
from fraexp_plugins.friction._shared.element_model import ElementModel
from fraexp_plugins.identification._shared.levenberg_marquardt import IterationStep, minimise
from fraexp_plugins.identification._shared.stop_operator import threshold_sensitivity
from fraexp_plugins.identification.friction._shared.friction_identification import (
    IdentificationTask,
    resolution_remarks,
)
from fraexp_plugins.identification.friction._shared.friction_record import FrictionRecord
from fraexp_plugins.identification.friction._shared.friction_regression import (
    SIGNED_TERMS,
    RegressionRows,
    long_run_variance,
    pseudo_inverse,
)
from fraexp_plugins.identification.friction._shared.friction_report import ReportedElements, report
from fraexp_plugins.identification.friction._shared.grid_identification import GridIdentification

NEGLIGIBLE_FORCE = 1e-6
"""Force over the Coulomb force below which an element, or a term at the largest speed, counts as none."""


@dataclass(frozen=True)
class ElementParameters:
    """Elements and terms in the search."""

    stiffness: NDArray[np.float64]
    """K_i [N/m], shape (N,)."""
    limit_force: NDArray[np.float64]
    """F_mi [N], shape (N,)."""
    damping: NDArray[np.float64]
    """D_i [N s/m], shape (N,), or empty."""
    terms: NDArray[np.float64]
    """Coefficients of the task's terms."""

    @property
    def thresholds(self) -> NDArray[np.float64]:
        """Y_mi [m], eq (8)."""
        return self.limit_force / self.stiffness

    def after_step(self, step: NDArray[np.float64], free: int, max_threshold: float) -> "ElementParameters":
        """Return the parameters after a step: of the first `free` terms themselves, of the logarithms of all others."""
        count, damped = self.stiffness.size, self.damping.size
        growth = np.exp(np.clip(step, -5, 5))
        terms = self.terms.copy()
        last = step[2 * count + damped :]
        terms[:free] += last[:free]
        terms[free:] *= np.exp(np.clip(last[free:], -5, 5))
        stiffness = self.stiffness * growth[:count]
        return ElementParameters(
            stiffness,
            np.minimum(self.limit_force * growth[count : 2 * count], stiffness * max_threshold),
            self.damping * growth[2 * count : 2 * count + damped],
            terms,
        )


class GradientFit(GridIdentification, name="gradient_fit", version=2):
    """K_i, D_i and F_mi of least squared error of the force: the paper's back-propagation (paper, section V-A).

    The gradient goes through the whole record: ∂f_i/∂K_i = z_i - s_i Y_mi and ∂f_i/∂F_mi = s_i, where s_i is the
    direction of the element's last slip, which it remembers while it sticks. The gradient is computed forward in time,
    which is exact and equal to back-propagation (R. J. Williams and D. Zipser, Neural Computation 1(2), 1989,
    doi:10.1162/neco.1989.1.2.270). Levenberg and Marquardt's method (D. W. Marquardt, J. SIAM 11(2), 1963,
    doi:10.1137/0111030) in the logarithms replaces the steepest descent, which takes thousands of steps. Without a
    `start` it begins with the elements of `rolling_identification`, with free thresholds.

    The problem is not convex: another `start` may lead to a worse minimum; compare the held-out errors. The confidence
    bands assume the number of elements: for a smooth virgin curve, which has none, they cover about 89 %. Do not use it
    with more elements than are identifiable: their covariance shows it.
    """

    start: FrictionModel | None = param(
        "", "rolling model to start from; least squares on a grid if it is not given", None
    )
    fit_damping: bool = param("", "whether the elements' viscous coefficients D_i are identified too", False)
    max_iterations: int = param("1", "maximum number of steps", 300, at_least=1, at_most=100_000)

    def model_post_init(self, context: object) -> None:
        """Check the start."""
        super().model_post_init(context)
        if self.start is not None and not isinstance(self.start, ElementModel):
            raise ParameterError(
                f"gradient_fit.start is {self.start.name}; expected a model of elements, such as rolling"
            )
        if isinstance(self.start, PositionDependentFriction):
            raise ParameterError("gradient_fit.start has a position_dependence, which is not fitted; leave it out")

    def estimate(self, signals: Signals) -> Result:
        """Return elements, terms, errors, virgin curve and the rolling model."""
        task = self.task(signals) if self.start else self.focused_task(signals)
        if isinstance(self.start, ElementModel):
            task = replace(task, thresholds=np.union1d(self.start.limit_deflection, task.thresholds[-1:]))
        begin = self._start_parameters(task)
        if self.fit_damping:  # the springs first: damping in their place leads to a wrong minimum
            springs = self._descend(task, replace(begin, damping=np.empty(0)))
            begin = replace(springs, damping=begin.damping)
        last = self._descend(task, begin)
        rows, residuals, gradients = _linearise(task, last)
        found = _elements(task, last, rows, residuals, gradients)
        deflection = found.coulomb[0] / float(found.stiffness.sum())
        remarks = [*task.remarks, *resolution_remarks(task.resolution, deflection)]
        cycles = (task.cycles.size, task.held_out.size)
        errors = task.errors_from_residuals(rows, residuals)
        found, doubts = task.with_model_error(found, rows, errors)
        return report(signals, found, rows, errors, cycles, [*remarks, *doubts])

    def _start_parameters(self, task: IdentificationTask) -> ElementParameters:
        """Return the start, with small coefficients in place of 0, whose logarithm would stay at minus infinity."""
        if isinstance(self.start, ElementModel):
            stiffness, limit_force = (np.array(part) for part in self.start.elements)
            damping = np.array(self.start.damping)
            terms = [self.start.viscous if term == "viscous" else 0.0 for term in task.terms]
        else:
            found, _, _ = self.solution(task)
            stiffness, limit_force, damping = found.stiffness, found.limit_force, np.empty(0)
            terms = [found.terms[term] for term in task.terms]
        speed = max(float(np.abs(record.velocity()).max()) for record in task.records)
        smallest = NEGLIGIBLE_FORCE * float(limit_force.sum())
        if self.fit_damping:
            scale = np.full(stiffness.size, smallest / speed / stiffness.size * 1e3)
            damping = np.maximum(damping, scale) if damping.size else scale
        lower_bounds = {
            "viscous": smallest / speed,
            "mass": smallest * min(s.sample_time for s in task.records) / speed,
        }
        terms = [max(value, lower_bounds.get(term, -np.inf)) for term, value in zip(task.terms, terms, strict=True)]
        return ElementParameters(stiffness, limit_force, damping if self.fit_damping else np.empty(0), np.array(terms))

    def _descend(self, task: IdentificationTask, begin: ElementParameters) -> ElementParameters:
        """Return where the search ends; RecordError if it does not converge."""
        free = sum(term in SIGNED_TERMS for term in task.terms)
        limit = float(task.thresholds.max())

        def step_of(model: ElementParameters) -> IterationStep[ElementParameters]:
            rows, residuals, gradients = _linearise(task, model)
            chosen = [np.isin(each.cycle, task.cycles) for each in rows]
            pieces = [
                np.concatenate([part[which] for part, which in zip(parts, chosen, strict=True)])
                for parts in (residuals, gradients)
            ]
            return IterationStep(model, pieces[0], lambda: pieces[1])

        minimum = minimise(step_of, lambda model, step: model.after_step(step, free, limit), begin, self.max_iterations)
        if minimum.iterations >= self.max_iterations:
            raise RecordError(
                f"gradient_fit did not converge in {self.max_iterations} steps; raise max_iterations, or use fewer "
                "elements"
            )
        return minimum.place


def _linearise(
    task: IdentificationTask, model: ElementParameters
) -> tuple[list[RegressionRows], list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Return rows, residuals [N] and the residuals' negative gradients, record by record."""
    columns = [_responses(record, task.deflections(record, model.thresholds), model) for record in task.records]
    rows = task.rows_with(columns)
    count, free = len(task.terms), sum(term in SIGNED_TERMS for term in task.terms)
    scale = np.where(np.arange(count) < free, 1.0, model.terms)
    residuals = [each.force - each.columns[:, :count] @ model.terms - each.columns[:, count] for each in rows]
    gradients = [np.column_stack([each.columns[:, count + 1 :], each.columns[:, :count] * scale]) for each in rows]
    return rows, residuals, gradients


def _responses(
    record: FrictionRecord, deflection: NDArray[np.float64], model: ElementParameters
) -> NDArray[np.float64]:
    """Return the elements' force [N] and its derivatives by log K_i, log F_mi and log D_i, shape (n, 1 + 2N or 3N)."""
    thresholds, stiffness = model.thresholds, model.stiffness
    direction = threshold_sensitivity(deflection, thresholds)
    force, by_stiffness, by_threshold = stiffness * deflection, deflection, stiffness * direction
    damped: tuple[NDArray[np.float64], ...] = ()
    if model.damping.size:
        rate = _velocity(record.displacement, record.sample_time)[:, None]
        force = force + model.damping * rate
        limit = stiffness * thresholds
        limited = np.abs(force) >= limit
        side = np.sign(force)
        force = np.clip(force, -limit, limit)
        by_stiffness = np.where(limited, side * thresholds, by_stiffness)
        by_threshold = np.where(limited, side * stiffness, by_threshold)
        damped = (np.where(limited, 0.0, model.damping * rate),)
    by_limit = thresholds * by_threshold
    total = np.add.reduce(force, axis=1)[:, None]
    return np.concatenate([total, stiffness * by_stiffness - by_limit, by_limit, *damped], axis=1)


def _velocity(displacement: NDArray[np.float64], sample_time: float) -> NDArray[np.float64]:
    """Return the velocity [m/s] at the samples, to second order, as elements of the rolling model have it that move."""
    change = np.diff(displacement, prepend=displacement[0])
    before = np.concatenate([np.zeros_like(change[:1]), change[:-1]])
    return np.asarray((1.5 * change - 0.5 * before) / sample_time)


def _elements(
    task: IdentificationTask,
    model: ElementParameters,
    rows: Sequence[RegressionRows],
    residuals: Sequence[NDArray[np.float64]],
    gradients: Sequence[NDArray[np.float64]],
) -> ReportedElements:
    """Return the elements of non-negligible force, by ascending threshold, and the terms, with their covariance."""
    free = sum(term in SIGNED_TERMS for term in task.terms)
    count, damped = model.stiffness.size, model.damping.size
    scale = np.concatenate([model.stiffness, model.limit_force, model.damping, model.terms])
    scale[2 * count + damped : 2 * count + damped + free] = 1.0
    chosen = [np.isin(each.cycle, task.cycles) for each in rows]
    jacobian = np.concatenate([part[which] for part, which in zip(gradients, chosen, strict=True)])
    parts = [part[which] for part, which in zip(residuals, chosen, strict=True)]
    size = np.sqrt(np.add.reduce(jacobian**2, axis=0))
    size[size == 0] = 1.0
    inverse = pseudo_inverse(jacobian / size) * (scale / size)[:, None]
    covariance = inverse @ inverse.T * long_run_variance(parts, scale.size)
    order = np.argsort(model.thresholds)
    kept = order[model.limit_force[order] > NEGLIGIBLE_FORCE * model.limit_force.sum()]
    places = np.concatenate([kept, count + kept, 2 * count + kept[: kept.size if damped else 0]])
    places = np.concatenate([places, np.arange(2 * count + damped, scale.size)])
    covariance = covariance[np.ix_(places, places)]
    terms = dict(zip(task.terms, model.terms.tolist(), strict=True))
    if task.viscous is not None:
        terms["viscous"] = task.viscous
        covariance = np.pad(covariance, (0, 1))
    damping = model.damping[kept] if damped else np.empty(0)
    return ReportedElements(model.stiffness[kept], model.limit_force[kept], damping, terms, covariance)
