"""Which friction law explains records at several amplitudes, with the interval of its Coulomb force."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    COARSE_DIFFERENCE,
    CONVERGED,
    MAX_ITERATIONS,
    NORMAL_QUANTILE,
    ROUNDING,
    Finding,
    RecordError,
    Signals,
    significant_deviation,
)
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.identification._law_comparison import equals_of_best, fit_each
from fraexp_plugins.identification._law_forces import (
    GridElements,
    Law,
    LawForces,
    columns_of,
    rolling_elements,
    unit_law,
)
from fraexp_plugins.identification._law_report import ACCEPTABLE, ELEMENT_RANGE, LawChoice, LawFit
from fraexp_plugins.identification._least_squares import HeldSum, inverse_square, minimise, solve_non_negative
from fraexp_plugins.identification._line_records import LawSolution, LineRecords, some_frequencies

SHAPE_STEP = 0.1
"""Scale of a step of a logarithm."""
MAX_SHIFT, MAX_DEAD_TIME = 7.0, 8.0
"""Distance of a logarithm from its start at most, and the largest dead time [samples]."""


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

    def solve(self, values: NDArray[np.float64]) -> LawSolution:
        """Return the sizes and residuals."""
        law = self.law(values)
        return self.records.solve(law, self.records.deflection(law), self.dead_time(values))

    def cost(self, values: NDArray[np.float64]) -> float:
        """Return the sum of squares."""
        return float(np.sum(self.solve(values).residual ** 2))

    def robust_cost(self, values: NDArray[np.float64]) -> float:
        """Return what no record decides alone."""
        return float(np.sum(np.log1p(self.solve(values).residual ** 2)))

    def beside_excess(self, start: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values whose further forces are the excess that explains most of the records, to first order.

        Without an excess no number of a Stribeck effect changes a force, and with one that is too large the best such
        effect is one that the records do not show: a search finds neither way.
        """
        free = [1 + place for place, unit in enumerate(self.law_at_start.units) if unit == "N"]
        if not free:
            return start
        values = start.copy()
        values[free] = np.log(ROUNDING)
        before = self.solve(values).residual
        values[free] = np.log(COARSE_DIFFERENCE)
        slope = (self.solve(values).residual - before) / COARSE_DIFFERENCE
        excess = -float(slope @ before) / max(float(slope @ slope), ROUNDING)
        values[free] = np.log(max(excess, COARSE_DIFFERENCE))
        return values

    def minimised(self, start: NDArray[np.float64], is_robust: bool = False) -> NDArray[np.float64]:
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
            lambda free: self.solve(complete(free)).residual,
            start[is_free],
            (low[is_free], high[is_free]),
            MAX_ITERATIONS,
            x_scale=SHAPE_STEP,
            diff_step=COARSE_DIFFERENCE,
            ftol=CONVERGED / 10,
            gtol=ROUNDING,
            loss="soft_l1" if is_robust else "linear",
        )
        return complete(found)


ALTERNATIVE_VELOCITIES, ALTERNATIVE_RATES_S, ALTERNATIVE_EXCESS = (0.1, 0.4, 1.0), (12.0, 60.0), 0.05
"""Stribeck velocities over the largest velocity, rates of attraction over the Coulomb force, and static over Coulomb
force less 1, of a Stribeck effect beside a law, by which its Coulomb force is judged."""
INCOMPLETE_RATIO = 2.0
"""Factor on the change of the Coulomb force where a Stribeck effect beside a law explains more of the records."""
LUMPS = 6
"""Number of elements that weaken beside a law."""
NEIGHBOURHOOD = 3
"""Places on the grid around an element at which another one may be in its place."""


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
    # a ridge decides between columns that are equal
    ridge = ROUNDING * float(np.linalg.norm(reduced, axis=0).max()) * np.eye(count)
    rows, ends = np.concatenate([reduced, ridge]), np.append(right, np.zeros(count))
    best = solve_non_negative(rows, ends)
    total, least = float(best[chosen].sum()), float(np.sum((reduced @ best - right) ** 2))

    def excess(held: float) -> float:
        x = solve_non_negative(rows, ends, held=HeldSum(chosen, held))
        return float(np.sum((reduced @ x - right) ** 2)) - least - rise

    low = 0.0 if excess(0.0) <= 0 else float(brentq(excess, 0.0, total, rtol=CONVERGED))
    step = max(total, CONVERGED) / 32
    for _ in range(MAX_ITERATIONS):
        if excess(total + step) > 0:
            return low, float(brentq(excess, total, total + step, rtol=CONVERGED))
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
    low, high = sum_interval(matrix, problem.target, chosen, significant_deviation() ** 2 * max(square, 1.0))
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
                for excess in (ALTERNATIVE_EXCESS, COARSE_DIFFERENCE * ALTERNATIVE_EXCESS)
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


SEARCH_STEP, SEARCH_OVERSAMPLING = 3, 2
"""Every third frequency is taken in the search for a law, and that many points per sample; all of them judge it."""
FAST_LAWS, SLOW_LAWS = (Dahl, LuGre, Elastoplastic), (GeneralizedMaxwellSlip,)
"""Other laws that fraexp has, the cheapest first: those of elements come after a user's own."""
THRESHOLD_COUNTS = 80, 40
"""Numbers of thresholds of rolling elements, and of others."""
START_PARTS = np.linspace(0.0, 1.0, 5)
"""Parts of what the records contain below which a size lies with which a search may begin. A start that is wrong by a
factor of three leads as far: half as many leave factors of ten between the velocities of records of a wide band."""
START_RELAXATIONS = (0.03, 0.15, 0.75, 3.0, 12.0)
"""Relaxation times over the sample time, one of which is taken: up to 1.7 times as long ones are made of it."""
NARROW_RANGES = 0.05, 0.2
"""Widths over the largest motion beyond which a law may have no elements."""


class LawSelection:
    """The choice of the law that explains records best.

    A law drives friction along the measured motion: G U = Y/P + F(y) at each line and its odd harmonics, with a free
    1/P at each of them. What is linear is eliminated (variable projection: G. H. Golub and V. Pereyra, SIAM J.
    Numerical Analysis 10(2), 1973, doi 10.1137/0710036); shape parameters are found from several starts. A record
    counts by what the encoder's errors do to its friction, by the best law so far: where stiff bristles bend by a few
    steps of the encoder, these errors are a hundred times those of a record that slides.
    """

    def __init__(self, signals: Signals, observer: EffectiveInput, model_error: float, is_delayed: bool) -> None:
        """Take the records; with `is_delayed` a dead time is found too, beside that of the observer."""
        self._coarse = observer.model_copy(update={"oversampling": min(observer.oversampling, SEARCH_OVERSAMPLING)})
        self._signals, self._model_error, self._is_delayed = signals, model_error, is_delayed
        self._bare = self._records = LineRecords.of(signals, observer, model_error)
        if self._bare.known.shape[1] < 2:
            raise RecordError(
                "plant_and_friction: each line is in one record; expected several: record two amplitudes, a factor of "
                "2 apart (excitation 'concatenated'), or realisations of a multisine"
            )
        self._few = self._some = LineRecords.of(some_frequencies(signals, SEARCH_STEP), self._coarse, model_error)
        self._fits: list[LawFit] = []
        self._doubts: dict[LawFit, LawUncertainty] = {}

    def choose(self, laws: Sequence[Law], is_any: bool) -> LawChoice:
        """Return the best of a free set of elements and some laws, of those that fraexp has too if `is_any`.

        None is tried after one that leaves as little as any can, and beside which no Stribeck effect explains more.
        """

        def is_last(fit: LawFit) -> bool:
            return fit.is_good and self._uncertainty(fit, is_any).is_complete

        candidates: list[Law] = [*FAST_LAWS, *laws, *SLOW_LAWS] if is_any else list(laws)
        elements, left_out = self._with_elements(is_any), list[Finding]()
        if candidates and not is_last(elements):
            fit = partial(self._with_law, stated=laws)
            _, left_out = fit_each(candidates, fit, lambda law: law.name, is_last)
        judged = (fit for fit in self._fits if fit.sizes.size)
        equals = [fit for _, fit in equals_of_best(judged, lambda fit: fit.prediction)]
        best = next(filter(is_last, equals), equals[0])
        doubts = [self._uncertainty(each, is_any) for each in (equals if not is_last(best) else [best])]
        chosen = self._without_springs(best)
        doubt = self._uncertainty(chosen, is_any)
        ends = np.array([each.interval for each in (doubt, *doubts)])
        interval = float(ends[:, 0].min()), float(ends[:, 1].max())
        tried = {fit.law.name: fit.residual for fit in self._fits}
        return LawChoice(chosen, doubt.covariance, interval, self._records, tried, chosen.dead_time, tuple(left_out))

    def _with_elements(self, is_any: bool) -> LawFit:
        """Return the fit of a free set of elements, with dampers if they may be `is_any`, to which others compare."""
        thresholds = self._bare.swing * np.geomspace(*ELEMENT_RANGE, THRESHOLD_COUNTS[0])
        times = [ratio * self._bare.sample_time for ratio in START_RELAXATIONS] if is_any else [None]
        shapes = [rolling_elements(thresholds, time).shape for time in times]
        delays = MAX_DEAD_TIME * START_PARTS if self._is_delayed else np.zeros(1)
        starts = [np.array([delay, *shape]) for shape in shapes for delay in delays]
        return self._fitted(rolling_elements(thresholds, times[0]), starts)

    def _with_law(self, given: Law, stated: Sequence[Law]) -> LawFit:
        """Return the fit of a law that begins where the elements end, and at its own numbers if it is `stated`."""
        thresholds, sizes = self._bare.swing * np.geomspace(*ELEMENT_RANGE, THRESHOLD_COUNTS[1]), self._sizes()
        unit = unit_law(given, float(np.median(sizes["m"])), self._bare.speed)
        law = columns_of(unit, thresholds, 2 * float(self._bare.frequency.min()))
        search, delay = LawSearch(self._some, law, self._is_delayed), self._fits[0].dead_time / self._bare.sample_time
        starts = [search.beside_excess(np.array([delay, *shape])) for shape in _starts(law, sizes)]
        starts += [np.array([delay, *law.starting_at({})])] if given in stated else []
        starts += [np.array([delay, *_starts(law, known)[0]]) for known in self._known_sizes()]
        return self._fitted(law, starts)

    def _fitted(self, law: LawForces, starts: Sequence[NDArray[np.float64]]) -> LawFit:
        """Return the law to which the best start leads, by all records unless it is hopeless."""
        place, most = len(self._fits), ACCEPTABLE * min((each.residual for each in self._fits), default=np.inf)
        fit = self._searched(law, starts)
        self._fits.append(fit if fit.residual > most else self._judged(fit, self._records))
        self._weigh_by(place)
        if self._fits[place].explains and law.units and not law.is_linear:
            self._fits[place] = self._shaped(self._fits[place])
        if self._fits[place].explains:
            self._weigh_by(place)  # once more: its sizes have changed, and perhaps its shape
        return self._fits[place]

    def _uncertainty(self, fit: LawFit, is_any: bool) -> LawUncertainty:
        if fit not in self._doubts:
            self._doubts[fit] = law_uncertainty(fit.law, fit.dead_time, self._records, is_any)
        return self._doubts[fit]

    @cached_property
    def _every(self) -> LineRecords:
        """All records, along whose motions the steps take half as long as those by which a law is judged."""
        return LineRecords.of(self._signals, self._coarse, self._model_error)

    def _sizes(self) -> dict[str, NDArray[np.float64]]:
        """Return sizes of what the records contain, by their unit, shape (n,) each, at which a search may begin.

        Widths are those at which parts of the elements slip, and those of the laws before, velocities those of the
        excited lines, and rates of attraction their frequencies.
        """
        elements, records = self._fits[0], self._bare
        assert isinstance(elements.law, GridElements)
        slipping = np.cumsum(elements.law.element_forces(elements.sizes))
        widths = np.interp(START_PARTS[1:-1] * slipping[-1], slipping, elements.law.thresholds)
        omega = 2 * np.pi * records.frequency
        excited = (omega[:, None] * np.abs(records.motion))[records.known & records.is_excited[:, None]]
        return {
            "m": np.concatenate([widths, *(known["m"] for known in self._known_sizes() if "m" in known)]),
            "m/s": np.geomspace(excited.min(), excited.max(), START_PARTS.size),
            "N/s": np.geomspace(omega.min(), omega[records.is_excited].max(), START_PARTS.size),
        }

    def _known_sizes(self) -> Iterator[dict[str, NDArray[np.float64]]]:
        """Yield what the laws that were fitted say of the width, the Stribeck effect and the rates of another one."""
        for fit in self._fits:
            known = dict(zip(fit.law.units, np.exp(fit.law.shape)[:, None], strict=True))
            known |= {"m": 1 / known["N/m"]} if "N/m" in known else {}
            yield {unit: value for unit, value in known.items() if unit in ("m", "N/s", "N", "m/s")}

    def _searched(self, law: LawForces, starts: Sequence[NDArray[np.float64]]) -> LawFit:
        """Return the law to which the best start leads, with a grid that is refined once."""
        search = LawSearch(self._some, law, self._is_delayed)
        best = min(starts, key=search.robust_cost)
        if not search.solve(best).sizes.any():  # a search that begins with no force finds none
            best = min(starts, key=search.cost)
        for _ in range(2):
            best = search.minimised(best, is_robust=True)
            finer = search.law(best).refine(search.solve(best).sizes)
            if finer.thresholds is law.thresholds:
                break
            law = finer
            search = LawSearch(self._some, law, self._is_delayed)
        left = float(np.sqrt(search.cost(best) / self._some.equations))
        return LawFit(search.law(best), search.dead_time(best), left, np.empty(0))

    def _judged(self, fit: LawFit, records: LineRecords) -> LawFit:
        """Return a law with what it leaves of all records; what noise explains of that follows from some."""
        some = self._some
        sizes, left, _ = records.solve(fit.law, records.deflection(fit.law), fit.dead_time)
        residual = float(np.sqrt(np.sum(left**2) / records.equations))
        model = fit.law.model(sizes, 0.0)
        noise = np.abs(some.force(model, some.shaken_motions(0)) - some.force(model)) ** 2 / some.variance
        allowance = float(np.sqrt(np.sum(noise[some.known]) / some.equations))
        return LawFit(fit.law, fit.dead_time, residual, sizes, allowance, records.equations)

    def _weigh_by(self, place: int) -> None:
        """Weight the records by what noise does by way of a law, if none is better."""
        fit = self._fits[place]
        if fit is not _best(self._fits):
            return
        self._doubts.clear()
        self._some, weighted = (each.with_friction_noise(fit.law, fit.sizes) for each in (self._few, self._bare))
        plain, free = (self._judged(fit, records) for records in (weighted, weighted.as_free_body()))
        is_free = free.prediction.equals(plain.prediction)  # not where a mode or a spring is near
        self._records = weighted.as_free_body() if is_free else weighted
        self._fits = [self._judged(each, self._records) if each.sizes.size else each for each in self._fits]

    def _shaped(self, fit: LawFit) -> LawFit:
        """Return a law of the best shape by all records.

        Where the coarser steps do not lead to a good law, the finer ones by which it is judged follow.
        """
        for each in (self._every, self._records):
            weighted = replace(each, variance=self._records.variance, free_lines=self._records.free_lines)
            search = LawSearch(weighted, fit.law, self._is_delayed)
            values = search.minimised(search.values(fit.law, fit.dead_time))
            shaped = replace(fit, law=search.law(values), dead_time=search.dead_time(values))
            fit = _best([fit, self._judged(shaped, self._records)])
            if fit.is_good:
                break
        return fit

    def _without_springs(self, fit: LawFit) -> LawFit:
        """Return a law without its widest elements, if they explain hardly anything, else the law.

        An element that slips in few records is a spring in the others, and 1/P of each line hides springs. Forces
        cannot be negative: errors of the records thus add springs, never take any off, and the Coulomb force becomes
        too great.
        """
        law, records, count = fit.law, self._records, fit.law.thresholds.size
        for part in NARROW_RANGES:
            is_narrow = law.thresholds <= part * records.swing
            if 1 < is_narrow.sum() < count:
                narrow = replace(law, thresholds=law.thresholds[is_narrow])
                own = np.tile(is_narrow, law.is_coulomb.size // count)  # they do not act on each other
                records.driven[narrow.key] = records.deflection(law)[..., own]
                found = self._judged(replace(fit, law=narrow), records)
                if found.prediction.equals(fit.prediction):
                    return found
        return fit


def _best(fits: Sequence[LawFit]) -> LawFit:
    """Return the law that leaves least of all records, which a hopeless one was not compared with."""
    return min((fit for fit in fits if fit.sizes.size), key=lambda fit: fit.residual)


def _starts(law: LawForces, sizes: Mapping[str, NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Return shapes with all combinations of sizes by their units; a width [m] is that of a stiffness too."""
    units = set(law.units) | ({"m"} if "N/m" in law.units else set())
    chosen = {unit: values.tolist() for unit, values in sizes.items() if unit in units}
    found = [dict(zip(chosen, values, strict=True)) for values in product(*chosen.values())]
    return [law.starting_at({**each, **({"N/m": 1 / each["m"]} if "m" in each else {})}) for each in found]
