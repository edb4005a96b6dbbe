"""Mass, Coulomb, viscous and constant friction of a machine from where it slides, by linear least squares."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from fraexp.api import Curve, Estimator, Fit, Metric, RecordError, Result, Signals, param
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.identification.friction_record import HOLD, Stretch, held_or_not, resolution_of, stretches_of
from fraexp_plugins.identification.friction_regression import (
    Observation,
    long_run_variance,
    misfit_variance,
    pseudo_inverse,
)
from fraexp_plugins.identification.friction_report import NORMAL, errs, force_over_velocity

TERMS = {
    "mass": "kg",
    "Coulomb force": "N",
    "viscous coefficient": "N s/m",
    "offset": "N",
    "viscous asymmetry": "N s/m",
}
"""What is identified, in this order, with its unit."""
SHARE = 0.03
"""Slowest sliding as a share of the fast one, if the study does not say."""
STEPS = 4.0
"""Steps of the scale per sample in the slowest sliding at least: below that its direction is not sure."""
STANDING = 1e-3
"""Weight of standstill in a row's low-pass up to which the row counts as sliding."""
ROWS = 40
"""Rows in either direction at least."""
MIXED = 0.1
"""Share of both ways from which a thrust is neither held between samples nor even."""
TINY = 1e-300
"""Variance of residuals that are none."""
BETWEEN = (
    "the thrust between samples is not known: it is neither held nor not held between samples (hold), as in a record "
    "with fewer samples than its controller; the intervals are widened for it: record every sample of the controller"
)
SPEEDS = 1.5
"""Fast over slow sliding from which viscous friction is told from Coulomb friction."""


@dataclass(frozen=True)
class _Sliding:
    """The rows of a stretch in which the machine slides."""

    columns: np.ndarray
    """Shape (rows, p)."""
    force: np.ndarray
    """Shape (rows,) [N]."""
    velocity: np.ndarray
    """Shape (rows,) [m/s]."""


class _Solved(NamedTuple):
    """The least squares over all stretches: rows as in `_Sliding`, and what they make."""

    columns: np.ndarray
    force: np.ndarray
    velocity: np.ndarray
    residuals: list[np.ndarray]
    """Stretch by stretch [N]."""
    values: np.ndarray
    """Of TERMS, shape (p,)."""
    covariance: np.ndarray
    """Shape (p, p)."""
    error: float
    """Root mean square of what is left [N]."""


class SlidingIdentification(Estimator, name="sliding_identification", version=3):
    """u = M a + F_c sgn(v) + D_v v + F_o (+ D_a |v|) by least squares, where the machine slides.

    Any motion in both directions and at several speeds will do: moves from point to point, a triangle with sines on it.
    Thrust and motion are compared after the same low-pass, and only where no standstill is within its reach: there
    friction is whatever holds the machine, and tells nothing. M. Gautier and Ph. Poignet, Control Engineering Practice
    9(12), 2001 (inverse model and parallel filtering), doi:10.1016/S0967-0661(01)00087-9. Intervals know of the
    residuals' correlation (A. D. Sokal, 1997).

    A mode at f1 adds its share of (highest/f1)² to the mass: keep `highest` at a tenth of f1. Half the difference of
    the Coulomb forces of the two directions is part of the offset. Not to be used for motions of the size of the
    presliding deflection (see rolling_identification), nor with a Stribeck effect at the speeds at hand.
    """

    displacement: str = param("", "channel of the position", "y")
    thrust: str = param("", "channel of the thrust", "u")
    acceleration: str = param("", "channel of a measured acceleration; differences of the position if empty", "")
    highest: float = param("Hz", "frequency up to which thrust and motion are compared", 15.0, above=0)
    slowest: float = param(
        "m/s", "speed below which the machine does not count as sliding; chosen from the motion if 0", 0.0, at_least=0
    )
    presliding: float = param("m", "way after each reversal that is left out: there friction rises", 0.0, at_least=0)
    asymmetry: bool = param("", "whether viscous friction may differ by direction: a force D_a |v|", False)
    hold: bool | None = param("", HOLD, None)
    input_dead_time: float = param("s", "dead time of the thrust", 0.0, at_least=0, inherit="loop.input_dead_time")
    output_dead_time: float = param("s", "dead time of the position", 0.0, at_least=0, inherit="loop.output_dead_time")

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "the stepped sine with which it is tried here moves a machine without friction to and fro, at one speed",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return mass, forces and coefficients with 95 % intervals, the forces over velocity, and a Coulomb model."""
        stretches = stretches_of(signals, self.displacement, self.thrust, self.acceleration)
        slowest = self.slowest or _slowest(stretches)
        early = {True: 0.0, False: 0.5}
        ways = {hold: self._solved(stretches, slowest, samples) for hold, samples in early.items()}
        hold, remarks = held_or_not(signals, self.hold, lambda hold: ways[hold].error)
        columns, force, velocity, _, values, covariance, error = ways[hold]
        noise = self._observation(stretches[0], early[hold]).noise(stretches[0], max(values[0], 0.0))
        if values[0] <= 0 or values[1] <= 0:
            raise RecordError(
                f"the mass would be {values[0]:.3g} kg and the Coulomb force {values[1]:.3g} N; check the signs and "
                "gains of the channels, the dead times and highest"
            )
        if errs(values[1], error, noise):
            correlated = self._variance(stretches, ways[hold].residuals)
            covariance = covariance * max(misfit_variance(force.size, values.size, error) / correlated, 1.0)
        elif not signals.numerics:
            middle = self._solved(stretches, slowest, (early[True] + early[False]) / 2)
            share = _share(ways[hold], ways[not hold], middle)
            off = share * (ways[not hold].values - values)
            covariance = covariance + np.outer(off, off)
            if MIXED < share < 1 - MIXED:
                remarks = [BETWEEN]
        return Result(
            signals.outcome,
            "; ".join([*([signals.message] if signals.message else []), *remarks, *_remarks(error, noise, values)]),
            metrics=_metrics(values, covariance, error, columns),
            curves=(_curve(columns, force, velocity, values),),
            fits=(_fit(values, covariance),),
        )

    def _solved(self, stretches: Sequence[Stretch], slowest: float, early: float) -> _Solved:
        found = [self._sliding(stretch, slowest, early) for stretch in stretches]
        columns, force = np.concatenate([f.columns for f in found]), np.concatenate([f.force for f in found])
        velocity = np.concatenate([f.velocity for f in found])
        _check(velocity, slowest)
        scale = np.sqrt(np.add.reduce(columns**2, axis=0) / len(columns))
        root = pseudo_inverse(columns / scale)
        values = root @ (root.T @ ((columns / scale).T @ force)) / scale
        residuals = [f.force - f.columns @ values for f in found]
        covariance = (root @ root.T) / np.outer(scale, scale) * self._variance(stretches, residuals)
        error = float(np.sqrt(np.add.reduce(np.concatenate(residuals) ** 2) / force.size))
        return _Solved(columns, force, velocity, residuals, values, covariance, error)

    def _variance(self, stretches: Sequence[Stretch], residuals: Sequence[np.ndarray]) -> float:
        """Return the variance of the residuals [N²] times their correlation time in rows."""
        count = len(TERMS) if self.asymmetry else len(TERMS) - 1
        return max(long_run_variance(residuals, count), self._filtered_variance(stretches[0], residuals), TINY)

    def _observation(self, stretch: Stretch, early: float) -> Observation:
        """Return how a thrust is seen that arrives so many samples before one that is held."""
        delay = self.input_dead_time + self.output_dead_time - early * stretch.sample_time
        return Observation(inertia=True, delay=delay, highest=self.highest)

    def _filtered_variance(self, stretch: Stretch, residuals: Sequence[np.ndarray]) -> float:
        """Return the variance of the residuals [N²] times their correlation time in rows, as the low-pass alone has it.

        White noise after a Gaussian of standard deviation s is correlated over 2 √π s: between rows that standstill
        has torn apart that cannot be seen.
        """
        deviation = np.sqrt(np.log(2)) / (2 * np.pi * self.highest)
        first, second = Observation(inertia=True, highest=self.highest).rows(stretch, 0)[:2]
        squares = np.concatenate(residuals) ** 2
        mean_square = float(np.add.reduce(squares)) / squares.size
        return mean_square * max(2 * np.sqrt(np.pi) * deviation / ((second - first) * stretch.sample_time), 1.0)

    def _sliding(self, stretch: Stretch, slowest: float, early: float) -> _Sliding:
        seen = self._observation(stretch, early)
        v = stretch.velocity()
        excluded = (np.abs(v) < slowest) | (_way_since_reversal(stretch.displacement, v) < self.presliding)
        standing = seen.friction(stretch, excluded.astype(float)[:, None])[:, 0]
        plain = [np.sign(v), v, np.ones_like(v), *([np.abs(v)] if self.asymmetry else [])]
        columns = np.column_stack([seen.acceleration(stretch), seen.friction(stretch, np.column_stack(plain))])
        sliding = standing < STANDING
        velocity = seen.friction(stretch, v[:, None])[:, 0]
        return _Sliding(columns[sliding], seen.force(stretch)[sliding, 0], velocity[sliding])


def _slowest(stretches: Sequence[Stretch]) -> float:
    """Return the speed [m/s] from which the direction of the motion is sure."""
    speeds = np.abs(np.concatenate([stretch.velocity() for stretch in stretches]))
    step = resolution_of(list(stretches)) / stretches[0].sample_time
    return max(SHARE * float(np.percentile(speeds, 95)), STEPS * step)


def _way_since_reversal(displacement: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return how far each sample is from where the motion has turned last [m], shape (n,)."""
    turned = np.diff(np.sign(velocity), prepend=np.sign(velocity[0])) != 0
    turned[0] = True  # what came before is not known
    last = np.maximum.accumulate(np.where(turned, np.arange(velocity.size), 0))
    way: np.ndarray = np.abs(displacement - displacement[last])
    return way


def _check(velocity: np.ndarray, slowest: float) -> None:
    """Raise RecordError unless the machine slides in both directions and at several speeds."""
    rows = min(int(np.sum(velocity > 0)), int(np.sum(velocity < 0)))
    if rows < ROWS:
        raise RecordError(
            f"the machine slides faster than {slowest:.3g} m/s for {rows} rows in one direction; expected {ROWS}: "
            "record longer moves to and fro, raise highest or lower slowest"
        )
    slow, fast = np.percentile(np.abs(velocity), [10, 90])
    if fast < SPEEDS * slow:
        raise RecordError(
            f"all sliding is at {slow:.3g} to {fast:.3g} m/s; expected several speeds, to tell viscous from Coulomb "
            "friction and the mass from both"
        )


def _share(taken: _Solved, other: _Solved, middle: _Solved) -> float:
    """Return how far the thrust is from the way taken to the other, 0 to 1: the squared error is a parabola of it."""
    first, half, last = (solved.error**2 for solved in (taken, middle, other))
    curvature = first - 2 * half + last
    return float(np.clip((3 * first - 4 * half + last) / (4 * curvature), 0, 1)) if curvature > 0 else 0.5


def _remarks(error: float, noise: float, values: np.ndarray) -> list[str]:
    if values[2] < 0:
        return ["friction falls with the velocity: a Stribeck effect, or another dead time; fit a law with one"]
    if not errs(values[1], error, noise):
        return []
    return [
        f"the model misses {error / values[1]:.0%} of the Coulomb force, where noise explains {noise / values[1]:.1g}, "
        "and its intervals are widened, but may not hold the truth: another force, a Stribeck effect, a mode below ten "
        "times highest, a position that was not measured, or a wrong gain or dead time; see the curve 'force over "
        "velocity'"
    ]


def _metrics(values: np.ndarray, covariance: np.ndarray, error: float, columns: np.ndarray) -> tuple[Metric, ...]:
    wide = NORMAL * np.sqrt(np.diag(covariance))
    found: list[Metric] = []
    for (name, unit), value, half in zip(TERMS.items(), values, wide, strict=False):  # the last one if it is fitted
        found += [Metric(name, float(value), unit), Metric(f"{name}, 95 %", float(half), unit)]
    return (*found, Metric("rms error", error, "N"), Metric("rows", float(len(columns)), "1"))


def _curve(columns: np.ndarray, force: np.ndarray, velocity: np.ndarray, values: np.ndarray) -> Curve:
    inertia = columns[:, 0] * values[0]
    return force_over_velocity(velocity, force - inertia, columns @ values - inertia)


def _fit(values: np.ndarray, covariance: np.ndarray) -> Fit:
    model = Coulomb(coulomb=float(values[1]), viscous_coefficient=max(float(values[2]), 0.0))
    names, units = ("coulomb", "viscous_coefficient"), ("N", "N s/m")
    return Fit("friction", model.spec(), names, units, values[1:3], covariance[1:3, 1:3])
