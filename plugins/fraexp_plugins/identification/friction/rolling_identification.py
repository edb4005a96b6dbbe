"""Rolling friction from a record, by non-negative least squares on stop operators."""

from fraexp.api import Result, Signals
from fraexp_plugins.identification.friction._shared.friction_identification import resolution_remarks
from fraexp_plugins.identification.friction._shared.friction_report import report
from fraexp_plugins.identification.friction._shared.grid_identification import GridIdentification


class RollingIdentification(GridIdentification, name="rolling_identification", version=2):
    """Elements of rolling friction by non-negative least squares: min ‖f - Σ K_i z_i - …‖² with K_i ≥ 0.

    On a grid of thresholds Y_mi the deflections z_i are known: stop operators of the displacement, eqs (6), (9). The
    problem is then convex and needs no initial guess; mass, viscous friction, offset and asymmetry are fitted too
    (D. D. Rizos and S. D. Fassois, Chaos 14(2), 2004, with preassigned thresholds; C. L. Lawson and R. J. Hanson,
    Solving Least Squares Problems, 1974). Elements are removed one by one, always the one whose removal increases the
    error least; their number is the one with the smallest squared error over held-out cycles.

    Single K_i are ill-conditioned under noise: assess the force and the virgin curve, whose bands include the
    residuals' correlation and thresholds between those of the grid. Do not use it if the motion stays in presliding, or
    friction depends on position or load.
    """

    def estimate(self, signals: Signals) -> Result:
        """Return elements, terms, errors, virgin curve and the rolling model."""
        task = self.focused_task(signals)
        found, rows, coefficients = self.solution(task)
        deflection = found.coulomb[0] / float(found.stiffness.sum())
        remarks = [*task.remarks, *resolution_remarks(task.resolution, deflection)]
        cycles = (task.cycles.size, task.held_out.size)
        errors = task.errors(rows, coefficients)
        found, doubts = task.with_model_error(found, rows, errors)
        return report(signals, found, rows, errors, cycles, [*remarks, *doubts])
