"""The virgin curve from a hysteresis loop's branches, by Masing's rule."""

from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, Result, Signals
from fraexp_plugins.identification._shared.stop_operator import turning_points
from fraexp_plugins.identification.friction._shared.friction_identification import (
    FrictionIdentification,
    IdentificationTask,
    resolution_remarks,
)
from fraexp_plugins.identification.friction._shared.friction_record import FrictionRecord
from fraexp_plugins.identification.friction._shared.friction_regression import (
    CompressedRows,
    RegressionRows,
    long_run_variance,
)
from fraexp_plugins.identification.friction._shared.friction_report import ReportedElements, report


class MasingInversion(FrictionIdentification, name="masing_inversion", version=2):
    """The virgin curve g(x) from branches after a reversal in gross sliding: |f - f_r| = 2 g(|y - y_r|/2).

    G. Masing, 1926; W. D. Iwan, J. Applied Mechanics 33(4), 1966, doi:10.1115/1.3625199. Each branch is fitted from
    its reversal on by 2 Σ K_i min(x/2, Y_i) with K_i ≥ 0, so that the curve is concave, and with a constant of its own,
    so that neither a bias nor its drift has an effect. Inner reversals are left out, until the motion has passed them
    again. It shows the branches of the loop without assumptions on the motion inside. A large residual shows friction
    that is not of Masing's kind, as with a Stribeck effect. Do not use it if the force includes inertia: the force must
    be that of friction, or the motion slow.
    """

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses the frictionless machine with which it is tried here.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return the virgin curve and the elements that follow it."""
        if self.thrust:
            raise RecordError(
                "masing_inversion.thrust: expected none, since inertia is not removed; set force to the thrust of a "
                "slow motion instead"
            )
        task = self.task(signals)
        rows = self._rows(task)
        fitted = CompressedRows(rows, task.cycles)
        coefficients = fitted.solve(np.ones(task.thresholds.size, dtype=bool))
        force = coefficients * task.thresholds
        if not force.sum():
            raise RecordError("the branches do not rise with the motion; check the force's sign and channel")
        residuals = [each.force - each.columns @ coefficients for each in rows]
        chosen = [part[np.isin(each.cycle, task.cycles)] for part, each in zip(residuals, rows, strict=True)]
        used = coefficients > 0
        covariance = fitted.inverse(used) * long_run_variance(chosen, int(used.sum()))
        found = _elements(task, coefficients, covariance)
        deflection = found.coulomb[0] / float(found.stiffness.sum())
        remarks = [*task.remarks, *resolution_remarks(task.resolution, deflection)]
        cycles = (task.cycles.size, task.held_out.size)
        errors = task.errors_from_residuals(rows, residuals)
        found, doubts = task.with_model_error(found, rows, errors)
        return report(signals, found, rows, errors, cycles, [*remarks, *doubts], whole=False)

    @staticmethod
    def _rows(task: IdentificationTask) -> list[RegressionRows]:
        """Return the branches, each without its mean, which removes its constant."""
        max_threshold = float(task.thresholds.max())
        found = [rows for record in task.records for rows in _branches(record, task.thresholds, max_threshold)]
        if not found:
            raise RecordError(
                f"no branch is as long as twice the largest threshold, {max_threshold:.3g} m, on both sides of its "
                "reversal; record a wider motion, or lower max_threshold"
            )
        if task.viscous:
            found = [_without_force(rows, task.viscous * (rows.velocity - rows.velocity.mean())) for rows in found]
        return found


def _branches(record: FrictionRecord, thresholds: NDArray[np.float64], max_threshold: float) -> list[RegressionRows]:
    motion = np.concatenate([record.before, record.displacement])
    skipped = record.before.size
    force = np.concatenate([record.force if skipped else np.empty(0), record.force])
    cycle = np.concatenate([record.cycle if skipped else np.empty(0, dtype=int), record.cycle])
    speed = record.velocity()
    velocity = np.concatenate([speed if skipped else np.empty(0), speed])
    turns = turning_points(motion, 2 * max_threshold).tolist()
    found = []
    for begin, end in pairwise([*turns, motion.size]):
        travel = np.abs(motion[begin:end] - motion[begin])
        outer = begin + np.flatnonzero(travel >= np.maximum.accumulate(travel))
        outer = outer[outer >= skipped]
        if outer.size < 2:
            continue
        direction = np.sign(motion[outer[-1]] - motion[begin])
        columns = 2 * np.minimum(np.abs(motion[outer] - motion[begin])[:, None] / 2, thresholds)
        names = tuple(f"element {number}" for number in range(thresholds.size))
        target = direction * force[outer]
        found.append(
            RegressionRows(
                names,
                columns - columns.mean(axis=0),
                target - target.mean(),
                direction * velocity[outer],
                record.sample_time,
                cycle[outer],
            )
        )
    return found


def _without_force(rows: RegressionRows, force: NDArray[np.float64]) -> RegressionRows:
    return RegressionRows(rows.names, rows.columns, rows.force - force, rows.velocity, rows.duration, rows.cycle)


def _elements(
    task: IdentificationTask, coefficients: NDArray[np.float64], covariance: NDArray[np.float64]
) -> ReportedElements:
    kept = np.flatnonzero(coefficients > 0)
    widths = task.thresholds[kept]
    inner = covariance[np.ix_(kept, kept)]
    outer = np.block([[inner, inner * widths], [widths[:, None] * inner, np.outer(widths, widths) * inner]])
    terms = {} if task.viscous is None else {"viscous": task.viscous}
    full = np.pad(outer, (0, len(terms)))
    return ReportedElements(coefficients[kept], coefficients[kept] * widths, np.empty(0), terms, full)
