"""Rolling friction by back-propagation through time: stiffness, damping and limit of every element at once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fraexp.api import FrictionModel, ParameterError, RecordError, Result, Signals, param
from fraexp_plugins.friction.elements import ElementModel
from fraexp_plugins.identification.friction_identification import IdentificationTask, coarse
from fraexp_plugins.identification.friction_record import Stretch
from fraexp_plugins.identification.friction_regression import FREE, RegressionRows, long_run_variance, pseudo_inverse
from fraexp_plugins.identification.friction_report import ReportedElements, report
from fraexp_plugins.identification.grid_identification import GridIdentification
from fraexp_plugins.identification.marquardt import IterationStep, minimised
from fraexp_plugins.identification.stop_operator import threshold_sensitivity

NOTHING = 1e-6
"""Share of the Coulomb force below which an element, or a term at the greatest speed, starts and ends as none."""


@dataclass(frozen=True)
class Model:
    """Elements and terms while they are sought."""

    stiffness: np.ndarray
    """K_i [N/m], shape (N,)."""
    limit_force: np.ndarray
    """F_mi [N], shape (N,)."""
    damping: np.ndarray
    """D_i [N s/m], shape (N,), or empty."""
    terms: np.ndarray
    """Coefficients of the task's terms."""

    @property
    def thresholds(self) -> np.ndarray:
        """Y_mi [m], eq (8)."""
        return self.limit_force / self.stiffness

    def moved(self, step: np.ndarray, free: int, widest: float) -> "Model":
        """Return the model after a step of logarithms, of the `free` first terms themselves."""
        count, damped = self.stiffness.size, self.damping.size
        growth = np.exp(np.clip(step, -5, 5))
        terms = self.terms.copy()
        last = step[2 * count + damped :]
        terms[:free] += last[:free]
        terms[free:] *= np.exp(np.clip(last[free:], -5, 5))
        stiffness = self.stiffness * growth[:count]
        return Model(
            stiffness,
            np.minimum(self.limit_force * growth[count : 2 * count], stiffness * widest),
            self.damping * growth[2 * count : 2 * count + damped],
            terms,
        )


class BackPropagation(GridIdentification, name="back_propagation", version=2):
    """The paper's identification: K_i, D_i and F_mi that make the squared error of the force least (section V-A).

    The gradient goes through the whole record: ∂f_i/∂K_i = z_i - s_i Y_mi and ∂f_i/∂F_mi = s_i, where s_i is the
    direction of the element's last slip, remembered while it sticks. It is computed forward in time, which is exact
    and the same as back-propagation (R. J. Williams and D. Zipser, Neural Computation 1(2), 1989,
    doi:10.1162/neco.1989.1.2.270), and is followed by Levenberg and Marquardt's method (D. W. Marquardt, J. SIAM
    11(2), 1963, doi:10.1137/0111030) in the logarithms in place of the steepest descent, which takes thousands of
    steps. Without a `start` it begins with the elements of `rolling_identification`, whose thresholds it sets free.

    Not convex: from a start of one's own it may end in a worse place; compare the held-out errors. Its bands believe in
    the number of elements: of a smooth virgin curve, for which there is none, they hold some 89 %. Not to be used with
    more elements than the record tells apart: their covariance says so.
    """

    start: FrictionModel | None = param("", "rolling model to start from; least squares on a grid if absent", None)
    damped: bool = param("", "whether the elements' viscous coefficients D_i are identified too", False)
    iterations: int = param("1", "steps at most", 300, at_least=1, at_most=100_000)

    def model_post_init(self, context: object) -> None:
        """Check the start."""
        super().model_post_init(context)
        if self.start is not None and not isinstance(self.start, ElementModel):
            raise ParameterError(f"back_propagation.start is {self.start.name}; expected a model of elements: rolling")

    def estimate(self, signals: Signals) -> Result:
        """Return elements, terms, errors, virgin curve and the rolling model."""
        task = self.task(signals) if self.start else self.focused(signals)
        if isinstance(self.start, ElementModel):
            task = replace(task, thresholds=np.union1d(self.start.limit_deflection, task.thresholds[-1:]))
        begin = self._begin(task)
        if self.damped:  # the springs first: damping that has to stand in for them leads astray
            springs = self._descended(task, replace(begin, damping=np.empty(0)))
            begin = replace(springs, damping=begin.damping)
        last = self._descended(task, begin)
        rows, residuals, gradients = _seen(task, last)
        found = _elements(task, last, rows, residuals, gradients)
        deflection = found.coulomb[0] / float(found.stiffness.sum())
        remarks = [*task.remarks, *coarse(task.resolution, deflection)]
        cycles = (task.cycles.size, task.held_out.size)
        errors = task.errors_of(rows, residuals)
        found, against = task.judged(found, rows, errors)
        return report(signals, found, rows, errors, cycles, [*remarks, *against])

    def _begin(self, task: IdentificationTask) -> Model:
        """Return the start, with small coefficients in place of none: a logarithm does not leave minus infinity."""
        if isinstance(self.start, ElementModel):
            stiffness, limit_force = (np.array(part) for part in self.start.elements)
            damping = np.array(self.start.damping)
            terms = [self.start.viscous if term == "viscous" else 0.0 for term in task.terms]
        else:
            found, _, _ = self.solution(task)
            stiffness, limit_force, damping = found.stiffness, found.limit_force, np.empty(0)
            terms = [found.terms[term] for term in task.terms]
        speed = max(float(np.abs(stretch.velocity()).max()) for stretch in task.stretches)
        least = NOTHING * float(limit_force.sum())
        if self.damped:
            scale = np.full(stiffness.size, least / speed / stiffness.size * 1e3)
            damping = np.maximum(damping, scale) if damping.size else scale
        floors = {"viscous": least / speed, "mass": least * min(s.sample_time for s in task.stretches) / speed}
        terms = [max(value, floors.get(term, -np.inf)) for term, value in zip(task.terms, terms, strict=True)]
        return Model(stiffness, limit_force, damping if self.damped else np.empty(0), np.array(terms))

    def _descended(self, task: IdentificationTask, begin: Model) -> Model:
        """Return where the descent ends."""
        free = sum(term in FREE for term in task.terms)
        limit = float(task.thresholds.max())

        def step_of(model: Model) -> IterationStep[Model]:
            rows, residuals, gradients = _seen(task, model)
            chosen = [np.isin(each.cycle, task.cycles) for each in rows]
            return IterationStep(
                model,
                np.concatenate([part[which] for part, which in zip(residuals, chosen, strict=True)]),
                np.concatenate([part[which] for part, which in zip(gradients, chosen, strict=True)]),
            )

        last, steps = minimised(step_of, lambda model, step: model.moved(step, free, limit), begin, self.iterations)
        if steps >= self.iterations:
            raise RecordError(
                f"back_propagation did not converge in {self.iterations} steps; raise iterations, "
                "or give fewer elements"
            )
        return last


def _seen(task: IdentificationTask, model: Model) -> tuple[list[RegressionRows], list[np.ndarray], list[np.ndarray]]:
    """Return rows, residuals [N] and the residuals' negative gradients, stretch by stretch."""
    columns = [_responses(stretch, task.deflections(stretch, model.thresholds), model) for stretch in task.stretches]
    rows = task.rows_with(columns)
    count, free = len(task.terms), sum(term in FREE for term in task.terms)
    scale = np.where(np.arange(count) < free, 1.0, model.terms)
    residuals = [each.force - each.columns[:, :count] @ model.terms - each.columns[:, count] for each in rows]
    gradients = [np.column_stack([each.columns[:, count + 1 :], each.columns[:, :count] * scale]) for each in rows]
    return rows, residuals, gradients


def _responses(stretch: Stretch, deflection: np.ndarray, model: Model) -> np.ndarray:
    """Return the elements' force [N] and its derivatives by log K_i, log F_mi and log D_i, shape (n, 1 + 2N or 3N)."""
    thresholds, stiffness = model.thresholds, model.stiffness
    direction = threshold_sensitivity(deflection, thresholds)
    force, by_stiffness, by_threshold = stiffness * deflection, deflection, stiffness * direction
    damped: tuple[np.ndarray, ...] = ()
    if model.damping.size:
        rate, turning = _rate(deflection, stretch.sample_time), _rate(direction, stretch.sample_time)
        force = force + model.damping * rate
        most = stiffness * thresholds
        limited = np.abs(force) >= most
        side = np.sign(force)
        force = np.clip(force, -most, most)
        by_stiffness = np.where(limited, side * thresholds, by_stiffness)
        by_threshold = np.where(limited, side * stiffness, by_threshold + model.damping * turning)
        damped = (np.where(limited, 0.0, model.damping * rate),)
    by_limit = thresholds * by_threshold
    total = np.add.reduce(force, axis=1)[:, None]
    return np.concatenate([total, stiffness * by_stiffness - by_limit, by_limit, *damped], axis=1)


def _rate(deflection: np.ndarray, sample_time: float) -> np.ndarray:
    """Return dy_i/dt [m/s] at the samples, to second order, as the rolling model takes it."""
    change = np.diff(deflection, axis=0, prepend=deflection[:1])
    before = np.concatenate([np.zeros_like(change[:1]), change[:-1]])
    rate: np.ndarray = (1.5 * change - 0.5 * before) / sample_time
    return rate


def _elements(
    task: IdentificationTask,
    model: Model,
    rows: Sequence[RegressionRows],
    residuals: Sequence[np.ndarray],
    gradients: Sequence[np.ndarray],
) -> ReportedElements:
    """Return the elements that are more than nothing, by ascending threshold, and the terms, with their covariance."""
    free = sum(term in FREE for term in task.terms)
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
    kept = order[model.limit_force[order] > NOTHING * model.limit_force.sum()]
    places = np.concatenate([kept, count + kept, 2 * count + kept[: kept.size if damped else 0]])
    places = np.concatenate([places, np.arange(2 * count + damped, scale.size)])
    covariance = covariance[np.ix_(places, places)]
    terms = dict(zip(task.terms, model.terms.tolist(), strict=True))
    if task.viscous is not None:
        terms["viscous"] = task.viscous
        covariance = np.pad(covariance, (0, 1))
    damping = model.damping[kept] if damped else np.empty(0)
    return ReportedElements(model.stiffness[kept], model.limit_force[kept], damping, terms, covariance)
