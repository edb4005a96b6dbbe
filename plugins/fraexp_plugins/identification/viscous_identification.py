"""Viscous friction from runs at constant velocity."""

from typing import ClassVar

import numpy as np

from fraexp.api import Curve, Estimator, Fit, Metric, RecordError, Result, Segment, Signals, param
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.identification.friction_record import GROSS, check_units
from fraexp_plugins.identification.friction_report import force_over_velocity
from fraexp_plugins.identification.stop_operator import turning_points

LEVEL = 0.975
"""Of Student's distribution, for 95 % intervals."""
FEWEST = 4
"""Runs at least."""
CURVED = 4.0
"""Standard deviations of a quadratic term from which friction is not linear in the velocity."""
DIFFERENT = 1.2
"""Fastest over slowest run, at least."""
STEADY = 0.1
"""Relative difference of a run's two halves in velocity from which it is none."""


class ViscousIdentification(Estimator, name="viscous_identification", version=2):
    """D_v from runs at constant velocity, eq (12): mean force F_o + F_c sgn(v) + D_v v + M a, by least squares.

    A run is the motion from one reversal to the next without its beginning, in which presliding and the loop settle,
    and its end; a is what is left of an acceleration. The runs' scatter gives the intervals (Student's t). A quadratic
    term is tried as well: where it is significant friction is not linear, as with a Stribeck effect, and the message
    says so. Not to be used with runs in which the velocity has not become steady.
    """

    displacement: str = param("", "channel of the position", "y")
    force: str = param("", "channel of the force: the thrust, or a measured friction force", "u")
    beginning: float = param("1", "share of each run left out at its beginning", 0.4, at_least=0, below=1)
    end: float = param("1", "share of each run left out at its end", 0.15, at_least=0, below=1)

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses the stepped sine with which it is tried here: nothing is steady.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return D_v, F_c and F_o with 95 % intervals, the runs as a curve, and a Coulomb model."""
        check_units(signals, {self.displacement: "m", self.force: "N"})
        runs = np.array([run for segment in signals.segments for run in self._runs(segment)]).reshape(-1, 3)
        _check(runs)
        values, covariance = _regression(runs, quadratic=False)
        remarks = [signals.message] if signals.message else []
        if len(runs) > 5:
            remarks += _curvature(runs)
        if values[2] < 0 or values[1] <= 0:
            raise RecordError(
                f"friction falls with the velocity ({values[2]:.3g} N s/m): a Stribeck effect, or a force of the wrong "
                "sign; give higher velocities, or fit a model with a Stribeck effect (gms_identification)"
            )
        return Result(
            signals.outcome,
            "; ".join(remarks),
            metrics=_metrics(values, covariance, len(runs)),
            curves=(_curve(runs, values),),
            fits=(_fit(values, covariance),),
        )

    def _runs(self, segment: Segment) -> list[tuple[float, float, float]]:
        """Return velocity [m/s], mean force [N] and mean acceleration [m/s²] of each run."""
        y, force = (segment.channels[name].ravel() for name in (self.displacement, self.force))
        turns = turning_points(y, GROSS * float(np.ptp(y))).tolist()
        found = []
        for begin, stop in zip([0, *turns], [*turns, y.size - 1], strict=True):
            length = stop - begin
            first, last = begin + int(self.beginning * length), stop - int(self.end * length)
            if last - first < 4 or abs(y[stop] - y[begin]) < GROSS * np.ptp(y):
                continue
            middle = (first + last) // 2
            halves = np.array([(y[middle] - y[first]) / (middle - first), (y[last] - y[middle]) / (last - middle)])
            velocity = (y[last] - y[first]) / (last - first) / segment.sample_time
            if np.ptp(halves) < STEADY * np.abs(halves).mean():
                change = (halves[1] - halves[0]) / segment.sample_time**2 / ((last - first) / 2)
                found.append((float(velocity), float(np.mean(force[first:last])), float(change)))
        return found


def _check(runs: np.ndarray) -> None:
    """Raise RecordError unless runs, shape (n, 3), tell viscous friction."""
    speeds = np.abs(runs[:, 0])
    missing = ""
    if len(runs) < FEWEST:
        missing = f"{len(runs)} runs at steady velocity were found; expected {FEWEST} at least, in both directions and "
    elif np.ptp(np.sign(runs[:, 0])) == 0:
        missing = f"all {len(runs)} runs at steady velocity are in one direction; expected both, "
    elif speeds.max() < DIFFERENT * speeds.min():
        missing = f"all {len(runs)} runs at steady velocity are at one, {np.median(speeds):.3g} m/s; expected runs "
    if missing:
        raise RecordError(f"{missing}at different velocities: see excitation constant_velocities")


def _regression(runs: np.ndarray, *, quadratic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return offset, Coulomb force, viscous coefficient (and the quadratic term), mass, and their covariance."""
    velocity, force, acceleration = runs.T
    columns = [np.ones_like(velocity), np.sign(velocity), velocity]
    if quadratic:
        columns.append(velocity * np.abs(velocity))
    if np.any(acceleration) and len(runs) > len(columns) + 1:
        columns.append(acceleration)
    matrix = np.column_stack(columns)
    scale = np.abs(matrix).max(axis=0)
    values = np.linalg.lstsq(matrix / scale, force, rcond=None)[0] / scale
    variance = np.sum((force - matrix @ values) ** 2) / max(len(runs) - len(columns), 1)
    inverse = np.linalg.pinv((matrix / scale).T @ (matrix / scale)) / np.outer(scale, scale)
    return values, variance * inverse


def _curvature(runs: np.ndarray) -> list[str]:
    values, covariance = _regression(runs, quadratic=True)
    deviation = float(np.sqrt(covariance[3, 3]))
    bend = abs(values[3]) * float(np.abs(runs[:, 0]).max())
    if abs(values[3]) <= CURVED * deviation or bend < 0.05 * abs(values[2]):
        return []
    return ["friction is not linear in the velocity (Stribeck effect?): D_v holds between these velocities only"]


def _metrics(values: np.ndarray, covariance: np.ndarray, runs: int) -> tuple[Metric, ...]:
    from scipy.stats import t

    wide = float(t.ppf(LEVEL, max(runs - len(values), 1))) * np.sqrt(np.diag(covariance))
    names = (("offset", "N"), ("Coulomb force", "N"), ("viscous coefficient", "N s/m"))
    found = [Metric("runs", float(runs), "1")]
    for (name, unit), value, half in zip(names, values, wide, strict=False):  # without the mass
        found += [Metric(name, float(value), unit), Metric(f"{name}, 95 %", float(half), unit)]
    return tuple(found)


def _curve(runs: np.ndarray, values: np.ndarray) -> Curve:
    velocity, force, acceleration = runs.T
    force = force - (values[3] if values.size > 3 else 0.0) * acceleration
    return force_over_velocity(velocity, force, values[0] + values[1] * np.sign(velocity) + values[2] * velocity)


def _fit(values: np.ndarray, covariance: np.ndarray) -> Fit:
    model = Coulomb(coulomb=float(values[1]), viscous_coefficient=float(values[2]))
    names, units = ("coulomb", "viscous_coefficient"), ("N", "N s/m")
    return Fit("friction", model.spec(), names, units, values[1:3], covariance[1:3, 1:3])
