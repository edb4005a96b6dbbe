"""The shape and dead time of a law that leave least of some records, and how far these determine its sizes."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import COARSE_DIFFERENCE, MAX_ITERATIONS, NORMAL_QUANTILE
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.identification._shared.law_forces import LawForces, columns_of, unit_law
from fraexp_plugins.identification._shared.least_squares import HeldSum, inverse_square, minimise, solve_non_negative
from fraexp_plugins.identification.autonomous._line_records import LawSolution, LineRecords

SHAPE_STEP, DIFFERENCE = 0.1, 1e-4
"""Scale of a step of a logarithm, and its difference for derivatives."""
MAX_SHIFT, MAX_DEAD_TIME = 7.0, 8.0
"""Distance of a logarithm from its start at most, and the largest dead time [samples]."""
MAX_TRIALS, TOLERANCE = 40, 1e-4
"""Steps of a search at most, and relative change of the sum of squares at which it ends."""


class LawSearch:
    """What a law leaves of some records, by values: the dead time [samples], and the coordinates of its shape.

    `law_at_start` is the law at which the search begins.
    """

    def __init__(self, records: LineRecords, law: LawForces, is_delayed: bool) -> None:
        self.records, self.law_at_start, self._is_delayed = records, law, is_delayed

    def values(self, law: LawForces, dead_time: float) -> NDArray[np.float64]:
        """Return the values of a law of this family, and a dead time [s]."""
        return np.array([dead_time / self.records.sample_time, *law.shape])

    def law(self, values: NDArray[np.float64]) -> LawForces:
        """Return the law of these values."""
        return replace(self.law_at_start, shape=values[1:])

    def dead_time(self, values: NDArray[np.float64]) -> float:
        """Return the dead time [s]."""
        return max(float(values[0]), 0.0) * self.records.sample_time

    def solve(self, values: NDArray[np.float64], held: float | None = None) -> LawSolution:
        """Return the sizes and residuals; with `held` the Coulomb force is that [N]."""
        law = self.law(values)
        return self.records.solve(law, self.records.deflection(law), self.dead_time(values), held)

    def cost(self, values: NDArray[np.float64], held: float | None = None) -> float:
        """Return the sum of squares."""
        return float(np.sum(self.solve(values, held).residual ** 2))

    def robust_cost(self, values: NDArray[np.float64]) -> float:
        """Return what no record decides alone."""
        return float(np.sum(np.log1p(self.solve(values).residual ** 2)))

    def minimised(
        self, start: NDArray[np.float64], held: float | None = None, trials: int = MAX_TRIALS, is_robust: bool = False
    ) -> NDArray[np.float64]:
        """Return the values that leave least, from a start on; a linear law keeps its shape."""
        is_free = np.arange(start.size) >= 1 - self._is_delayed
        is_free[1:] &= not self.law_at_start.is_linear
        if not is_free.any():
            return start

        def complete(free: NDArray[np.float64]) -> NDArray[np.float64]:
            values = start.copy()
            values[is_free] = free
            return values

        low, high = start - MAX_SHIFT, start + MAX_SHIFT
        low[0], high[0] = -1e-9, MAX_DEAD_TIME
        found, _ = minimise(
            lambda free: self.solve(complete(free), held).residual,
            start[is_free],
            (low[is_free], high[is_free]),
            trials,
            x_scale=SHAPE_STEP,
            diff_step=DIFFERENCE,
            ftol=TOLERANCE,
            gtol=TOLERANCE**2,
            loss="soft_l1" if is_robust else "linear",
        )
        return complete(found)


RIDGE_RATIO = 1e-6
"""Weight of a ridge over that of the largest column: it decides between columns that are equal."""
EDGE_TOLERANCE = 1e-3
"""Relative tolerance of an end of the interval."""
ALTERNATIVE_VELOCITIES, ALTERNATIVE_RATES_S, ALTERNATIVE_EXCESS = (0.1, 0.4, 1.0), (12.0, 60.0), 0.05
"""Stribeck velocities over the largest velocity, rates of attraction over the Coulomb force, and static over Coulomb
force less 1, of a Stribeck effect beside a law, by which its Coulomb force is judged."""
INTERVAL_STDS = 3.0
"""Standard deviations of an interval: the elements that weaken are not the law's own, and errors of a law are not
independent."""
INCOMPLETE_RATIO = 2.0
"""Factor on the change of the Coulomb force where a Stribeck effect beside a law explains more of the records."""
LUMPS = 6
"""Number of elements that weaken beside a law."""
MIN_EXCESS_RATIO = 1e-3
"""Static over Coulomb force, less 1, over that of a Stribeck effect, which is none."""
NEIGHBOURHOOD = 3
"""Places on the grid around an element at which another one may be in its place."""
FIRST_CHANGE, MAX_CHANGE = 0.01, 0.08
"""Relative change of the Coulomb force that is tried first, and the one from which the interval is wide enough to be of
no use; each change is twice the one before."""
CHANGE_TRIALS = 6
"""Steps of the shape at each change at most."""


def sum_interval(
    matrix: NDArray[np.float64], target: NDArray[np.float64], chosen: NDArray[np.bool_], rise: float
) -> tuple[float, float]:
    """Return the least and greatest Σ x_j over the `chosen` columns for which |A x - b|² is near its minimum.

    It is the profile likelihood of the sum over x >= 0: the sum of squares, minimised over all other directions, lies
    at most `rise` above that of the best x. Columns that may replace one another make it wide, whichever of them the
    best x has (S. A. Murphy and A. W. van der Vaart, Journal of the American Statistical Association 95(450), 2000,
    doi 10.1080/01621459.2000.10474219). The profile is convex. `matrix` A has the shape (m, N), `chosen` (N,).
    """
    from scipy.optimize import brentq  # slow to import: only when something is estimated

    count = matrix.shape[1]
    triangle = np.linalg.qr(np.column_stack([matrix, target])).R
    reduced, right = triangle[:, :-1], triangle[:, -1]
    ridge = RIDGE_RATIO * float(np.linalg.norm(reduced, axis=0).max()) * np.eye(count)
    rows, ends = np.concatenate([reduced, ridge]), np.append(right, np.zeros(count))
    best = solve_non_negative(rows, ends)
    total, least = float(best[chosen].sum()), float(np.sum((reduced @ best - right) ** 2))

    def excess(held: float) -> float:
        x = solve_non_negative(rows, ends, held=HeldSum(chosen, held))
        return float(np.sum((reduced @ x - right) ** 2)) - least - rise

    low = 0.0 if excess(0.0) <= 0 else float(brentq(excess, 0.0, total, rtol=EDGE_TOLERANCE))
    step = max(total, EDGE_TOLERANCE) / 32
    for _ in range(MAX_ITERATIONS):
        if excess(total + step) > 0:
            return low, float(brentq(excess, total, total + step, rtol=EDGE_TOLERANCE))
        step *= 2
    return low, total + step


class LawUncertainty(NamedTuple):
    """What the records leave open of a law."""

    covariance: NDArray[np.float64]
    """Covariance of the shape and then of the sizes, shape (S + N, S + N)."""
    interval: tuple[float, float]
    """Least and greatest Coulomb force [N]."""
    is_complete: bool
    """Whether a Stribeck effect beside the law explains no more of the records."""


def law_uncertainty(law: LawForces, dead_time: float, records: LineRecords, may_weaken: bool) -> LawUncertainty:
    """Return how far the records determine a law with this dead time [s].

    The interval is the profile likelihood of the Coulomb force. With `may_weaken` a Stribeck effect that the law lacks
    is free beside the law's own sizes and shape, at several velocities and lags: it can only weaken friction in
    sliding. The scale is what the law leaves of the records, rather than what is allowed for.
    """
    deflection = records.deflection(law)
    sizes, residual, problem = records.solve(law, deflection, dead_time)
    square = float(np.sum(residual**2)) / records.equations
    slopes = law.slopes(records.deflection, sizes, COARSE_DIFFERENCE)
    by_shape = np.stack(slopes, axis=-1) if slopes else np.empty((*deflection.shape[:-1], 0))
    shapes = records.problem(by_shape, dead_time).matrix
    possible = _possible_places(law, sizes)
    places = np.concatenate([np.arange(shapes.shape[1]), law.shape.size + possible])
    covariance = np.zeros((law.shape.size + sizes.size,) * 2)
    jacobian = np.concatenate([shapes, problem.matrix[:, possible]], axis=1)
    prior = np.concatenate([np.zeros(shapes.shape[1]), 1 / records.prior(law)[possible]])
    covariance[np.ix_(places, places)] = inverse_square(
        np.concatenate([jacobian / np.sqrt(max(square, 1.0)), np.diag(prior)])
    )
    columns = [problem.matrix, shapes, -shapes]
    if may_weaken:
        columns.append(_weakening_columns(law, sizes, dead_time, records))
    matrix = np.concatenate(columns, axis=1)
    chosen = np.arange(matrix.shape[1]) < sizes.size
    chosen[: sizes.size] &= law.is_coulomb
    low, high = sum_interval(matrix, problem.target, chosen, INTERVAL_STDS**2 * max(square, 1.0))
    found = float(sizes[law.is_coulomb].sum())
    own = law.shape.size + np.flatnonzero(law.is_coulomb)
    half_width = NORMAL_QUANTILE * float(np.sqrt(covariance[np.ix_(own, own)].sum()))
    is_complete = low <= found <= high
    if not is_complete:  # what the few elements show of the effect is a part of it
        low, high = found + INCOMPLETE_RATIO * (low - found), found + INCOMPLETE_RATIO * (high - found)
    interval = min(low, found - half_width), max(high, found + half_width)
    return LawUncertainty(covariance, interval, is_complete)


def _possible_places(law: LawForces, sizes: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the places of possible forces: those found, and elements near them, which explain nearly as much.

    Those of all others are 0: they cannot be smaller, and the records would differ more if they were larger.
    """
    found = np.flatnonzero(sizes)
    if not law.thresholds.size:
        return found
    parts, places = np.divmod(found, law.thresholds.size)
    near = places[:, None] + np.arange(-NEIGHBOURHOOD, NEIGHBOURHOOD + 1)
    is_there = (near >= 0) & (near < law.thresholds.size)
    return np.unique((parts[:, None] * law.thresholds.size + near)[is_there])


def _weakening_columns(
    law: LawForces, sizes: NDArray[np.float64], dead_time: float, records: LineRecords
) -> NDArray[np.float64]:
    """Return how the weighted forces change with Stribeck effects that a law lacks, a column for each.

    It is that of a few elements along the law's virgin curve (generalized Maxwell slip), per unit of excess.
    """
    thresholds, forces = _lumped(law, sizes)
    weakening = columns_of(unit_law(GeneralizedMaxwellSlip, records.swing, records.speed), thresholds)
    columns = []
    for part in ALTERNATIVE_VELOCITIES:
        for rate in ALTERNATIVE_RATES_S:
            sizes_of = [
                {"N": excess, "m/s": part * records.speed, "N/s": rate}
                for excess in (ALTERNATIVE_EXCESS, MIN_EXCESS_RATIO * ALTERNATIVE_EXCESS)
            ]
            few = [replace(weakening, shape=weakening.starting_at(each)) for each in sizes_of]
            changed, plain = (records.deflection(each) @ forces for each in few)
            change = (changed - plain) / ALTERNATIVE_EXCESS
            columns.append(records.problem(change[..., None], dead_time).matrix)
    return np.concatenate(columns, axis=1)


def _lumped(law: LawForces, sizes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return thresholds [m] and forces [N] of a few elements with the law's virgin curve."""
    x, coulomb = np.geomspace(1e-9, 1e-1, 400), float(sizes[law.is_coulomb].sum())
    force = np.maximum.accumulate(law.virgin_columns(x) @ sizes)
    levels = (np.arange(LUMPS) + 0.5) / LUMPS * force[-1]
    return np.interp(levels, force + 1e-12 * force[-1] * np.arange(x.size), x), np.full(LUMPS, coulomb / LUMPS)


def profile_interval(search: LawSearch, dead_time: float, stds: float) -> tuple[float, float]:
    """Return the least and greatest Coulomb force [N] of a law by some standard deviations, by what it leaves.

    At each force dead time, shape and sizes are found anew: derivatives at the best shape do not show how far the force
    may go, as friction that weakens slowly is Coulomb friction of another size, with a shape far away. Beyond
    `MAX_CHANGE` an end is not looked for.
    """
    best = search.values(search.law_at_start, dead_time)
    force, least = float(search.solve(best).sizes[search.law_at_start.is_coulomb].sum()), search.cost(best)
    rise = stds**2 * least / search.records.equations

    def end(sign: float) -> float:
        """Return an end [N] by the root of the rise, which is linear near the best."""
        change, before, values = FIRST_CHANGE, (0.0, 0.0), best
        while True:
            held = force * (1 + sign * change)
            values = search.minimised(values, held, CHANGE_TRIALS)
            size = float(np.sqrt(max(search.cost(values, held) - least, 0.0) / rise))
            if size >= 1 or change >= MAX_CHANGE:
                part = min((1 - before[1]) / (size - before[1]), 1.0) if size > before[1] else 1.0
                return force * (1 + sign * (before[0] + part * (change - before[0])))
            before, change = (change, size), 2 * change

    return end(-1.0), end(1.0)
