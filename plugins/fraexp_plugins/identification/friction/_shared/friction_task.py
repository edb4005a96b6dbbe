"""What an identification of friction fits (records, thresholds, terms, held-out cycles), and the errors left."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE
from fraexp_plugins.identification._shared.stop_operator import stop_operators, turning_points
from fraexp_plugins.identification.friction._shared.friction_record import (
    FrictionRecord,
)
from fraexp_plugins.identification.friction._shared.friction_regression import (
    CompressedRows,
    Observation,
    RegressionRows,
    long_run_variance,
    misfit_variance,
    regression_rows,
)
from fraexp_plugins.identification.friction._shared.friction_report import (
    Errors,
    ReportedElements,
    has_model_error,
    model_error_remarks,
)

STANDSTILL_SPEED_RATIO = 0.3
"""Speed over that of sliding below which the machine turns: a jump of friction looks like inertia there."""
MIN_ROWS = 60
"""Rows that a regression needs."""


@dataclass(frozen=True)
class IdentificationTask:
    """Records, observation, thresholds and terms of an identification."""

    records: tuple[FrictionRecord, ...]
    observation: Observation
    terms: tuple[str, ...]
    """Terms that are fitted with the elements, those of either sign first."""
    thresholds: NDArray[np.float64]
    """Y_i of the grid [m], ascending, shape (N,)."""
    viscous: float | None
    """Known viscous coefficient [N s/m], or None."""
    resolution: float
    """Quantisation step of the encoder [m]; 0 if it is ideal."""
    held_out: NDArray[np.int64]
    """Numbers of the cycles that are held out."""
    cycles: NDArray[np.int64]
    """Numbers of the cycles that are fitted."""
    remarks: tuple[str, ...]
    speed: float | None = None
    """The speed of all sliding [m/s] if there is only one."""

    def rows(self, thresholds: NDArray[np.float64]) -> list[RegressionRows]:
        """Return the rows of all records for elements with these thresholds [m], shape (N,)."""
        elements = [self.deflections(record, thresholds) for record in self.records]
        return self.rows_with(elements)

    def deflections(self, record: FrictionRecord, thresholds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the elements' deflections [m] along a record, shape (n, N)."""
        motion = np.concatenate([record.before, record.displacement])
        return stop_operators(motion, thresholds)[record.before.size :]

    def rows_with(self, elements: Sequence[NDArray[np.float64]]) -> list[RegressionRows]:
        """Return the rows of all records with these columns of elements, each (n, N)."""
        max_threshold = float(self.thresholds.max())
        rows = [
            regression_rows(record, self.observation, self.terms, columns, record.first_known_sample(max_threshold))
            for record, columns in zip(self.records, elements, strict=True)
        ]
        if self.viscous:
            rows = [self._without_viscous(*pair) for pair in zip(rows, self.records, strict=True)]
        rows = [each for each in rows if each.force.size]
        if sum(each.force.size for each in rows) < MIN_ROWS:
            raise RecordError(
                f"the motion never spans twice the largest threshold, {max_threshold:.3g} m, for long enough; record "
                "more cycles with gross sliding, or lower max_threshold"
            )
        return rows

    def _without_viscous(self, rows: RegressionRows, record: FrictionRecord) -> RegressionRows:
        known = self.observation.friction(record, record.velocity()[:, None])
        max_threshold = float(self.thresholds.max())
        known = self.observation.known_rows(record, known, record.first_known_sample(max_threshold))
        return replace(rows, force=rows.force - (self.viscous or 0.0) * known[:, 0])

    @property
    def least_error(self) -> float:
        """Root mean square error [N] with all elements of the grid."""
        rows = self.rows(self.thresholds)
        compressed = CompressedRows(rows, self.cycles)
        solution = compressed.solve(np.ones(rows[0].columns.shape[1], dtype=bool))
        return float(np.sqrt(compressed.mean_square(solution)))

    def noise(self, mass: float) -> float:
        """Return the error [N] by noise of the channels."""
        return max(self.observation.noise(record, mass) for record in self.records)

    def inflation(
        self, rows: Sequence[RegressionRows], errors: Errors, coulomb: float, mass: float, count: int
    ) -> float:
        """Return the factor on a covariance of `count` parameters for errors of the model; 1 if noise explains them."""
        if not has_model_error(coulomb, errors.worst, self.noise(mass)):
            return 1.0
        chosen = [np.isin(each.cycle, self.cycles) for each in rows]
        parts = [residual[which] for residual, which in zip(errors.residuals, chosen, strict=True)]
        size = sum(part.size for part in parts)
        return max(misfit_variance(size, count, errors.fitted) / long_run_variance(parts, count), 1.0)

    def with_model_error(
        self, found: ReportedElements, rows: Sequence[RegressionRows], errors: Errors
    ) -> tuple[ReportedElements, list[str]]:
        """Return the elements with the model's errors in their covariance, and remarks on these errors."""
        coulomb, mass = found.coulomb[0], found.terms.get("mass", 0.0)
        count = found.stiffness.size + len(self.terms)
        covariance = found.covariance * self.inflation(rows, errors, coulomb, mass, count)
        if mass and self.speed is not None:  # friction jumps at an unknown time while the machine stands
            place = len(covariance) - len(found.terms) + list(found.terms).index("mass")
            delay = max(_standstill_time(record, self.speed) for record in self.records)
            covariance[place, place] += (coulomb * delay / self.speed / NORMAL_QUANTILE) ** 2
        return replace(found, covariance=covariance), model_error_remarks(coulomb, errors.worst, self.noise(mass))

    def errors(self, rows: Sequence[RegressionRows], residuals: Sequence[NDArray[np.float64]]) -> Errors:
        """Return the errors from the residuals [N] of each record."""
        labels = np.concatenate([each.cycle for each in rows])
        squared = np.concatenate(residuals) ** 2
        held = np.isin(labels, self.held_out)
        parts = [squared[~held], squared[held]]
        fitted, held_out = (float(np.sqrt(np.add.reduce(p) / p.size)) if p.size else np.nan for p in parts)
        return Errors(fitted, held_out, residuals)


def _standstill_time(record: FrictionRecord, speed: float) -> float:
    """Return the standstill time at a reversal of a motion at this speed [m/s], plus one sample [s]."""
    turns = turning_points(record.displacement, speed * record.sample_time).size
    slow = int(np.sum(np.abs(record.velocity()) < STANDSTILL_SPEED_RATIO * speed))
    return (1 + slow / max(turns, 1)) * record.sample_time
