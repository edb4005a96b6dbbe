"""Viscous friction from runs at constant velocity."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, Estimator, Metric, Quantity, RecordError, Result, Segment, Signals, param, remarks
from fraexp_plugins.identification._shared.friction_curves import force_over_velocity
from fraexp_plugins.identification._shared.stop_operator import turning_points
from fraexp_plugins.identification.friction._friction_record import CYCLE_STROKE_RATIO, check_units
from fraexp_plugins.identification.friction._sliding_rows import coulomb_fit

T_QUANTILE = 0.975
"""Quantile of Student's distribution for 95 % intervals."""
MIN_RUNS = 4
MIN_CURVATURE_STDS = 4.0
"""Standard deviations of a quadratic term from which friction is not linear in the velocity."""
MIN_SPEED_RATIO = 1.2
"""Fastest over slowest run."""
MAX_VELOCITY_CHANGE = 0.1
"""Relative difference of the velocities of a run's two halves up to which the velocity is constant."""


class ViscousIdentification(Estimator, name="viscous_identification", version=2):
    """D_v from runs at constant velocity, eq (12): mean force F_o + F_c sgn(v) + D_v v + M a, by least squares.

    A run is the motion from one reversal to the next without its beginning, in which presliding and the loop settle,
    and without its end; a is the remaining acceleration. The scatter of the runs gives the intervals (Student's t). A
    quadratic term is tried too: if it is significant friction is not linear, as with a Stribeck effect, and the message
    says so. Do not use it with runs whose velocity does not reach the steady state.
    """

    displacement: str = param("", "channel of the position", "y")
    force: str = param("", "channel of the force: the thrust, or a measured friction force", "u")
    trim_start: float = param("1", "fraction of each run that is left out at its beginning", 0.4, at_least=0, below=1)
    trim_end: float = param("1", "fraction of each run that is left out at its end", 0.15, at_least=0, below=1)

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses the stepped sine with which it is tried here, which has no constant velocity.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return D_v, F_c and F_o with 95 % intervals, the runs as a curve, and a Coulomb model."""
        check_units(signals, {self.displacement: "m", self.force: "N"})
        runs = np.array([run for segment in signals.segments for run in self._runs(segment)]).reshape(-1, 3)
        _check(runs)
        values, covariance = _regression(runs, quadratic=False)
        curvature = _curvature_remarks(runs) if len(runs) > 5 else []
        if values[2] < 0 or values[1] <= 0:
            raise RecordError(
                "friction falls with the velocity, by ",
                Quantity(values[2], "N s/m"),
                ": a Stribeck effect, or a force of the wrong sign; use higher velocities, or fit a law with a "
                "Stribeck effect (friction_identification)",
            )
        return Result(
            signals.outcome,
            (*signals.findings, *remarks(*curvature)),
            metrics=_metrics(values, covariance, len(runs)),
            curves=(_curve(runs, values),),
            fits=(coulomb_fit(values, covariance),),
        )

    def _runs(self, segment: Segment) -> list[tuple[float, float, float]]:
        """Return velocity [m/s], mean force [N] and mean acceleration [m/s²] of each run."""
        y, force = (segment.channels[name].ravel() for name in (self.displacement, self.force))
        turns = turning_points(y, CYCLE_STROKE_RATIO * float(np.ptp(y))).tolist()
        found = []
        for begin, stop in zip([0, *turns], [*turns, y.size - 1], strict=True):
            length = stop - begin
            first, last = begin + int(self.trim_start * length), stop - int(self.trim_end * length)
            if last - first < 4 or abs(y[stop] - y[begin]) < CYCLE_STROKE_RATIO * np.ptp(y):
                continue
            middle = (first + last) // 2
            halves = np.array([(y[middle] - y[first]) / (middle - first), (y[last] - y[middle]) / (last - middle)])
            velocity = (y[last] - y[first]) / (last - first) / segment.sample_time
            if np.ptp(halves) < MAX_VELOCITY_CHANGE * np.abs(halves).mean():
                change = (halves[1] - halves[0]) / segment.sample_time**2 / ((last - first) / 2)
                found.append((float(velocity), float(np.mean(force[first:last])), float(change)))
        return found


def _check(runs: NDArray[np.float64]) -> None:
    """Raise RecordError unless viscous friction is identifiable from runs, shape (n, 3)."""
    speeds = np.abs(runs[:, 0])
    finding: tuple[object, ...] = ()
    if len(runs) < MIN_RUNS:
        expected = f"expected {MIN_RUNS} or more, in both directions and "
        finding = (f"there are {len(runs)} runs at constant velocity; {expected}",)
    elif np.ptp(np.sign(runs[:, 0])) == 0:
        finding = (f"all {len(runs)} runs at constant velocity are in one direction; expected both, ",)
    elif speeds.max() < MIN_SPEED_RATIO * speeds.min():
        speed = Quantity(float(np.median(speeds)), "m/s")
        finding = (f"all {len(runs)} runs are at one velocity, ", speed, "; expected runs ")
    if finding:
        raise RecordError(*finding, "at different velocities: see excitation constant_velocities")


def _regression(runs: NDArray[np.float64], *, quadratic: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def _curvature_remarks(runs: NDArray[np.float64]) -> list[str]:
    values, covariance = _regression(runs, quadratic=True)
    std = float(np.sqrt(covariance[3, 3]))
    change = abs(values[3]) * float(np.abs(runs[:, 0]).max())
    if abs(values[3]) <= MIN_CURVATURE_STDS * std or change < 0.05 * abs(values[2]):
        return []
    return ["friction is not linear in the velocity (Stribeck effect?): D_v is valid between these velocities only"]


def _metrics(values: NDArray[np.float64], covariance: NDArray[np.float64], runs: int) -> tuple[Metric, ...]:
    from scipy.stats import t

    half_widths = float(t.ppf(T_QUANTILE, max(runs - len(values), 1))) * np.sqrt(np.diag(covariance))
    names = (("offset", "N"), ("Coulomb force", "N"), ("viscous coefficient", "N s/m"))
    found = [Metric("runs", float(runs), "1")]
    for (name, unit), value, half in zip(names, values, half_widths, strict=False):  # without the mass
        found += [Metric(name, float(value), unit), Metric(f"{name}, 95 %", float(half), unit)]
    return tuple(found)


def _curve(runs: NDArray[np.float64], values: NDArray[np.float64]) -> Curve:
    velocity, force, acceleration = runs.T
    force = force - (values[3] if values.size > 3 else 0.0) * acceleration
    return force_over_velocity(velocity, force, values[0] + values[1] * np.sign(velocity) + values[2] * velocity)
