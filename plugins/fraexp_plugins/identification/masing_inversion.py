"""The virgin curve from a hysteresis loop's branches, by Masing's rule."""

from typing import ClassVar

import numpy as np

from fraexp.api import RecordError, Result, Signals
from fraexp_plugins.identification.friction_identification import FrictionIdentification, IdentificationTask, coarse
from fraexp_plugins.identification.friction_record import Stretch
from fraexp_plugins.identification.friction_regression import Compressed, RegressionRows, long_run_variance
from fraexp_plugins.identification.friction_report import ReportedElements, report
from fraexp_plugins.identification.stop_operator import turning_points


class MasingInversion(FrictionIdentification, name="masing_inversion", version=2):
    """The virgin curve g(x) from branches after a reversal of full slip: |f - f_r| = 2 g(|y - y_r|/2).

    G. Masing, 1926; W. D. Iwan, J. Applied Mechanics 33(4), 1966, doi:10.1115/1.3625199. Each branch is fitted from
    its reversal on by 2 Σ K_i min(x/2, Y_i) with K_i ≥ 0, so the curve is concave, and with a constant of its own, so
    neither a bias nor its drift from branch to branch matters. Inner reversals, until the motion has passed them again,
    are left out. It shows what the loop's branches look like without believing in what happens within them; where the
    friction is not of Masing's kind, as with a Stribeck effect, the residual tells. Not to be used where inertia is in
    the force: the force must be the friction's own, or the motion slow.
    """

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses the frictionless machine with which it is tried here.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return the virgin curve and the elements that follow it."""
        if self.thrust:
            raise RecordError("masing_inversion takes the force as it is; give force = the thrust of a slow motion")
        task = self.task(signals)
        rows = self._rows(task)
        fitted = Compressed(rows, task.cycles)
        coefficients = fitted.solve(np.ones(task.thresholds.size, dtype=bool))
        force = coefficients * task.thresholds
        if not force.sum():
            raise RecordError("the branches do not rise with the motion; check the force's sign and channel")
        residuals = [each.force - each.columns @ coefficients for each in rows]
        chosen = [part[np.isin(each.cycle, task.cycles)] for part, each in zip(residuals, rows, strict=True)]
        active = coefficients > 0
        covariance = fitted.inverse(active) * long_run_variance(chosen, int(active.sum()))
        found = _elements(task, coefficients, covariance)
        deflection = found.coulomb[0] / float(found.stiffness.sum())
        remarks = [*task.remarks, *coarse(task.resolution, deflection)]
        cycles = (task.cycles.size, task.held_out.size)
        errors = task.errors_of(rows, residuals)
        found, against = task.judged(found, rows, errors)
        return report(signals, found, rows, errors, cycles, [*remarks, *against], whole=False)

    @staticmethod
    def _rows(task: IdentificationTask) -> list[RegressionRows]:
        """Return the branches, each without its mean: its own constant drops out."""
        widest = float(task.thresholds.max())
        found = [rows for stretch in task.stretches for rows in _branches(stretch, task.thresholds, widest)]
        if not found:
            raise RecordError(
                f"no branch is as long as twice the widest threshold, {widest:.3g} m, on both sides of its reversal; "
                "record a wider motion, or lower widest"
            )
        if task.viscous:
            found = [_without(rows, task.viscous * (rows.velocity - rows.velocity.mean())) for rows in found]
        return found


def _branches(stretch: Stretch, thresholds: np.ndarray, widest: float) -> list[RegressionRows]:
    motion = np.concatenate([stretch.before, stretch.displacement])
    skipped = stretch.before.size
    force = np.concatenate([stretch.force if skipped else np.empty(0), stretch.force])
    cycle = np.concatenate([stretch.cycle if skipped else np.empty(0, dtype=int), stretch.cycle])
    speed = stretch.velocity()
    velocity = np.concatenate([speed if skipped else np.empty(0), speed])
    turns = turning_points(motion, 2 * widest).tolist()
    found = []
    for begin, end in zip(turns, [*turns[1:], motion.size], strict=True):
        way = np.abs(motion[begin:end] - motion[begin])
        ahead = begin + np.flatnonzero(way >= np.maximum.accumulate(way))
        ahead = ahead[ahead >= skipped]
        if ahead.size < 2:
            continue
        direction = np.sign(motion[ahead[-1]] - motion[begin])
        columns = 2 * np.minimum(np.abs(motion[ahead] - motion[begin])[:, None] / 2, thresholds)
        names = tuple(f"element {number}" for number in range(thresholds.size))
        goal = direction * force[ahead]
        found.append(
            RegressionRows(
                names,
                columns - columns.mean(axis=0),
                goal - goal.mean(),
                direction * velocity[ahead],
                stretch.sample_time,
                cycle[ahead],
            )
        )
    return found


def _without(rows: RegressionRows, force: np.ndarray) -> RegressionRows:
    return RegressionRows(rows.names, rows.columns, rows.force - force, rows.velocity, rows.duration, rows.cycle)


def _elements(task: IdentificationTask, coefficients: np.ndarray, covariance: np.ndarray) -> ReportedElements:
    kept = np.flatnonzero(coefficients > 0)
    widths = task.thresholds[kept]
    inner = covariance[np.ix_(kept, kept)]
    outer = np.block([[inner, inner * widths], [widths[:, None] * inner, np.outer(widths, widths) * inner]])
    terms = {} if task.viscous is None else {"viscous": task.viscous}
    full = np.pad(outer, (0, len(terms)))
    return ReportedElements(coefficients[kept], coefficients[kept] * widths, np.empty(0), terms, full)
