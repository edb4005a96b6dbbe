"""What the fits of friction laws with a Stribeck effect have in common: nonlinear least squares on a record."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fraexp.api import Curve, Fit, FrictionModel, Metric, Motion, RecordError, Result, Signals, param
from fraexp_plugins.identification.friction_identification import IdentificationTask
from fraexp_plugins.identification.friction_record import Stretch
from fraexp_plugins.identification.friction_regression import FREE, RegressionRows, long_run_variance, pseudo_inverse
from fraexp_plugins.identification.friction_report import (
    MOST_DRAWN,
    NORMAL,
    TITLES,
    UNITS,
    ReportedElements,
    unexplained,
)
from fraexp_plugins.identification.grid_identification import GridIdentification
from fraexp_plugins.identification.marquardt import IterationStep, minimised

NEAR = 1e-5
"""Step of a logarithm over which differences are taken."""
STARTS = (0.3, 1.0, 3.0)
"""Stribeck velocities to start from, over the slowest tenth's sliding speed."""
BOUND = 30.0
"""Logarithms beyond which a parameter has run away."""
LOOSE = 2.0
"""Relative standard deviation from which a parameter is not told by the record."""


@dataclass(frozen=True)
class Guess:
    """A place of the search: logarithms of the law's parameters, and the terms' coefficients."""

    law: np.ndarray
    terms: np.ndarray


class LawIdentification(GridIdentification, ABC):
    """A fit of a whole friction law by nonlinear least squares, started from elements found by linear ones.

    Levenberg and Marquardt's method in the logarithms of the parameters, with differences of the law's force along the
    whole record, from several Stribeck velocities; mass, viscous friction and offset are fitted along.
    """

    iterations: int = param("1", "steps at most, from each start", 100, at_least=1, at_most=100_000)

    @abstractmethod
    def begin(self, found: ReportedElements, speed: float) -> np.ndarray:
        """Return the logarithms to start from, with a Stribeck velocity of `speed` [m/s]."""

    @abstractmethod
    def model(self, law: np.ndarray, viscous: float) -> FrictionModel:
        """Return the friction model of these logarithms."""

    @abstractmethod
    def natural(self, law: np.ndarray) -> Mapping[str, tuple[float, str]]:
        """Return name in the component, value and unit of each parameter that is identified."""

    def estimate(self, signals: Signals) -> Result:
        """Return the law's parameters, errors, forces and the fit."""
        # what a spring or a Stribeck effect does to the elements is for the law to tell
        task = replace(self.focused(signals), remarks=self.task(signals).remarks)
        if "viscous" not in task.terms and task.viscous is None:
            raise RecordError(
                f"all sliding is at one speed: {self.name} cannot tell how friction depends on it; record several "
                "speeds, or use rolling_identification"
            )
        found, _, _ = self.solution(task)
        speed = _slow(task)
        terms = np.array([found.terms[term] for term in task.terms])
        tried = [self._search(task, Guess(self.begin(found, start * speed), terms)) for start in STARTS]
        ended = [guess for guess, steps in tried if steps < self.iterations]
        if not ended:
            raise RecordError(
                f"{self.name} did not converge in {self.iterations} steps from any start; raise iterations, or record "
                "more speeds"
            )
        best = min(ended, key=lambda guess: self._step(task, guess).cost)
        return self._report(signals, task, best)

    def _search(self, task: IdentificationTask, begin: Guess) -> tuple[Guess, int]:
        free = sum(term in FREE for term in task.terms)

        def moved(guess: Guess, step: np.ndarray) -> Guess:
            law = np.clip(guess.law + np.clip(step[: guess.law.size], -1, 1), -BOUND, BOUND)
            terms = guess.terms + step[guess.law.size :]
            terms[free:] = np.maximum(terms[free:], 0.0)
            return Guess(law, terms)

        return minimised(lambda guess: self._step(task, guess), moved, begin, self.iterations)

    def _step(self, task: IdentificationTask, guess: Guess) -> IterationStep[Guess]:
        rows, residuals, gradients = self._seen(task, guess)
        chosen = [np.isin(each.cycle, task.cycles) for each in rows]
        return IterationStep(
            guess,
            np.concatenate([part[which] for part, which in zip(residuals, chosen, strict=True)]),
            np.concatenate([part[which] for part, which in zip(gradients, chosen, strict=True)]),
        )

    def _seen(
        self, task: IdentificationTask, guess: Guess
    ) -> tuple[list[RegressionRows], list[np.ndarray], list[np.ndarray]]:
        """Return rows, residuals [N] and the derivatives of the model, stretch by stretch."""
        near = [guess.law, *(guess.law + NEAR * row for row in np.eye(guess.law.size))]
        forces = [_forces(self.model(law, 0.0), task.stretches) for law in near]
        columns = [np.column_stack(parts) for parts in zip(*forces, strict=True)]
        rows = task.rows_with(columns)
        count = len(task.terms)
        residuals = [each.force - each.columns[:, :count] @ guess.terms - each.columns[:, count] for each in rows]
        gradients = [
            np.column_stack(
                [
                    (each.columns[:, count + 1 :] - each.columns[:, count : count + 1]) / NEAR,
                    each.columns[:, :count],
                ]
            )
            for each in rows
        ]
        return rows, residuals, gradients

    def _report(self, signals: Signals, task: IdentificationTask, guess: Guess) -> Result:
        rows, residuals, _ = self._seen(task, guess)
        errors = task.errors_of(rows, residuals)
        names, values, units, covariance = self._identified(task, guess)
        coulomb = float(values[names.index("coulomb")])
        mass = float(values[names.index("mass")]) if "mass" in names else 0.0
        covariance = covariance * task.inflation(rows, errors, coulomb, mass, values.size)
        deviations = np.sqrt(np.diag(covariance))
        loose = [n for n, v, d in zip(names, values, deviations, strict=True) if not d < LOOSE * abs(v)]
        loose = [name for name in loose if name not in FREE]
        remarks = [signals.message] if signals.message else []
        remarks += list(task.remarks)
        if loose:
            remarks.append(f"the record does not tell {', '.join(loose)}: vary the speed from presliding to sliding")
        remarks += unexplained(coulomb, errors.worst, task.noise(mass))
        metrics = [Metric("rms error, fitted cycles", errors.fitted, "N")]
        if np.isfinite(errors.held_out):
            metrics.append(Metric("rms error, held-out cycles", errors.held_out, "N"))
        for name, value, unit, deviation in zip(names, values, units, deviations, strict=True):
            title = TITLES.get(name, name.replace("_", " "))
            metrics += [Metric(title, float(value), unit), Metric(f"{title}, 95 %", NORMAL * float(deviation), unit)]
        viscous = self._viscous(task, guess)
        inside = [number for number, name in enumerate(names) if name not in ("offset", "asymmetry", "mass")]
        renamed = {"viscous": "sigma2" if "sigma2" in type(self.model(guess.law, 0.0)).model_fields else ""}
        fit = Fit(
            "friction",
            self.model(guess.law, viscous).spec(),
            tuple(renamed.get(names[k], names[k]) or "viscous_coefficient" for k in inside),
            tuple(units[k] for k in inside),
            values[inside],
            covariance[np.ix_(inside, inside)],
        )
        first = rows[0]
        time = first.duration * np.arange(first.force.size)
        table = np.stack([time, first.force, first.force - residuals[0]])[:, :MOST_DRAWN]
        curve = Curve("friction force", dict(zip(("time", "force", "model"), table, strict=True)), _CURVE_UNITS)
        return Result(signals.outcome, "; ".join(remarks), metrics=tuple(metrics), curves=(curve,), fits=(fit,))

    @staticmethod
    def _viscous(task: IdentificationTask, guess: Guess) -> float:
        if task.viscous is not None:
            return task.viscous
        return float(guess.terms[task.terms.index("viscous")])

    def _identified(
        self, task: IdentificationTask, guess: Guess
    ) -> tuple[list[str], np.ndarray, list[str], np.ndarray]:
        """Return names, values, units and covariance of the law's own parameters and of the terms."""
        rows, residuals, gradients = self._seen(task, guess)
        chosen = [np.isin(each.cycle, task.cycles) for each in rows]
        jacobian = np.concatenate([part[which] for part, which in zip(gradients, chosen, strict=True)])
        parts = [part[which] for part, which in zip(residuals, chosen, strict=True)]
        size = np.sqrt(np.add.reduce(jacobian**2, axis=0))
        size[size == 0] = 1.0
        inverse = pseudo_inverse(jacobian / size) / size[:, None]
        named = self.natural(guess.law)
        values = np.array([value for value, _ in named.values()])
        slopes = np.zeros((values.size + guess.terms.size, guess.law.size + guess.terms.size))
        for column, row in enumerate(np.eye(guess.law.size)):
            there = np.array([value for value, _ in self.natural(guess.law + NEAR * row).values()])
            slopes[: values.size, column] = (there - values) / NEAR
        slopes[values.size :, guess.law.size :] = np.eye(guess.terms.size)
        root = slopes @ inverse
        covariance = root @ root.T * long_run_variance(parts, root.shape[1])
        names = [*named, *task.terms]
        units = [unit for _, unit in named.values()] + [UNITS[term] for term in task.terms]
        return names, np.concatenate([values, guess.terms]), units, covariance


_CURVE_UNITS = {"time": "s", "force": "N", "model": "N"}


def _forces(model: FrictionModel, stretches: Sequence[Stretch]) -> list[np.ndarray]:
    """Return the law's force [N] along each stretch, after what came before it."""
    motions = [
        Motion(stretch.displacement, stretch.sample_time, False, stretch.before, stretch.sample_time)
        for stretch in stretches
    ]
    return model.forces(motions)


def _slow(task: IdentificationTask) -> float:
    """Return the speed [m/s] below which a tenth of the way is gone."""
    speeds = np.sort(np.abs(np.concatenate([stretch.velocity() for stretch in task.stretches])))
    way = np.cumsum(speeds)
    return float(speeds[np.searchsorted(way, 0.1 * way[-1])])
