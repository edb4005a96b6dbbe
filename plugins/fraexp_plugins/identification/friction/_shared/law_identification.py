"""The base of the fits of friction laws with a Stribeck effect: nonlinear least squares on a record."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, Fit, FrictionModel, Metric, Motion, RecordError, Result, Signals, param
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE
from fraexp_plugins.identification._shared.levenberg_marquardt import IterationStep, Minimum, minimise
from fraexp_plugins.identification.friction._shared.friction_identification import IdentificationTask
from fraexp_plugins.identification.friction._shared.friction_record import FrictionRecord
from fraexp_plugins.identification.friction._shared.friction_regression import (
    SIGNED_TERMS,
    RegressionRows,
    long_run_variance,
    pseudo_inverse,
)
from fraexp_plugins.identification.friction._shared.friction_report import (
    MAX_CURVE_SAMPLES,
    TITLES,
    UNITS,
    ReportedElements,
    model_error_remarks,
    outcome_of_fit,
)
from fraexp_plugins.identification.friction._shared.grid_identification import GridIdentification

DIFFERENCE_STEP = 1e-5
"""Step of a logarithm over which differences are taken."""
START_VELOCITY_RATIOS = (0.3, 1.0, 3.0)
"""Stribeck velocities to start from, over the slowest tenth's sliding speed."""
TRIAL_STEPS = 20
"""Steps from each of them, after which only the best search goes on."""
MAX_LOGARITHM = 30.0
"""Magnitude of a logarithm at which a parameter has diverged."""
MAX_RELATIVE_STD = 2.0
"""Relative standard deviation from which a parameter is not identifiable."""


@dataclass(frozen=True)
class Guess:
    """Parameters in the search: logarithms of the law's parameters, and coefficients of the terms."""

    law: NDArray[np.float64]
    terms: NDArray[np.float64]


class LawIdentification(GridIdentification, ABC):
    """A fit of a whole friction law by nonlinear least squares, started from elements by linear least squares.

    Levenberg and Marquardt's method in the logarithms of the parameters, with differences of the law's force along the
    whole record, from several Stribeck velocities; mass, viscous friction and offset are fitted too.
    """

    max_iterations: int = param("1", "maximum number of steps", 100, at_least=1, at_most=100_000)

    @abstractmethod
    def start_parameters(self, found: ReportedElements, speed: float) -> NDArray[np.float64]:
        """Return the start logarithms, with a Stribeck velocity of `speed` [m/s]."""

    @abstractmethod
    def model(self, law: NDArray[np.float64], viscous: float) -> FrictionModel:
        """Return the friction model of these logarithms."""

    @abstractmethod
    def named_values(self, law: NDArray[np.float64]) -> Mapping[str, tuple[float, str]]:
        """Return name in the component, value and unit of each identified parameter."""

    def estimate(self, signals: Signals) -> Result:
        """Return the law's parameters, errors, forces and the fit."""
        # the law itself shows a spring or a Stribeck effect: no remarks on their effect on the elements
        task = self.focused_task(signals, spring_remarks=False)
        if "viscous" not in task.terms and task.viscous is None:
            raise RecordError(
                f"{self.name}: all sliding is at one speed, so the dependence of friction on the velocity is not "
                "identifiable; record several speeds, or use rolling_identification"
            )
        found, _, _ = self.solution(task)
        speed = _slow_speed(task)
        terms = np.array([found.terms[term] for term in task.terms])
        starts = [Guess(self.start_parameters(found, start * speed), terms) for start in START_VELOCITY_RATIOS]
        trials = [self._search(task, start, min(TRIAL_STEPS, self.max_iterations)).place for start in starts]
        nearest = min(trials, key=lambda guess: self._step(task, guess).cost)
        last = self._search(task, nearest, self.max_iterations)
        if last.iterations >= self.max_iterations:
            raise RecordError(
                f"{self.name} did not converge in {self.max_iterations} steps: the record does not suit this law; take "
                "rolling_identification, raise max_iterations, or record more speeds"
            )
        return self._report(signals, task, last.place)

    def _search(self, task: IdentificationTask, begin: Guess, max_steps: int) -> Minimum[Guess]:
        free = sum(term in SIGNED_TERMS for term in task.terms)

        def move(guess: Guess, step: NDArray[np.float64]) -> Guess:
            law = np.clip(guess.law + np.clip(step[: guess.law.size], -1, 1), -MAX_LOGARITHM, MAX_LOGARITHM)
            terms = guess.terms + step[guess.law.size :]
            terms[free:] = np.maximum(terms[free:], 0.0)
            return Guess(law, terms)

        return minimise(lambda guess: self._step(task, guess), move, begin, max_steps)

    def _step(self, task: IdentificationTask, guess: Guess) -> IterationStep[Guess]:
        rows = self._rows(task, [guess.law])
        chosen = [np.isin(each.cycle, task.cycles) for each in rows]

        def gradient() -> NDArray[np.float64]:
            _, _, gradients = self._linearise(task, guess)
            return np.concatenate([part[which] for part, which in zip(gradients, chosen, strict=True)])

        residuals = _residuals(rows, guess)
        return IterationStep(
            guess, np.concatenate([part[which] for part, which in zip(residuals, chosen, strict=True)]), gradient
        )

    def _rows(self, task: IdentificationTask, laws: Sequence[NDArray[np.float64]]) -> list[RegressionRows]:
        """Return rows with the columns of the terms and, after them, the force of each law."""
        forces = [_forces(self.model(law, 0.0), task.records) for law in laws]
        return task.rows_with([np.column_stack(parts) for parts in zip(*forces, strict=True)])

    def _linearise(
        self, task: IdentificationTask, guess: Guess
    ) -> tuple[list[RegressionRows], list[NDArray[np.float64]], list[NDArray[np.float64]]]:
        """Return rows, residuals [N] and the derivatives of the model, record by record."""
        rows = self._rows(task, [guess.law, *(guess.law + DIFFERENCE_STEP * row for row in np.eye(guess.law.size))])
        count = len(task.terms)
        gradients = [
            np.column_stack(
                [
                    (each.columns[:, count + 1 :] - each.columns[:, count : count + 1]) / DIFFERENCE_STEP,
                    each.columns[:, :count],
                ]
            )
            for each in rows
        ]
        return rows, _residuals(rows, guess), gradients

    def _report(self, signals: Signals, task: IdentificationTask, guess: Guess) -> Result:
        rows, residuals, _ = self._linearise(task, guess)
        errors = task.errors_from_residuals(rows, residuals)
        names, values, units, covariance = self._identified(task, guess)
        coulomb = float(values[names.index("coulomb_force")])
        mass = float(values[names.index("mass")]) if "mass" in names else 0.0
        covariance = covariance * task.inflation(rows, errors, coulomb, mass, values.size)
        deviations = np.sqrt(np.diag(covariance))
        loose = [n for n, v, d in zip(names, values, deviations, strict=True) if not d < MAX_RELATIVE_STD * abs(v)]
        loose = [name for name in loose if name not in SIGNED_TERMS]
        remarks = [signals.message] if signals.message else []
        remarks += list(task.remarks)
        if loose:
            remarks.append(
                f"not identifiable from this record: {', '.join(loose)}; vary the speed from presliding to sliding"
            )
        remarks += model_error_remarks(coulomb, errors.worst, task.noise(mass))
        metrics = [Metric("rms error, fitted cycles", errors.fitted, "N")]
        if np.isfinite(errors.held_out):
            metrics.append(Metric("rms error, held-out cycles", errors.held_out, "N"))
        for name, value, unit, deviation in zip(names, values, units, deviations, strict=True):
            title = TITLES.get(name, name.replace("_", " "))
            metrics += [
                Metric(title, float(value), unit),
                Metric(f"{title}, 95 %", NORMAL_QUANTILE * float(deviation), unit),
            ]
        viscous = self._viscous(task, guess)
        inside = [number for number, name in enumerate(names) if name not in ("offset", "asymmetry", "mass")]
        fit = Fit(
            "friction",
            self.model(guess.law, viscous).spec(),
            tuple("viscous_coefficient" if names[k] == "viscous" else names[k] for k in inside),
            tuple(units[k] for k in inside),
            values[inside],
            covariance[np.ix_(inside, inside)],
        )
        first = rows[0]
        time = first.duration * np.arange(first.force.size)
        table = np.stack([time, first.force, first.force - residuals[0]])[:, :MAX_CURVE_SAMPLES]
        curve = Curve("friction force", dict(zip(("time", "force", "model"), table, strict=True)), _CURVE_UNITS)
        outcome = outcome_of_fit(signals.outcome, coulomb, errors.worst)
        return Result(outcome, "; ".join(remarks), metrics=tuple(metrics), curves=(curve,), fits=(fit,))

    @staticmethod
    def _viscous(task: IdentificationTask, guess: Guess) -> float:
        if task.viscous is not None:
            return task.viscous
        return float(guess.terms[task.terms.index("viscous")])

    def _identified(self, task: IdentificationTask, guess: Guess) -> "_Identified":
        """Return the law's own parameters and the terms."""
        rows, residuals, gradients = self._linearise(task, guess)
        chosen = [np.isin(each.cycle, task.cycles) for each in rows]
        jacobian = np.concatenate([part[which] for part, which in zip(gradients, chosen, strict=True)])
        parts = [part[which] for part, which in zip(residuals, chosen, strict=True)]
        size = np.sqrt(np.add.reduce(jacobian**2, axis=0))
        size[size == 0] = 1.0
        inverse = pseudo_inverse(jacobian / size) / size[:, None]
        named = self.named_values(guess.law)
        values = np.array([value for value, _ in named.values()])
        slopes = np.zeros((values.size + guess.terms.size, guess.law.size + guess.terms.size))
        for column, row in enumerate(np.eye(guess.law.size)):
            shifted = np.array([value for value, _ in self.named_values(guess.law + DIFFERENCE_STEP * row).values()])
            slopes[: values.size, column] = (shifted - values) / DIFFERENCE_STEP
        slopes[values.size :, guess.law.size :] = np.eye(guess.terms.size)
        root = slopes @ inverse
        covariance = root @ root.T * long_run_variance(parts, root.shape[1])
        names = [*named, *task.terms]
        units = [unit for _, unit in named.values()] + [UNITS[term] for term in task.terms]
        return _Identified(names, np.concatenate([values, guess.terms]), units, covariance)


class _Identified(NamedTuple):
    """Identified parameters."""

    names: list[str]
    values: NDArray[np.float64]
    units: list[str]
    covariance: NDArray[np.float64]


_CURVE_UNITS = {"time": "s", "force": "N", "model": "N"}


def _residuals(rows: Sequence[RegressionRows], guess: Guess) -> list[NDArray[np.float64]]:
    """Return the measured force less that of the terms and of the law [N], record by record."""
    count = guess.terms.size
    return [each.force - each.columns[:, :count] @ guess.terms - each.columns[:, count] for each in rows]


def _forces(model: FrictionModel, records: Sequence[FrictionRecord]) -> list[NDArray[np.float64]]:
    """Return the law's force [N] along each record, from its state before the record."""
    motions = [
        Motion(record.displacement, record.sample_time, False, record.before, record.sample_time) for record in records
    ]
    return model.forces(motions)


def _slow_speed(task: IdentificationTask) -> float:
    """Return the speed [m/s] below which a tenth of the travel takes place."""
    speeds = np.sort(np.abs(np.concatenate([record.velocity() for record in task.records])))
    travel = np.cumsum(speeds)
    return float(speeds[np.searchsorted(travel, 0.1 * travel[-1])])
