"""How far the records determine a law's sizes, shape and Coulomb force, beside what they may hide."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.autonomous._law_elements import LawElements, built_in_laws
from fraexp_plugins.identification.autonomous._law_records import LawRecords

RIDGE_RATIO = 1e-6
"""Weight of a ridge over that of the largest column: it decides between columns that are equal."""
CONSTRAINT_WEIGHT = 1e4
"""Weight of the equation that holds the sum, over that of the largest column."""
EDGE_TOLERANCE = 1e-3
"""Relative tolerance of an end of the interval."""
MAX_DOUBLINGS = 20
"""Steps in which an upper end is looked for; each is twice as long as the one before."""


def sum_interval(
    matrix: NDArray[np.float64], target: NDArray[np.float64], chosen: NDArray[np.bool_], rise: float
) -> tuple[float, float]:
    """Return the least and greatest Σ x_j over the `chosen` columns for which |A x - b|² is near its minimum.

    It is the profile likelihood of the sum over x >= 0: the sum of squares, minimised over all other directions, lies
    at most `rise` above that of the best x. Columns that may replace one another make it wide, whichever of them the
    best x has (S. A. Murphy and A. W. van der Vaart, Journal of the American Statistical Association 95(450), 2000,
    doi 10.1080/01621459.2000.10474219). The profile is convex. `matrix` A has the shape (m, N), `chosen` (N,).
    """
    from scipy.optimize import nnls  # slow to import: only when something is estimated

    count = matrix.shape[1]
    triangle = np.linalg.qr(np.column_stack([matrix, target])).R
    reduced, right = triangle[:, :-1], triangle[:, -1]
    scale = float(np.linalg.norm(reduced, axis=0).max())
    ridge, hold = RIDGE_RATIO * scale * np.eye(count), CONSTRAINT_WEIGHT * scale * chosen[None].astype(float)
    zeros = np.zeros(count)

    def cost_at(total: float) -> float:
        rows = np.concatenate([reduced, ridge, hold])
        x, _ = nnls(rows, np.concatenate([right, zeros, [CONSTRAINT_WEIGHT * scale * total]]), maxiter=100 * count)
        return float(np.sum((reduced @ x - right) ** 2))

    x, _ = nnls(np.concatenate([reduced, ridge]), np.concatenate([right, zeros]), maxiter=100 * count)
    best, most = float(x[chosen].sum()), float(np.sum((reduced @ x - right) ** 2)) + rise

    def is_near(total: float) -> bool:
        return cost_at(total) <= most

    step = max(best, EDGE_TOLERANCE) / 32
    for _ in range(MAX_DOUBLINGS):
        if not is_near(best + step):
            break
        step *= 2
    low = 0.0 if is_near(0.0) else _edge(is_near, best, 0.0)
    return low, _edge(is_near, best, best + step)


def _edge(is_near: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return the end of an interval by bisection, on its outer side."""
    tolerance = EDGE_TOLERANCE * max(abs(inside), abs(outside))
    while abs(outside - inside) > tolerance:
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if is_near(middle) else (inside, middle)
    return outside


ALTERNATIVE_VELOCITIES, ALTERNATIVE_RATES_S, ALTERNATIVE_EXCESS = (0.1, 0.4, 1.0), (12.0, 60.0), 0.05
"""Stribeck velocities over the largest velocity, rates of attraction over the Coulomb force, and static over Coulomb
force less 1, of a Stribeck effect beside a law, by which its Coulomb force is judged."""
INTERVAL_STDS = 3.0
"""Standard deviations of an interval: the elements that weaken are not the law's own, and errors of a law are not
independent."""
INCOMPLETE_RATIO = 2.0
"""Factor on the change of the Coulomb force where a Stribeck effect beside a law explains more of the records."""
LUMPS, RIDGE = 6, 1e-10
"""Number of elements that weaken beside a law, and ridge of normal equations."""
MIN_EXCESS_RATIO = 1e-3
"""Static over Coulomb force, less 1, over that of a Stribeck effect, which is none."""
MIN_EXCESS = 1.0
"""Least mean square of the residuals that a covariance is computed with."""
SHAPE_DIFFERENCE = 1e-3
"""Difference of a logarithm for derivatives."""


class LawUncertainty(NamedTuple):
    """What the records leave open of a law."""

    covariance: NDArray[np.float64]
    """Covariance of the shape and then of the sizes, shape (S + N, S + N)."""
    interval: tuple[float, float]
    """Least and greatest Coulomb force [N]."""
    is_complete: bool
    """Whether a Stribeck effect beside the law explains no more of the records."""


def law_uncertainty(elements: LawElements, dead_time: float, records: LawRecords) -> LawUncertainty:
    """Return how far the records determine a law with this dead time [s].

    The interval is the profile likelihood of the Coulomb force. Beside the law's own sizes and shape a Stribeck effect
    that the law lacks is free too, at several velocities and lags: it can only weaken friction in sliding. Its scale is
    what the law leaves of the records, rather than what is allowed for.
    """
    deflection = records.deflection(elements)
    sizes, residual, problem = records.solve(deflection, dead_time)
    square = float(np.sum(residual**2)) / records.equations
    shapes = _shape_columns(elements, deflection, sizes, dead_time, records)
    weakening = _weakening_columns(elements, sizes, dead_time, records)
    kept = np.flatnonzero(sizes > 0)
    places = np.concatenate([np.arange(shapes.shape[1]), elements.shape.size + kept])
    covariance = np.zeros((elements.shape.size + sizes.size,) * 2)
    jacobian = np.concatenate([shapes, problem.matrix[:, kept]], axis=1)
    covariance[np.ix_(places, places)] = max(square, MIN_EXCESS) * _inverse_normal(jacobian)
    matrix = np.concatenate([problem.matrix, weakening, shapes, -shapes], axis=1)
    chosen = np.arange(matrix.shape[1]) < sizes.size
    chosen[: sizes.size] &= elements.is_coulomb
    low, high = sum_interval(matrix, problem.target, chosen, INTERVAL_STDS**2 * square)
    found = float(sizes[elements.is_coulomb].sum())
    is_complete = low <= found <= high
    if not is_complete:  # what the few elements show of the effect is a part of it
        low, high = found + INCOMPLETE_RATIO * (low - found), found + INCOMPLETE_RATIO * (high - found)
    return LawUncertainty(covariance, (min(low, found), max(high, found)), is_complete)


def _shape_columns(
    elements: LawElements,
    deflection: NDArray[np.complex128],
    sizes: NDArray[np.float64],
    dead_time: float,
    records: LawRecords,
) -> NDArray[np.float64]:
    """Return the derivative of the weighted forces by the shape, shape (equations, S); a linear law has none."""
    columns = [np.empty((2 * (records.lines.known.size + records.free_lines.size), 0))]
    for place in range(0 if elements.is_linear else elements.shape.size):
        moved = elements.shape + SHAPE_DIFFERENCE * (np.arange(elements.shape.size) == place)
        change = (records.deflection(replace(elements, shape=moved)) - deflection) @ sizes / SHAPE_DIFFERENCE
        columns.append(records.solve(change[..., None], dead_time).problem.matrix)
    return np.concatenate(columns, axis=1)


def _weakening_columns(
    elements: LawElements, sizes: NDArray[np.float64], dead_time: float, records: LawRecords
) -> NDArray[np.float64]:
    """Return how the weighted forces change with Stribeck effects that a law lacks, a column for each.

    It is that of a few elements along the law's virgin curve (generalized Maxwell slip), per unit of excess.
    """
    velocity = float((2 * np.pi * records.lines.frequency[:, None] * np.abs(records.lines.motion)).max())
    thresholds, forces = _lumped(elements, sizes)
    weakening = LawElements(built_in_laws(velocity)["gms"], np.empty(0), thresholds)
    columns = []
    for part in ALTERNATIVE_VELOCITIES:
        for rate in ALTERNATIVE_RATES_S:
            sizes_of = [
                {"N": excess, "m/s": part * velocity, "N/s": rate}
                for excess in (ALTERNATIVE_EXCESS, MIN_EXCESS_RATIO * ALTERNATIVE_EXCESS)
            ]
            few = [replace(weakening, shape=weakening.starting_at(each)) for each in sizes_of]
            changed, plain = (records.deflection(each) @ forces for each in few)
            change = (changed - plain) / ALTERNATIVE_EXCESS
            columns.append(records.solve(change[..., None], dead_time).problem.matrix)
    return np.concatenate(columns, axis=1)


def _lumped(elements: LawElements, sizes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return thresholds [m] and forces [N] of a few elements with the law's virgin curve."""
    x, coulomb = np.geomspace(1e-9, 1e-1, 400), float(sizes[elements.is_coulomb].sum())
    force = np.maximum.accumulate(elements.virgin_columns(x) @ sizes)
    levels = (np.arange(LUMPS) + 0.5) / LUMPS * force[-1]
    return np.interp(levels, force + 1e-12 * force[-1] * np.arange(x.size), x), np.full(LUMPS, coulomb / LUMPS)


def _inverse_normal(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of AᵀA, with a small ridge where it has none."""
    scale = np.linalg.norm(matrix, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    scaled = matrix / scale
    return np.asarray(np.linalg.inv(scaled.T @ scaled + RIDGE * np.eye(scale.size)) / np.outer(scale, scale))


FIRST_CHANGE, MAX_CHANGE = 0.01, 0.08
"""Relative change of the Coulomb force that is tried first, and the one from which the interval is wide enough to be of
no use; each change is twice the one before."""
FIRST_TRIALS, MAX_TRIALS, TOLERANCE = 10, 6, 1e-3
"""Steps of the shape at most, to the best one and at each change from there, and relative change of the sum of squares
at which they end."""
SHAPE_STEP, MAX_SHIFT, DIFFERENCE = 0.1, 7.0, 1e-4
"""Scale of a step of a logarithm, its distance from where it began at most, and its difference for derivatives."""
DEAD_TIME_RANGE = 1.0
"""Distance of the dead time from where it began at most [samples]."""


class LawProfile:
    """The least sum of squares that a law leaves of all records, by its Coulomb force.

    At each force dead time, shape and sizes are found anew: derivatives at the best shape do not show how far the force
    may go, as friction that weakens slowly is Coulomb friction of another size, with a shape far away.
    """

    def __init__(self, elements: LawElements, dead_time: float, records: LawRecords) -> None:
        self._records, self._law = records, elements
        self._sample_time = records.signals.segments[0].sample_time
        self._known: tuple[bytes, NDArray[np.complex128]] = (b"", np.empty(0, dtype=complex))
        self._start = np.array([dead_time / self._sample_time, *elements.shape])
        self._least, self._best = self._minimised(None, self._start)

    @property
    def elements(self) -> LawElements:
        """The law of the best shape."""
        return replace(self._law, shape=self._best[1:])

    @property
    def dead_time(self) -> float:
        """The dead time that goes with it [s]."""
        return float(self._best[0]) * self._sample_time

    def interval(self, stds: float) -> tuple[float, float]:
        """Return the least and greatest Coulomb force [N] by some standard deviations, by what the best shape leaves.

        Beyond `MAX_CHANGE` an end is not looked for.
        """
        sizes = self._records.solve(self._deflection(self._best), self.dead_time).sizes
        force, rise = float(sizes[self._law.is_coulomb].sum()), stds**2 * self._least / self._records.equations
        return self._end(force, -1.0, rise), self._end(force, 1.0, rise)

    def _end(self, force: float, sign: float, rise: float) -> float:
        """Return the end of the interval on one side [N], by the root of the rise, which is linear near the best."""
        change, before, values = FIRST_CHANGE, (0.0, 0.0), self._best
        while True:
            cost, values = self._minimised(force * (1 + sign * change), values)
            size = float(np.sqrt(max(cost - self._least, 0.0) / rise))
            if size >= 1:
                part = (1 - before[1]) / (size - before[1])
                return force * (1 + sign * (before[0] + part * (change - before[0])))
            if change >= MAX_CHANGE:
                return force * (1 + sign * change)
            before, change = (change, size), 2 * change

    def _minimised(self, force: float | None, start: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Return the least sum of squares, with a Coulomb force [N] if given; dead time [samples] and shape there."""
        from scipy.optimize import least_squares  # slow to import: only when something is estimated

        low, high = self._start - MAX_SHIFT, self._start + MAX_SHIFT
        low[0], high[0] = max(self._start[0] - DEAD_TIME_RANGE, -1e-9), self._start[0] + DEAD_TIME_RANGE
        trials = FIRST_TRIALS if force is None else MAX_TRIALS
        found = least_squares(
            lambda values: self._residual(values, force), np.clip(start, low, high), bounds=(low, high),
            x_scale=SHAPE_STEP, diff_step=DIFFERENCE, max_nfev=trials, ftol=TOLERANCE,
        )  # fmt: skip
        return 2 * float(found.cost), np.asarray(found.x)

    def _residual(self, values: NDArray[np.float64], force: float | None) -> NDArray[np.float64]:
        held = None if force is None else (self._law.is_coulomb, force)
        return self._records.solve(self._deflection(values), values[0] * self._sample_time, held).residual

    def _deflection(self, values: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the forces of a shape; those of the last one are kept, as the dead time has no effect on them."""
        key = values[1:].tobytes()
        if self._known[0] != key:
            self._known = key, self._records.deflection(replace(self._law, shape=values[1:]))
        return self._known[1]
