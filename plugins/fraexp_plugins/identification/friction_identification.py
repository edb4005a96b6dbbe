"""What the estimators that identify friction have in common: channels, thresholds, terms, cycles held out, doubts."""

from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fraexp.api import Estimator, ParameterError, RecordError, Signals, param
from fraexp_plugins.identification.friction_record import HOLD, Stretch, held_or_not, resolution_of, stretches_of
from fraexp_plugins.identification.friction_regression import (
    Compressed,
    Observation,
    RegressionRows,
    long_run_variance,
    misfit_variance,
    rows_of,
)
from fraexp_plugins.identification.friction_report import NORMAL, Errors, ReportedElements, errs, unexplained
from fraexp_plugins.identification.stop_operator import stop_operators, turning_points

GROSS_SHARE = 0.35
"""Widest threshold over the stroke: what hardly slips is a slow rise of the force, whatever its cause."""
SPEED_RATIO = 1.5
"""Fastest over slowest sliding from which viscous friction is told from Coulomb friction."""
STANDING = 0.3
"""Part of the speed of sliding below which the machine turns: there a jump of friction looks like inertia."""
FINEST, SPAN = 0.5, 300.0
"""Steps of the scale in the narrowest threshold at least: then an element turns with the next step, as Coulomb friction
does; and widest over narrowest threshold."""
FINE = 10.0
"""Steps of the scale that the presliding deflection should have."""
FEW_TURNS = 3
"""Reversals that tell friction from other forces."""
FEW_ROWS = 60
"""Rows of a regression at least."""


@dataclass(frozen=True)
class IdentificationTask:
    """Signals made ready for identification."""

    stretches: tuple[Stretch, ...]
    observation: Observation
    terms: tuple[str, ...]
    """What is fitted beside the elements, those of either sign first."""
    thresholds: np.ndarray
    """Y_i of the grid [m], ascending, shape (N,)."""
    viscous: float | None
    """Viscous coefficient that is known [N s/m], or None."""
    resolution: float
    """Of the scale [m]; 0 for an ideal one."""
    held_out: np.ndarray
    """Numbers of the cycles that only judge."""
    cycles: np.ndarray
    """Numbers of the cycles that are fitted."""
    remarks: tuple[str, ...]
    speed: float | None = None
    """The speed of all sliding [m/s], if it is but one."""

    def rows(self, thresholds: np.ndarray) -> list[RegressionRows]:
        """Return the rows of all stretches for elements with these thresholds [m], shape (N,)."""
        elements = [self.deflections(stretch, thresholds) for stretch in self.stretches]
        return self.rows_with(elements)

    def deflections(self, stretch: Stretch, thresholds: np.ndarray) -> np.ndarray:
        """Return the elements' deflections [m] along a stretch, shape (n, N)."""
        motion = np.concatenate([stretch.before, stretch.displacement])
        return stop_operators(motion, thresholds)[stretch.before.size :]

    def rows_with(self, elements: Sequence[np.ndarray]) -> list[RegressionRows]:
        """Return the rows of all stretches with these columns of elements, each (n, N)."""
        widest = float(self.thresholds.max())
        rows = [
            rows_of(stretch, self.observation, self.terms, columns, stretch.known_from(widest))
            for stretch, columns in zip(self.stretches, elements, strict=True)
        ]
        if self.viscous:
            rows = [self._without_viscous(*pair) for pair in zip(rows, self.stretches, strict=True)]
        rows = [each for each in rows if each.force.size]
        if sum(each.force.size for each in rows) < FEW_ROWS:
            raise RecordError(
                f"nowhere does the motion span twice the widest threshold, {widest:.3g} m, for long enough; "
                "record more cycles with gross slip, or lower widest"
            )
        return rows

    def _without_viscous(self, rows: RegressionRows, stretch: Stretch) -> RegressionRows:
        known = self.observation.friction(stretch, stretch.velocity()[:, None])
        widest = float(self.thresholds.max())
        known = self.observation.kept(stretch, known, stretch.known_from(widest))
        return replace(rows, force=rows.force - (self.viscous or 0.0) * known[:, 0])

    @property
    def least_error(self) -> float:
        """Root mean square error [N] of all elements of the grid together."""
        rows = self.rows(self.thresholds)
        compressed = Compressed(rows, self.cycles)
        solution = compressed.solve(np.ones(rows[0].columns.shape[1], dtype=bool))
        return float(np.sqrt(compressed.mean_square(solution)))

    def noise(self, mass: float) -> float:
        """Return the error [N] that the noise of the channels makes."""
        return max(self.observation.noise(stretch, mass) for stretch in self.stretches)

    def inflation(
        self, rows: Sequence[RegressionRows], errors: Errors, coulomb: float, mass: float, count: int
    ) -> float:
        """Return by what a covariance of `count` parameters grows where the error is not noise; 1 where it is."""
        if not errs(coulomb, errors.worst, self.noise(mass)):
            return 1.0
        chosen = [np.isin(each.cycle, self.cycles) for each in rows]
        parts = [residual[which] for residual, which in zip(errors.residuals, chosen, strict=True)]
        size = sum(part.size for part in parts)
        return max(misfit_variance(size, count, errors.fitted) / long_run_variance(parts, count), 1.0)

    def judged(
        self, found: ReportedElements, rows: Sequence[RegressionRows], errors: Errors
    ) -> tuple[ReportedElements, list[str]]:
        """Return the elements with a covariance that knows of the model's errors, and what is to be said of these."""
        coulomb, mass = found.coulomb[0], found.terms.get("mass", 0.0)
        count = found.stiffness.size + len(self.terms)
        covariance = found.covariance * self.inflation(rows, errors, coulomb, mass, count)
        if mass and self.speed is not None:  # while the machine stands its friction jumps at a time that is not seen
            place = len(covariance) - len(found.terms) + list(found.terms).index("mass")
            late = max(_standing(stretch, self.speed) for stretch in self.stretches)
            covariance[place, place] += (coulomb * late / self.speed / NORMAL) ** 2
        return replace(found, covariance=covariance), unexplained(coulomb, errors.worst, self.noise(mass))

    def errors(self, rows: Sequence[RegressionRows], coefficients: np.ndarray) -> Errors:
        """Return the errors of a linear model."""
        return self.errors_of(rows, [each.force - each.columns @ coefficients for each in rows])

    def errors_of(self, rows: Sequence[RegressionRows], residuals: Sequence[np.ndarray]) -> Errors:
        """Return the errors whose residuals [N] are given, stretch by stretch."""
        labels = np.concatenate([each.cycle for each in rows])
        squared = np.concatenate(residuals) ** 2
        held = np.isin(labels, self.held_out)
        parts = [squared[~held], squared[held]]
        fitted, held_out = (float(np.sqrt(np.add.reduce(p) / p.size)) if p.size else np.nan for p in parts)
        return Errors(fitted, held_out, residuals)


class FrictionIdentification(Estimator, ABC):
    """An estimator that identifies friction from a record of displacement and force, or of thrust and position.

    With `thrust` the friction is what the thrust leaves for the moving mass, f = u - M a, and the mass is fitted in
    the same regression (J. Swevers, F. Al-Bender, C. Ganseman and T. Prajogo, IEEE Trans. Automatic Control 45(4),
    2000, doi:10.1109/9.847103). It is compared up to `highest`: a mode at f1 adds its share of (highest/f1)² to the
    mass, so stay at a tenth of the first one. Where friction jumps at a reversal, between samples, the mass takes up to
    a sample's delay of that jump: sample fast, or turn seldom. A constant offset is fitted too: besides a bias it is
    half the difference of the Coulomb forces of the two directions, since an element with unequal limits is one with
    equal limits and a bias.
    """

    displacement: str = param("", "channel of the displacement", "displacement")
    force: str = param("", "channel of the friction force, where it is measured", "friction")
    thrust: str = param("", "channel of the thrust that moves mass and friction, in place of `force`", "")
    acceleration: str = param("", "channel of a measured acceleration; differences of the displacement if empty", "")
    highest: float = param("Hz", "frequency up to which thrust and motion are compared", 5.0, above=0)
    hold: bool | None = param("", HOLD, None)
    input_dead_time: float = param("s", "dead time of the thrust", 0.0, at_least=0, inherit="loop.input_dead_time")
    input_lags: tuple[float, ...] = param("s", "first-order lags of the thrust", (), inherit="loop.input_lags")
    output_dead_time: float = param("s", "dead time of the position", 0.0, at_least=0, inherit="loop.output_dead_time")
    output_lags: tuple[float, ...] = param("s", "first-order lags of the position", (), inherit="loop.output_lags")
    resolution: float = param(
        "m", "resolution of the scale; seen in the record if 0", 0.0, at_least=0, inherit="loop.resolution"
    )
    offset: bool = param("", "whether a constant force is fitted", True)
    asymmetry: bool = param("", "whether viscous friction may differ by direction: a force D_a |v|", False)
    viscous_coefficient: float | None = param(
        "N s/m", "viscous coefficient D_v if it is known; else it is fitted if the velocity varies", None, at_least=0
    )
    thresholds: tuple[float, ...] = param("m", "thresholds Y_mi if they are known", ())
    narrowest: float | None = param(
        "m", "narrowest threshold of the grid; chosen from the motion if absent", None, above=0
    )
    widest: float | None = param("m", "widest threshold of the grid; 0.35 of the stroke if absent", None, above=0)
    grid: int = param("1", "thresholds of the grid, evenly spaced in their logarithm", 100, at_least=1, at_most=400)
    holdout: float = param(
        "1", "share of the cycles that only judge, spread over the record", 0.25, at_least=0, at_most=0.5
    )

    def model_post_init(self, context: object) -> None:
        """Check the thresholds."""
        if self.thresholds and (min(self.thresholds) <= 0 or min(np.diff(self.thresholds), default=1.0) <= 0):
            raise ParameterError(f"{self.name}.thresholds must be above 0 and ascending")
        if self.narrowest and self.widest and self.narrowest >= self.widest:
            raise ParameterError(
                f"{self.name}.narrowest is {self.narrowest:g} m; it must be below widest, {self.widest:g} m"
            )

    def task(self, signals: Signals) -> IdentificationTask:
        """Return the signals made ready; RecordError where they cannot tell."""
        stretches = tuple(stretches_of(signals, self.displacement, self.thrust or self.force, self.acceleration))
        if not any(np.ptp(stretch.force) for stretch in stretches):
            raise RecordError(f"'{self.thrust or self.force}' does not vary; expected the force of the friction")
        resolution = self.resolution or resolution_of(list(stretches))
        thresholds = self._grid(stretches, resolution)
        terms, speed, remarks = self._terms(stretches, float(thresholds.max()))
        cycles = np.unique(np.concatenate([stretch.cycle for stretch in stretches]))
        every = round(1 / self.holdout) if self.holdout else 0
        held_out = cycles[every - 1 :: every] if every and cycles.size >= every else cycles[:0]
        found = IdentificationTask(
            stretches=stretches,
            observation=self._observation(stretches[0].sample_time, hold=True),
            terms=terms,
            thresholds=thresholds,
            viscous=self.viscous_coefficient,
            resolution=resolution,
            held_out=held_out,
            cycles=np.setdiff1d(cycles, held_out),
            remarks=(*remarks, *_turns(stretches, float(thresholds.min()))),
            speed=speed,
        )
        return self._as_held(found, signals) if self.thrust else found

    def _as_held(self, task: IdentificationTask, signals: Signals) -> IdentificationTask:
        """Return the task with the thrust held between samples, or not."""
        ways = {
            hold: replace(task, observation=self._observation(task.stretches[0].sample_time, hold=hold))
            for hold in (True, False)
        }
        known = True if self.hold is None and task.speed is not None else self.hold  # at one speed a delay is mass
        hold, remarks = held_or_not(signals, known, lambda hold: ways[hold].least_error)
        return replace(ways[hold], remarks=(*task.remarks, *remarks))

    def _observation(self, sample_time: float, *, hold: bool) -> Observation:
        # far below 1/τ a lag is a delay; a thrust that is not held arrives half a sample before one that is
        delay = self.input_dead_time + self.output_dead_time + sum(self.input_lags) + sum(self.output_lags)
        return Observation(bool(self.thrust), delay - (0.0 if hold else sample_time / 2), self.highest)

    def _grid(self, stretches: Sequence[Stretch], resolution: float, widest: float | None = None) -> np.ndarray:
        """Return the thresholds [m]: those given, or a grid up to `widest` as far as the scale and the study allow."""
        if self.thresholds:
            return np.array(self.thresholds)
        stroke = max(float(np.ptp(stretch.displacement)) for stretch in stretches)
        widest = self.widest or widest or GROSS_SHARE * stroke
        narrowest = self.narrowest or min(max(FINEST * resolution, widest / SPAN), widest / 2)
        if narrowest >= widest:
            raise RecordError(
                f"the motion's stroke is {stroke:.3g} m; expected more than twice the narrowest threshold, "
                f"{narrowest:.3g} m"
            )
        return np.geomspace(narrowest, widest, self.grid) if self.grid > 1 else np.array([widest])

    def narrowed(self, task: IdentificationTask, widest: float) -> IdentificationTask:
        """Return the task with a grid that ends at `widest` [m], where the study did not fix its range."""
        if self.thresholds or self.widest or widest >= task.thresholds[-1]:
            return task
        return replace(task, thresholds=self._grid(task.stretches, task.resolution, widest))

    def _terms(self, stretches: Sequence[Stretch], widest: float) -> tuple[tuple[str, ...], float | None, list[str]]:
        """Return what is fitted beside the elements, the speed of all sliding if it is but one, and remarks on it."""
        terms = [name for name in ("offset", "asymmetry") if getattr(self, name)] + (["mass"] if self.thrust else [])
        speeds = np.concatenate([_sliding_speeds(stretch, widest) for stretch in stretches])
        slow, fast = _by_way(speeds, 0.1), _by_way(speeds, 0.9)
        if fast > SPEED_RATIO * slow:
            return (*terms, *(["viscous"] if self.viscous_coefficient is None else [])), None, []
        told, advice = [], "record several speeds"
        if self.viscous_coefficient is None:
            told.append("viscous friction is part of the Coulomb force")
            advice += ", or give viscous_coefficient"
            terms = [name for name in terms if name != "asymmetry"]
        if self.thrust:
            told.append("the mass shows at reversals alone, where friction that is late by a standstill counts as mass")
        remarks = [f"all sliding is at one speed, so {' and '.join(told)}: {advice}"] if told else []
        return tuple(terms), fast if speeds.size else None, remarks


def _standing(stretch: Stretch, speed: float) -> float:
    """Return how long the machine stands at a reversal of a motion at this speed [m/s], and a sample [s]."""
    turns = turning_points(stretch.displacement, speed * stretch.sample_time).size
    slow = int(np.sum(np.abs(stretch.velocity()) < STANDING * speed))
    return (1 + slow / max(turns, 1)) * stretch.sample_time


def _sliding_speeds(stretch: Stretch, widest: float) -> np.ndarray:
    """Return the speeds [m/s] at which even the widest element slips."""
    motion = np.concatenate([stretch.before, stretch.displacement])
    wide = stop_operators(motion, np.array([widest]))[stretch.before.size :, 0]
    speeds = np.abs(stretch.velocity())[np.abs(wide) >= widest]
    found: np.ndarray = speeds[speeds > 0]
    return found


def _by_way(speeds: np.ndarray, share: float) -> float:
    """Return the speed [m/s] below which that share of the way is gone: dwells at the ends do not count."""
    if not speeds.size:
        return 1.0
    ordered = np.sort(speeds)
    way = np.cumsum(ordered)
    return float(ordered[np.searchsorted(way, share * way[-1])])


def _turns(stretches: Sequence[Stretch], narrowest: float) -> list[str]:
    count = sum(
        turning_points(np.concatenate([stretch.before, stretch.displacement]), 2 * narrowest).size
        for stretch in stretches
    )
    if count >= FEW_TURNS:
        return []
    return [f"the motion turns {count} times: too seldom to tell friction from other forces; record several cycles"]


def coarse(resolution: float, deflection: float) -> list[str]:
    """Return the remark on a scale that is too coarse for a presliding deflection [m], if it is."""
    if resolution * FINE <= deflection:
        return []
    return [
        f"the scale's step of {resolution:.3g} m is more than a tenth of the presliding deflection of "
        f"{deflection:.3g} m: the stiffness is uncertain; take a finer scale"
    ]
