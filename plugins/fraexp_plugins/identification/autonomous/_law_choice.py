"""Which friction law explains records at several amplitudes, with the interval of its Coulomb force."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, Signals
from fraexp_plugins.identification.autonomous._autonomous_lines import ElementObserver
from fraexp_plugins.identification.autonomous._law_elements import LawElements, built_in_laws, unit_law
from fraexp_plugins.identification.autonomous._law_interval import (
    INTERVAL_STDS,
    LawProfile,
    LawUncertainty,
    law_uncertainty,
)
from fraexp_plugins.identification.autonomous._law_records import LawRecords, LawSolution

SEARCH_STEP = 3
"""Every third frequency is taken in the search for a law; all of them judge it."""
THRESHOLD_COUNTS = 80, 40
"""Numbers of thresholds of rolling elements, and of others."""
THRESHOLD_RANGE = (1e-5, 0.7)
"""Range of thresholds over the largest motion."""
START_WIDTHS, START_VELOCITIES, START_EXCESS = np.geomspace(1e-4, 0.16, 9), (3e-3, 3e-2), 0.2
"""Widths over the largest motion, Stribeck over largest velocities, and static over Coulomb force less 1, at which a
search may begin."""
RESTART_VELOCITY = 0.3
"""The same velocity for bristles once those have led to no law: a search from Dahl's width may never leave it."""
WEAKENING_VELOCITIES = (*START_VELOCITIES, 0.1, 0.4, 1.0)
"""The same velocities for elements that weaken: they may do so in fast sliding alone, which bristles cannot hide."""
START_WIDTH_RATIOS = (0.4, 0.8, 1.6)
"""Widths of elastoplastic bristles over that of LuGre's law, at which a search may begin."""
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


class LawFamily(NamedTuple):
    """Laws that differ in their shape alone."""

    elements: LawElements
    """The forces of a law, of some shape."""
    starts: list[NDArray[np.float64]]
    """Shapes at which a search may begin."""
    restarts: Sequence[NDArray[np.float64]] = ()
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
    others: Sequence[FrictionModel] = (),
) -> LawChoice:
    """Return the law that explains the records best, with a rough 1/P̂ [N/m] at its frequencies [Hz].

    With `is_delayed` a dead time is found too, beside that of the observer. Besides the laws that fraexp has, `others`
    are tried: of any law, with numbers at which a search may begin.

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

    for family in _families(bare, fits, others):
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


def _families(records: LawRecords, fits: Sequence[LawFit], others: Sequence[FrictionModel]) -> Iterator[LawFamily]:
    """Yield the laws, the cheapest ones first; `fits` are those that were fitted already."""
    largest = _largest_motion(records)
    velocity = float((2 * np.pi * records.lines.frequency[:, None] * np.abs(records.lines.motion)).max())
    sample_time = records.signals.segments[0].sample_time
    laws, widths = built_in_laws(velocity), (largest * START_WIDTHS).tolist()
    near, some, few = (np.empty(0), *(largest * np.geomspace(*THRESHOLD_RANGE, n) for n in THRESHOLD_COUNTS))
    rolling = LawElements(laws["rolling"], np.empty(0), some)
    relaxations = [{"N s/m": ratio * sample_time} for ratio in START_RELAXATIONS]
    yield LawFamily(rolling, [rolling.starting_at(each) for each in relaxations])
    dahl = LawElements(laws["dahl"], np.empty(0), near)
    yield LawFamily(dahl, [dahl.starting_at({"N/m": 1 / width}) for width in widths])
    width = float(np.exp(-fits[-1].elements.shape[0]))
    lugre = LawElements(laws["lugre"], np.empty(0), near)
    yield LawFamily(
        lugre,
        _starts(lugre, (width, *widths), START_VELOCITIES, velocity),
        _starts(lugre, widths, (RESTART_VELOCITY,), velocity),
    )
    best = np.exp(fits[-1].elements.shape)  # stiffness, excess and velocity
    bristles = LawElements(laws["elastoplastic"], np.empty(0), near)
    own = [bristles.starting_at({"N/m": best[0] / ratio, "N": best[1], "m/s": best[2]}) for ratio in START_WIDTH_RATIOS]
    ratios = [ratio / float(best[0]) for ratio in START_WIDTH_RATIOS]
    yield LawFamily(bristles, [*own, *_starts(bristles, ratios, START_VELOCITIES, velocity)])
    for model in others:
        law = LawElements(unit_law(model), np.empty(0), near)
        law = replace(law, thresholds=few) if law.has_elements else law
        yield LawFamily(law, [law.starting_at({}), *_starts(law, widths, START_VELOCITIES, velocity)])
    lowest = 2 * float(records.lines.frequency.min())
    weakening = LawElements(laws["gms"], np.empty(0), few, lowest)
    yield LawFamily(weakening, _starts(weakening, (1.0,), WEAKENING_VELOCITIES, velocity))


def _starts(
    law: LawElements, widths: Sequence[float], velocities: Sequence[float], velocity: float
) -> list[NDArray[np.float64]]:
    """Return shapes with these widths [m], Stribeck velocities over a velocity [m/s], and rates if the law has any."""
    found: list[NDArray[np.float64]] = []
    rates = START_RATES_S if "N/s" in law.units else (1.0,)
    for width, part, rate in product(widths, velocities, rates):
        sizes = {"N/m": 1 / width, "m": width, "N": START_EXCESS, "m/s": part * velocity, "N/s": rate}
        start = law.starting_at(sizes)
        if not any(np.array_equal(start, other) for other in found):
            found.append(start)
    return found


def _largest_motion(records: LawRecords) -> float:
    """Return the greatest amplitude of all records [m]."""
    return max(float(np.ptp(motion.displacement)) / 2 for motion in records.motions)


def _searched(family: LawFamily, records: LawRecords, is_delayed: bool) -> LawFit:
    """Return the law of a family that explains some records best, after a second search if the first one fails."""
    fit = _searched_from(family, family.starts, records, is_delayed)
    if fit.residual <= GOOD or not family.restarts:
        return fit
    return min(fit, _searched_from(family, family.restarts, records, is_delayed), key=lambda each: each.residual)


def _searched_from(
    family: LawFamily, begins: Sequence[NDArray[np.float64]], records: LawRecords, is_delayed: bool
) -> LawFit:
    """Return the law to which the best start leads, with a grid that is refined once."""
    sample_time = records.signals.segments[0].sample_time
    search = _Search(records, family.elements)
    delays = START_DEAD_TIMES if is_delayed else (0.0,)
    starts = [np.array([delay, *start]) for start in begins for delay in delays]
    best = min(starts, key=search.cost)
    if not search.solve_for(best).sizes.any():  # a search that begins with no force finds none
        best = min(starts, key=lambda each: float(np.sum(search.solve_for(each).residual ** 2)))
    for _ in range(2):
        best = search.minimised(best, is_delayed)
        elements = search.elements(best[1:])
        finer = elements.refine(search.solve_for(best).sizes)
        if finer is elements:
            break
        search = _Search(records, finer)
    left = float(np.sqrt(np.sum(search.solve_for(best).residual ** 2) / records.equations))
    delay = max(float(best[0]), 0.0) * sample_time
    return LawFit(search.elements(best[1:]), np.empty(0), left, 0.0, delay)


class _Search:
    """What the laws of a family leave of some records, by dead time [samples] and shape."""

    def __init__(self, records: LawRecords, elements: LawElements) -> None:
        self._records, self._elements = records, elements
        self._sample_time = records.signals.segments[0].sample_time
        self._known: dict[bytes, NDArray[np.complex128]] = {}

    def elements(self, shape: NDArray[np.float64]) -> LawElements:
        """Return the law with a shape."""
        return replace(self._elements, shape=shape)

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

    def minimised(self, start: NDArray[np.float64], is_delayed: bool) -> NDArray[np.float64]:
        """Return dead time and shape that leave least, from a start on; a linear family keeps its shape."""
        from scipy.optimize import least_squares  # slow to import: only when something is estimated

        free = 1 if self.elements(start[1:]).is_linear else start.size
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
    if not elements.thresholds.size:
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
