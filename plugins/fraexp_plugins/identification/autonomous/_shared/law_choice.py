"""Which friction law explains records at several amplitudes, with the interval of its Coulomb force."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Signals
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import ElementObserver
from fraexp_plugins.identification.autonomous._shared.law_elements import (
    BristleElements,
    DahlElements,
    ElastoplasticElements,
    LawElements,
    RollingElements,
    WeakeningElements,
)
from fraexp_plugins.identification.autonomous._shared.law_interval import (
    INTERVAL_STDS,
    LawUncertainty,
    law_uncertainty,
)
from fraexp_plugins.identification.autonomous._shared.law_profile import LawProfile
from fraexp_plugins.identification.autonomous._shared.law_records import LawRecords, LawSolution

SEARCH_STEP = 3
"""Every third frequency is taken in the search for a law; all of them judge it."""
ROLLING_THRESHOLDS, WEAKENING_THRESHOLDS = 80, 40
"""Numbers of thresholds."""
THRESHOLD_RANGE = (1e-5, 0.7)
"""Range of thresholds over the largest motion."""
START_WIDTHS, START_VELOCITIES, START_EXCESS = np.geomspace(1e-4, 0.16, 9), (3e-3, 3e-2), 0.2
"""Widths over the largest motion, Stribeck over largest velocities, and static over Coulomb force less 1, at which a
search may begin."""
RESTART_VELOCITY = 0.3
"""The same velocity for bristles once those have led to no law: a search from Dahl's width may never leave it."""
WEAKENING_VELOCITIES = (*START_VELOCITIES, 0.1, 0.4, 1.0)
"""The same velocities for elements that weaken: they may do so in fast sliding alone, which bristles cannot hide."""
START_ODDS, START_WIDTH_RATIOS = 1.5, (0.4, 0.8, 1.6)
"""Elastic limit over the rest of the width at which a search begins, and widths over that of LuGre's law."""
START_RELAXATIONS = (0.03, 0.15, 0.75, 3.0, 12.0)
"""Relaxation times over the sample time, one of which is taken: up to 1.7 times as long ones are made of it."""
START_RATES_S = (10.0, 60.0)
"""Rates of attraction over the Coulomb force [1/s] at which a search begins."""
SHAPE_STEP, DIFFERENCE = 0.1, 1e-4
"""Scale of a step of a logarithm, and its difference for derivatives."""
MAX_SHIFT = 7.0
"""Distance of a logarithm from its start at most."""
MAX_TRIALS = 40
"""Steps of a search at most."""
SEARCH_TOLERANCE = 1e-4
"""Relative change of the sum of squares at which a search ends."""
START_DEAD_TIMES, MAX_DEAD_TIME = (0.5, 1.5, 3.0, 5.0), 8.0
"""Dead times at which a search may begin, and the largest one [samples]."""
GOOD, ACCEPTABLE = 1.5, 2.0
"""Residual over its allowance from which on no other law is tried, and up to which a law explains the records."""
NOISE_ALLOWANCE = 6.0
"""Factor on the part of the residual that noise explains by way of friction."""
SEARCH_OVERSAMPLING = 2
"""Points per sample at which the motion drives friction in a search."""
HOPELESS_RATIO = 2.0
"""Residual in a search over that of the best law from which a law is not looked at any further."""
MAX_STRAIN = 10.0
"""Strain up to which the lowest frequencies are those of a free body: with the first mode at the highest of them it is
over 1000."""
EQUAL_RATIO = 1.3
"""Residual over that of the best law up to which a law is as good."""
NARROW_RANGES, NARROW_RATIO = (0.05, 0.2), 1.15
"""Widths over the largest motion beyond which a law may have no elements, and residual without these over that with
them up to which they are left out."""

LawStart = tuple[float, ...]


class LawFamily(NamedTuple):
    """Laws that differ in their shape parameters alone."""

    elements: Callable[[NDArray[np.float64]], LawElements]
    """Makes the forces of shape parameters."""
    starts: list[LawStart]
    is_linear: bool = False
    """Whether a start is as good as its best shape."""
    restarts: Sequence[LawStart] = ()
    """Starts of a second search, where the first one leads to no good law."""


@dataclass(frozen=True)
class LawFit:
    """A law that was fitted to records."""

    elements: LawElements
    sizes: NDArray[np.float64]
    """Force of each column [N], shape (N,)."""
    residual: float
    """Root mean square of the residuals of all records over what is allowed for."""
    allowance: float
    """The same, as far as noise explains it."""
    dead_time: float
    """Dead time that goes with it [s]."""
    strain: float = 0.0
    """Mean square of what it leaves of the equations of a free body, over that of all or over what is allowed for."""

    @property
    def coulomb(self) -> float:
        """Force in gross sliding [N]."""
        return float(self.sizes[self.elements.is_coulomb].sum())

    @property
    def is_good(self) -> bool:
        """Whether no other law can do better."""
        return self.residual**2 <= GOOD**2 + self.allowance**2

    @property
    def explains(self) -> bool:
        """Whether noise and rounding explain what the law leaves."""
        return self.residual**2 <= ACCEPTABLE**2 + NOISE_ALLOWANCE * self.allowance**2


@dataclass(frozen=True)
class LawChoice:
    """The law that explains the records best."""

    best: LawFit
    covariance: NDArray[np.float64]
    """Covariance of its shape and then of its sizes, shape (S + N, S + N)."""
    interval: tuple[float, float]
    """95 % interval of the Coulomb force [N]: that of all laws that are as good."""
    records: LawRecords
    residuals: dict[str, float]
    """Residual of each law that was tried."""

    def doubt(self) -> str:
        """Return why no law is to be believed."""
        left = ", ".join(f"{name} {residual:.3g}" for name, residual in self.residuals.items())
        return (
            f"no friction law explains the records; residual over what is allowed for: {left}, expected "
            f"{ACCEPTABLE:g}: friction may depend on the position, or be of another kind"
        )

    def sizes(self, dead_time: float) -> NDArray[np.float64]:
        """Return the force of each column [N] with another dead time [s], shape (N,)."""
        return self.records.solve(self.deflection, dead_time).sizes

    @cached_property
    def deflection(self) -> NDArray[np.complex128]:
        """The phasors of each column, complex, shape (L, M, N)."""
        return self.records.deflection(self.best.elements)


def choose_law(
    signals: Signals,
    observer: ElementObserver,
    inverse: tuple[NDArray[np.float64], NDArray[np.complex128]],
    is_delayed: bool,
) -> LawChoice:
    """Return the law that explains the records best, with a rough 1/P̂ [N/m] at its frequencies [Hz].

    With `is_delayed` a dead time is found too, beside that of the observer.

    The law drives friction along the measured motion: G U = Y/P̂ + F(y) at each line and its odd harmonics, with a free
    1/P̂ at each of them. What is linear is eliminated (variable projection: G. H. Golub and V. Pereyra, SIAM J.
    Numerical Analysis 10(2), 1973, doi 10.1137/0710036); shape parameters are found from several starts. A record
    counts by what the encoder's errors do to its friction, by the best law so far: where stiff bristles bend by a few
    steps of the encoder, these errors are a hundred times those of a record that slides.
    """
    coarse = observer.model_copy(update={"oversampling": min(observer.oversampling, SEARCH_OVERSAMPLING)})
    bare = LawRecords.from_signals(signals, observer, inverse)
    few = LawRecords.from_signals(signals, coarse, inverse, SEARCH_STEP)
    every = LawRecords.from_signals(signals, coarse, inverse)
    records, some, fits = bare, few, list[LawFit]()
    profiles: dict[int, LawProfile] = {}

    @cache
    def uncertainty(place: int) -> LawUncertainty:
        return law_uncertainty(fits[place].elements, fits[place].dead_time, records)

    def weigh_by(place: int) -> None:
        nonlocal some, records
        fit = fits[place]
        if fit is _best(fits):  # no other law knows better what noise does
            for plain in (bare.as_free_body(), bare):  # the second where a mode or a spring is near
                some, records = (each.with_friction_noise(fit.elements, fit.sizes) for each in (few, plain))
                fits[:] = [_judged(each, some, records) if each.sizes.size else each for each in fits]
                if _best(fits).strain <= MAX_STRAIN:
                    break
            uncertainty.cache_clear()

    for family in _families(bare, fits):
        fit, place = _searched(family, some, is_delayed), len(fits)
        is_hopeless = fit.residual > HOPELESS_RATIO * min((each.residual for each in fits), default=np.inf)
        fits.append(fit if is_hopeless else _judged(fit, some, records))
        weigh_by(place)
        if fits[place].explains and fits[place].elements.static_excess > 0:
            fits[place], profiles[place] = _shape_law(fits[place], some, every, records)
        weigh_by(place)  # once more: its sizes have changed, and perhaps its shape
        if fits[place].is_good and uncertainty(place).is_complete:
            break
    best = fits.index(_best(fits))
    most = EQUAL_RATIO * fits[best].residual
    equals = [place for place, fit in enumerate(fits) if fit.sizes.size and fit.residual <= most]
    for place in equals:
        if fits[place].is_good and uncertainty(place).is_complete:  # no other law would have been tried
            best, equals = place, [place]
            break
    chosen, doubt = _without_springs(fits[best], uncertainty(best), some, records)
    intervals = [doubt.interval, *(uncertainty(place).interval for place in equals)]
    if best in profiles:
        intervals.append(profiles[best].interval(INTERVAL_STDS))
    interval = min(low for low, _ in intervals), max(high for _, high in intervals)
    tried = {fit.elements.name: fit.residual for fit in fits}
    return LawChoice(chosen, doubt.covariance, interval, records, tried)


def _best(fits: Sequence[LawFit]) -> LawFit:
    """Return the law that leaves least of all records, which a hopeless one was not compared with."""
    return min((fit for fit in fits if fit.sizes.size), key=lambda fit: fit.residual)


def _families(records: LawRecords, fits: Sequence[LawFit]) -> Iterator[LawFamily]:
    """Yield the laws, the cheapest ones first; `fits` are those that were fitted already."""
    largest = _largest_motion(records)
    velocity = float((2 * np.pi * records.lines.frequency[:, None] * np.abs(records.lines.motion)).max())
    sample_time = records.signals.segments[0].sample_time
    thresholds = largest * np.geomspace(*THRESHOLD_RANGE, ROLLING_THRESHOLDS)
    yield LawFamily(
        lambda shape: RollingElements(shape, thresholds), [(ratio * sample_time,) for ratio in START_RELAXATIONS], True
    )
    yield LawFamily(DahlElements, [(ratio * largest,) for ratio in START_WIDTHS.tolist()])
    width = float(np.exp(fits[-1].elements.shape[0]))
    bristles: list[LawStart] = [
        (start, START_EXCESS, part * velocity)
        for start in (width, *(largest * START_WIDTHS).tolist())
        for part in START_VELOCITIES
    ]
    again = [(start, START_EXCESS, RESTART_VELOCITY * velocity) for start in (largest * START_WIDTHS).tolist()]
    yield LawFamily(BristleElements, bristles, restarts=again)
    near = np.exp(fits[-1].elements.shape)
    curves = [near[1:].tolist(), *([START_EXCESS, part * velocity] for part in START_VELOCITIES)]
    yield LawFamily(
        ElastoplasticElements,
        [(ratio * near[0], *curve, START_ODDS) for ratio in START_WIDTH_RATIOS for curve in curves],
    )
    few = largest * np.geomspace(*THRESHOLD_RANGE, WEAKENING_THRESHOLDS)
    yield LawFamily(
        lambda shape: WeakeningElements(shape, few, 2 * float(records.lines.frequency.min())),
        [(START_EXCESS, part * velocity, rate) for part in WEAKENING_VELOCITIES for rate in START_RATES_S],
    )


def _largest_motion(records: LawRecords) -> float:
    """Return the greatest amplitude of all records [m]."""
    return max(float(np.ptp(motion.displacement)) / 2 for motion in records.motions)


def _searched(family: LawFamily, records: LawRecords, is_delayed: bool) -> LawFit:
    """Return the law of a family that explains some records best, after a second search if the first one fails."""
    fit = _searched_from(family, family.starts, records, is_delayed)
    if fit.residual <= GOOD or not family.restarts:
        return fit
    return min(fit, _searched_from(family, family.restarts, records, is_delayed), key=lambda each: each.residual)


def _searched_from(family: LawFamily, begins: Sequence[LawStart], records: LawRecords, is_delayed: bool) -> LawFit:
    """Return the law to which the best start leads, with a grid that is refined once."""
    sample_time = records.signals.segments[0].sample_time
    search = _Search(records, family.elements)
    delays = START_DEAD_TIMES if is_delayed else (0.0,)
    starts = [np.array([delay, *np.log(start)]) for start in begins for delay in delays]
    best = min(starts, key=search.cost)
    if not search.solve_for(best).sizes.any():  # a search that begins with no force finds none
        best = min(starts, key=lambda each: float(np.sum(search.solve_for(each).residual ** 2)))
    for _ in range(2):
        best = search.minimised(best, family.is_linear, is_delayed)
        elements = search.elements(best[1:])
        finer = elements.refine(search.solve_for(best).sizes)
        if finer is elements:
            break
        search = _Search(records, partial(_with_shape, finer))
    left = float(np.sqrt(np.sum(search.solve_for(best).residual ** 2) / records.equations))
    delay = max(float(best[0]), 0.0) * sample_time
    return LawFit(search.elements(best[1:]), np.empty(0), left, 0.0, delay)


def _with_shape(elements: LawElements, shape: NDArray[np.float64]) -> LawElements:
    return replace(elements, shape=shape)


class _Search:
    """What the laws of a family leave of some records, by dead time [samples] and shape."""

    def __init__(self, records: LawRecords, elements: Callable[[NDArray[np.float64]], LawElements]) -> None:
        self._records, self.elements = records, elements
        self._sample_time = records.signals.segments[0].sample_time
        self._known: dict[bytes, NDArray[np.complex128]] = {}

    def solve_for(self, values: NDArray[np.float64]) -> LawSolution:
        """Return the sizes and residuals for a dead time and a shape."""
        key = values[1:].tobytes()
        if key not in self._known:
            self._known.clear()
            self._known[key] = self._records.deflection(self.elements(values[1:]))
        return self._records.solve(self._known[key], values[0] * self._sample_time)

    def cost(self, values: NDArray[np.float64]) -> float:
        """Return what no record decides alone."""
        return float(np.sum(np.log1p(self.solve_for(values).residual ** 2)))

    def minimised(self, start: NDArray[np.float64], is_linear: bool, is_delayed: bool) -> NDArray[np.float64]:
        """Return dead time and shape that leave least, from a start on; a linear family keeps its shape."""
        from scipy.optimize import least_squares  # slow to import: only when something is estimated

        free = 1 if is_linear else start.size
        low, high = start - MAX_SHIFT, start + MAX_SHIFT
        low[0], high[0] = (-1e-9, MAX_DEAD_TIME) if is_delayed else (-1e-9, 1e-9)
        found = least_squares(
            lambda values: self.solve_for(np.concatenate([values, start[free:]])).residual,
            start[:free], bounds=(low[:free], high[:free]), x_scale=SHAPE_STEP, diff_step=DIFFERENCE, loss="soft_l1",
            max_nfev=MAX_TRIALS, ftol=SEARCH_TOLERANCE,
        )  # fmt: skip
        return np.concatenate([found.x, start[free:]])


def _shape_law(fit: LawFit, some: LawRecords, coarse: LawRecords, records: LawRecords) -> tuple[LawFit, LawProfile]:
    """Return a law of the best shape by all records, and the profile from there.

    The steps of the search take half as long, and lead to the same shape as a rule. Where they do not lead to a good
    law, the finer steps by which it is judged follow.
    """
    for each in (coarse, records):
        weighted = replace(each, variance=records.variance, free_lines=records.free_lines)
        profile = LawProfile(fit.elements, fit.dead_time, weighted)
        shaped = replace(fit, elements=profile.elements, dead_time=profile.dead_time)
        fit = _best([fit, _judged(shaped, some, records)])
        if fit.is_good:
            break
    return fit, profile


def _without_springs(
    fit: LawFit, doubt: LawUncertainty, some: LawRecords, records: LawRecords
) -> tuple[LawFit, LawUncertainty]:
    """Return a law without its widest elements, if they explain hardly anything, else the law; and its uncertainty.

    An element that slips in few records is a spring in the others, and 1/P̂ of each line hides springs. Forces cannot be
    negative: errors of the records thus add springs, never take any off, and the Coulomb force becomes too great.
    """
    elements = fit.elements
    if not isinstance(elements, RollingElements | WeakeningElements):
        return fit, doubt
    largest = _largest_motion(records)
    for part in NARROW_RANGES:
        narrow = elements.thresholds[elements.thresholds <= part * largest]
        if 1 < narrow.size < elements.thresholds.size:
            found = _judged(replace(fit, elements=replace(elements, thresholds=narrow)), some, records)
            if found.residual <= NARROW_RATIO * fit.residual:
                return found, law_uncertainty(found.elements, found.dead_time, records)
    return fit, doubt


def _judged(fit: LawFit, some: LawRecords, records: LawRecords) -> LawFit:
    """Return a law with what it leaves of all records; what noise explains of that follows from some."""
    elements = fit.elements
    sizes, left, _ = records.solve(records.deflection(elements), fit.dead_time)
    residual = float(np.sqrt(np.sum(left**2) / records.equations))
    of_body = float(np.sum(left[2 * records.lines.known.size :] ** 2)) / max(records.free_equations, 1)
    law, acting = elements.acting(sizes)
    changes = some.deflection(law, some.shaken_motions(0)) - some.deflection(law)
    noise = np.abs(changes @ acting) ** 2 / some.variance
    allowance = float(np.sqrt(np.sum(noise[some.lines.known]) / some.equations))
    return replace(fit, sizes=sizes, residual=residual, allowance=allowance, strain=of_body / max(residual, 1.0) ** 2)
