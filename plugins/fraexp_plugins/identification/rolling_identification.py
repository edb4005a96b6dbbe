"""Rolling friction from a record, by non-negative least squares on stop operators."""

from fraexp.api import Result, Signals
from fraexp_plugins.identification.friction_identification import coarse
from fraexp_plugins.identification.friction_report import report
from fraexp_plugins.identification.grid_identification import GridIdentification


class RollingIdentification(GridIdentification, name="rolling_identification", version=2):
    """Elements of rolling friction by non-negative least squares: min ‖f - Σ K_i z_i - …‖² with K_i ≥ 0.

    On a grid of thresholds Y_mi the deflections z_i are stop operators of the displacement, eqs (6), (9), and known;
    what is left is a convex problem without initial guess, in which mass, viscous friction, offset and asymmetry are
    fitted as well (D. D. Rizos and S. D. Fassois, Chaos 14(2), 2004, with preassigned thresholds;
    C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974). Elements are taken away one by one, always
    the one that is missed least; their number is the one whose squared error over cycles held out is least.

    Single K_i are ill-conditioned under noise: judge by the force and the virgin curve, whose bands know of the
    residuals' correlation and of thresholds between those of the grid. Not to be used where the motion never slips
    through, or friction depends on the position or the load.
    """

    def estimate(self, signals: Signals) -> Result:
        """Return elements, terms, errors, virgin curve and the rolling model."""
        task = self.focused(signals)
        found, rows, coefficients = self.solution(task)
        deflection = found.coulomb[0] / float(found.stiffness.sum())
        remarks = [*task.remarks, *coarse(task.resolution, deflection)]
        cycles = (task.cycles.size, task.held_out.size)
        errors = task.errors(rows, coefficients)
        found, against = task.judged(found, rows, errors)
        return report(signals, found, rows, errors, cycles, [*remarks, *against])
