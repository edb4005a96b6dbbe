"""Plant and friction along the measured motion: near the right ones in a second or two, without a replay.

What an observer shows of plant and friction gives the plant's response, and plausible scales of friction. From there
the motion drives the friction model, and what G U - F - Y/P leaves is minimised at the excited lines and, of sines, at
their odd harmonics. That is no estimate to trust, as rounded positions drive friction. It tells laws apart at once, and
a fit to whole records begins next to where it ends: static force, damping and viscous coefficient included, which may
hide a mode of the plant.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    COARSE_DIFFERENCE,
    CONVERGED,
    FrequencyResponse,
    FrictionModel,
    ParameterError,
    Plant,
    RecordError,
    Signals,
    fourier_sums,
    phasors,
)
from fraexp_plugins.estimators._shared.effective_input_observer import CACHE_BYTES, EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.realisations import Part, circular_covariance, combine_parts
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction._shared.element_model import ElementModel, VirginCurve
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._law_numbers import LAW_ELEMENTS, VISCOUS, rough_model
from fraexp_plugins.identification._least_squares import derivatives, minimise
from fraexp_plugins.identification._likelihood import greatest_chance_gain
from fraexp_plugins.identification._machine_problem import (
    DEAD_TIME,
    DISPLACEMENT_SCALE,
    FORCE_SCALE,
    SCALES,
    FreeParameters,
    MachineProblem,
    Models,
)
from fraexp_plugins.identification._usable_records import FORCE_FLOOR, with_harmonics
from fraexp_plugins.identification.modal_fit import ModalFit
from fraexp_plugins.plants.modal import Modal

PLANT_MODEL_ERROR = 1e-3
"""Relative error of the plant model that a fit allows for, and error of a response that counts as none."""


# These numbers say where the fit of whole records begins. Fits from other starts end at the same parameters, which half
# of the first three moves by less than 3 % of an interval; what they save is time, and starts in wrong valleys.
ANY_PLANT = Modal(rigid_body_gain=1.0)
"""Plant of a machine of which friction and delays alone are known."""


MIN_HARMONIC_SAMPLES = 10
"""Samples of a cycle of the highest harmonic: with fewer the law's force is wrong by more than `FORCE_FLOOR`."""


class MotionRecords:
    """Records whose lines, with odd harmonics, show the force of friction along the measured motion beside the plant.

    At the excited lines that is what an observer of the effective input finds.
    """

    def __init__(self, signals: Signals, observer: EffectiveInput) -> None:
        self.signals, self.observer = signals, observer
        self._segments = [with_harmonics(segment, MIN_HARMONIC_SAMPLES) for segment in signals.segments]
        bare = observer.model_copy(update={"friction": Frictionless(), "force_scale": 1.0, "displacement_scale": 1.0})
        self._motions = [bare.motion(segment) for segment in self._segments]
        self.frequency = np.concatenate([segment.frequency for segment in self._segments])
        pairs = zip(self._segments, signals.segments, strict=True)
        self.is_excited = np.concatenate([np.isin(own.lines, given.lines) for own, given in pairs])
        self._omega = 2 * np.pi * self.frequency
        self.thrust = np.concatenate([each.mean(axis=0) for each in bare.linear_phasors(self._segments)])
        self.output = np.concatenate([phasors(s, bare.output).mean(axis=0) for s in self._segments])
        self._factor = bare.force_factor(self._omega)
        self._driven = dict[tuple[str, float], NDArray[np.complex128]]()
        self._periods = [len(segment.channels[bare.output]) for segment in self._segments]
        counts = [segment.lines.size for segment in self._segments]
        amplitudes = [np.sqrt(2 * np.mean(segment.channels[bare.input] ** 2)) for segment in self._segments]
        self._force_floor = FORCE_FLOOR * np.repeat(amplitudes, counts)
        sizes = np.array([segment.channels[bare.output].size for segment in self._segments])
        self._output_error = np.repeat(bare.encoder.deviation * np.sqrt(2 / sizes), counts)

    @classmethod
    def of(cls, problem: MachineProblem) -> "MotionRecords":
        """Return the records of a machine with one contact."""
        return cls(problem.signals, problem.observer.resolve_oversampling(problem.signals.segments))

    @property
    def lines(self) -> int:
        """Number of all lines."""
        return self._omega.size

    def law_force(self, law: FrictionModel, scales: tuple[float, float] = (1.0, 1.0)) -> NDArray[np.complex128]:
        """Return the force of a law [N] at all lines, without viscous friction, shape (n,); the last ones are kept."""
        still = law.model_copy(update={VISCOUS: 0.0}) if VISCOUS in type(law).model_fields else law
        key, (force_scale, scale) = (repr(still), scales[1]), scales
        if key not in self._driven:
            forces = still.forces(
                [m._replace(displacement=m.displacement / scale, lead_in=m.lead_in / scale) for m in self._motions]
            )
            sums = [
                fourier_sums(force.reshape(periods, -1), segment.lines).mean(axis=0)
                for force, segment, periods in zip(forces, self._segments, self._periods, strict=True)
            ]
            self._driven[key] = found = np.asarray(self._factor * np.concatenate(sums))
            if len(self._driven) * found.nbytes > CACHE_BYTES:
                del self._driven[next(iter(self._driven))]
        return force_scale * self._driven[key]

    def viscous_force(self, law: FrictionModel) -> NDArray[np.complex128]:
        """Return the viscous force of a law [N] at all lines, shape (n,)."""
        return np.asarray(1j * self._omega * law.viscous * self.output)

    def forces(self, models: Models) -> NDArray[np.complex128]:
        """Return G U - F [N] at all lines, shape (n,)."""
        friction = self.viscous_force(models.friction) + self.law_force(models.friction, models.scales)
        return np.asarray(self.thrust * np.exp(-1j * self._omega * models.added_dead_time) - friction)

    def residual(self, forces: NDArray[np.complex128], plant: Plant) -> NDArray[np.float64]:
        """Return what forces [N], less those that move a plant, leave over what is allowed for, shape (2 n,)."""
        inverse = 1 / plant.response(self._omega)
        left = (forces - self.output * inverse) / np.hypot(self._force_floor, np.abs(inverse) * self._output_error)
        size = np.abs(left)
        short = left * np.sqrt(2 / (1 + np.hypot(1, size)))
        return np.concatenate([short.real, short.imag])

    def effective(self, models: Models) -> list[NDArray[np.complex128]]:
        """Return G U - F [N] at the excited lines of each segment, shape (lines,) each."""
        counts = [segment.lines.size for segment in self.signals.segments]
        return np.split(self.forces(models)[self.is_excited], np.cumsum(counts)[:-1])

    def plant(
        self, models: Models, modes: int | None, friction_error: float, has_dead_time: bool = False
    ) -> tuple[Modal, float]:
        """Return the modal plant in y'/(G U - F), if friction may be wrong by this share, and a dead time.

        Where the response supports no modes it is a rigid body. The dead time [s] is 0 unless it may have one.
        """
        effective = self.effective(models)
        found, every = self._response(effective), np.concatenate(effective)
        delayed = self.thrust * np.exp(-1j * self._omega * models.added_dead_time)
        ratios = np.abs(delayed[self.is_excited] - every) / np.maximum(np.abs(every), 1e-300)
        error = friction_error * ratios
        covariance = circular_covariance(np.abs(found.response) ** 2 * (error**2 + PLANT_MODEL_ERROR**2))
        clearest = np.sort(ratios[found.settled])[:MIN_POINTS]
        is_clear = ratios <= max(MAX_FRICTION_RATIO, clearest[-1])
        return plant_in(replace(found, covariance=covariance, settled=found.settled & is_clear), modes, has_dead_time)

    def _response(self, effective: Sequence[NDArray[np.complex128]]) -> FrequencyResponse:
        """Return y'/û_e, each segment for itself: their amplitudes may differ."""
        parts, observer = [], self.observer
        for segment, force in zip(self.signals.segments, effective, strict=True):
            output = phasors(segment, observer.output).mean(axis=0)
            unknown = np.full((output.size, 2, 2), np.nan)
            amplitudes = np.abs(force), np.abs(output)
            parts.append(Part((segment,), segment.frequency, output / force, unknown, np.inf, *amplitudes))
        units = self.signals.unit(observer.input), self.signals.unit(observer.output)
        found = combine_parts(self.signals, parts, names=(EFFECTIVE_INPUT, observer.output), units=units)
        assert found.response is not None
        return found.response


def plant_in(response: FrequencyResponse, modes: int | None, has_dead_time: bool) -> tuple[Modal, float]:
    """Return the modal plant in a response with a band, and its dead time [s]; where it supports none, a rigid body."""
    dead_time = None if has_dead_time else 0.0
    modal = ModalFit(method=Conventional(), modes=modes, dead_time=dead_time, model_error=PLANT_MODEL_ERROR)
    try:
        with np.errstate(all="ignore"):  # of a wrong friction model
            (fit,) = modal.fit_response(response).fits
    except RecordError:
        gains = np.abs(response.response) * (2 * np.pi * response.frequency) ** 2
        return Modal(rigid_body_gain=float(np.median(gains[response.settled]))), 0.0
    spec = {key: value for key, value in fit.component.items() if key not in ("name", "version")}
    return Modal.parse(spec, "plant"), float(fit.values[fit.parameters.index("dead_time")])


MAX_FRICTION_RATIO, MIN_POINTS = 3.0, 8
"""Friction over effective input up to which a response is taken for the plant's, and points that are taken at least:
modes are not found where friction hides the plant, and two modes have seven numbers."""
RANGE, POINTS = 3.0, 15
"""Largest scale of the grid, the least one being its reciprocal, and its points along a scale: each 17 % above the one
before, while a search finds its minimum from twice as far."""
ORDERS = (2, 4, 6)
"""Degrees of numerator and denominator: two for each mode."""
ORDER_COST = 0.1
"""Mean logarithm of the error by which two more degrees must be better: as much as by eight numbers that fit chance in
forty lines."""
ITERATIONS = 4
"""Times that the linear fit is repeated with the denominator of the one before as its weight. With two the error near
modes still falls."""
MAX_LINES = 40
"""Lines, spread over all, that are compared. It bounds the time; rational functions have thirteen numbers at most."""


class ScaleSearch:
    """The response beside friction, over scales of friction.

    The force is proportional to one scale. Along the other its phasors are interpolated between those of a grid.
    """

    def __init__(
        self, signals: Signals, observer: EffectiveInput, free: Sequence[str], force_range: float = RANGE
    ) -> None:
        from scipy.interpolate import CubicSpline  # slow to import: listing plugins must stay fast

        records, law = MotionRecords(spread_records(signals), observer), observer.law
        at = records.is_excited
        self.has_force, self.has_displacement = FORCE_SCALE in free, DISPLACEMENT_SCALE in free
        self.frequency, self.output = records.frequency[at], records.output[at]
        self.linear = (records.thrust - records.viscous_force(law))[at]
        self.grid = np.linspace(-np.log(RANGE), np.log(RANGE), POINTS)
        points = round(POINTS * np.log(force_range) / np.log(RANGE))
        self.force_grid = np.linspace(-np.log(force_range), np.log(force_range), points)
        observed = self.grid if self.has_displacement else np.zeros(1)
        forces = [records.law_force(law, (1.0, float(np.exp(log))))[at] for log in observed]
        self.force_over_scale = CubicSpline(observed, forces) if self.has_displacement else lambda _: forces[0]

    def starts(self) -> Iterator[NDArray[np.float64]]:
        """Yield the logarithms of both scales that give the most plausible responses, one in each valley."""
        forces = self.force_grid if self.has_force else np.zeros(1)
        displacements = self.grid if self.has_displacement else np.zeros(1)
        points = np.stack(np.meshgrid(forces, displacements, indexing="ij"), axis=-1)
        costs = self.costs(points.reshape(-1, 2)).reshape(points.shape[:2])
        around = np.lib.stride_tricks.sliding_window_view(np.pad(costs, 1, constant_values=np.inf), (3, 3))
        valleys = costs <= around.min(axis=(2, 3))
        yield from map(self._refined, points[valleys][np.argsort(costs[valleys], kind="stable")])

    def _refined(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where the cost is least around a point of the grid, in steps that are halved where none helps."""
        around = np.array([self.has_force, self.has_displacement]) * np.stack(
            np.meshgrid([0.0, -1.0, 1.0], [0.0, -1.0, 1.0]), axis=-1
        ).reshape(-1, 2)
        width = float(self.grid[1] - self.grid[0]) / 2
        while width > CONVERGED:
            best = int(np.argmin(self.costs(point + width * around)))
            point, width = point + width * around[best], width / 2 if best == 0 else width
        return np.asarray(point)

    def costs(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean logarithm of the error of a rational function, for logarithms of both scales, (n, 2)."""
        effective = self.linear - np.exp(logs[:, :1]) * self.force_over_scale(logs[:, 1])
        fits = [_rational_errors(self.frequency, self.output, effective, np.abs(self.linear), n) for n in ORDERS]
        return np.asarray(np.min([cost + ORDER_COST * n / 2 for cost, n in zip(fits, ORDERS, strict=True)], axis=0))


def spread_records(signals: Signals) -> Signals:
    """Return segments spread over the frequencies, with about as many lines as are compared."""
    ordered = sorted(signals.segments, key=lambda segment: float(segment.frequency[0]))
    lines = sum(segment.lines.size for segment in ordered) / len(ordered)
    count = min(max(int(MAX_LINES / lines), 1), len(ordered))
    chosen = sorted({round(place) for place in np.linspace(0, len(ordered) - 1, count)})
    return replace(signals, segments=tuple(ordered[place] for place in chosen))


def _rational_errors(
    frequency: NDArray[np.float64],
    output: NDArray[np.complex128],
    effective: NDArray[np.complex128],
    force: NDArray[np.float64],
    order: int,
) -> NDArray[np.float64]:
    """Return the mean logarithm of the error of û_e over a force, where s²y/û_e = N(s)/D(s), of this order each.

    `effective` has a row for each û_e, shape (n, lines). Rounding and a wrong friction model falsify û_e by a share of
    the force [N], shape (lines,), not of itself. Iteratively reweighted linear least squares (C. K. Sanathanan and
    J. Koerner, IEEE Trans. Automatic Control 8(1), 1963).
    """
    if frequency.size <= order:
        return np.full(len(effective), np.inf)
    s = 1j * frequency / frequency.max()
    known, powers = s**2 * output / effective, s[:, None] ** np.arange(order + 1)
    allowed = np.hypot(PLANT_MODEL_ERROR * np.abs(effective), PLANT_MODEL_ERROR * force)
    weight = relative = np.abs(effective) / (allowed * np.abs(known))
    columns = np.concatenate(
        [np.broadcast_to(powers, (*known.shape, order + 1)), -known[..., None] * powers[:, 1:], known[..., None]],
        axis=2,
    )
    for _ in range(ITERATIONS):
        values = _least_squares(columns * weight[..., None])
        numerator, denominator = values[:, : order + 1] @ powers.T, 1 + values[:, order + 1 :] @ powers[:, 1:].T
        weight = relative / np.abs(denominator)
    error = np.abs((numerator / denominator / known - 1) * effective) / force
    return np.asarray(np.mean(np.log(np.hypot(error, PLANT_MODEL_ERROR)), axis=1))


def _least_squares(columns: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return real x of least |A x - b|² for each [A, b], shape (n, lines, k + 1): shape (n, k)."""
    triangle = np.asarray(np.linalg.qr(np.concatenate([columns.real, columns.imag], axis=1), mode="r"))
    matrix = triangle[:, :-1, :-1]
    least = np.finfo(float).eps * np.abs(triangle).max(axis=(1, 2))[:, None]
    diagonal = np.einsum("nii->ni", matrix)
    np.einsum("nii->ni", matrix)[...] = np.where(np.abs(diagonal) < least, least, diagonal)
    return np.asarray(np.linalg.solve(matrix, triangle[:, :-1, -1:]), dtype=float)[..., 0]


FORCE_RATIO, FORCE_RANGE = 0.55, 5.5
"""Coulomb force over the largest control input that is tried first, and the largest factor on it: from a tenth of that
input to three times it."""
WIDTH_RATIOS = RANGE ** -np.array([1.0, 3.0, 5.0])
"""Presliding distances over the largest motion, each of which stands for those within the range."""
MIN_KNOT_RATIO, MAX_KNOT_RATIO = 0.01, 2.2
"""Knots of the curve over the presliding distance."""
STRIBECK_RATIO, VISCOUS_RATIO = 0.1, 0.05
"""Stribeck over largest velocity, and viscous over Coulomb force at that velocity."""


class RoughFriction(NamedTuple):
    """What an observer tells of friction, whatever its law."""

    force: float
    """Coulomb force [N]."""
    width: float
    """Presliding distance [m]."""
    velocity: float
    """Largest velocity of the records [m/s]."""

    def curve(self, **given: int) -> VirginCurve:
        """Return an exponential curve that as many elements as usual follow, or as given."""
        knots = {"min_knot": MIN_KNOT_RATIO * self.width, "max_knot": MAX_KNOT_RATIO * self.width}
        return VirginCurve(coulomb_force=self.force, characteristic_displacement=self.width, **knots, **given)

    def model(self, law: type[FrictionModel]) -> FrictionModel:
        """Return a model of any law, elements along the curve; ParameterError for one that needs numbers unknown here.

        The viscous coefficient is not 0, as a factor on it is estimated.
        """
        viscous = {VISCOUS: VISCOUS_RATIO * self.force / self.velocity} if VISCOUS in law.model_fields else {}
        if issubclass(law, ElementModel):
            return law.parse({"curve": self.curve(), **viscous}, law.name)
        stiffness, force = map(np.array, self.curve(elements=LAW_ELEMENTS).stiffness_and_force())
        speed = STRIBECK_RATIO * self.velocity
        return rough_model(law, (stiffness, force), speed, with_damping=True).model_copy(update=viscous)


def rough_friction(signals: Signals, observer: EffectiveInput) -> RoughFriction:
    """Return what the response of an observer tells of friction: that with which it is most like a plant's."""
    thrust = max(float(np.abs(segment.channels[observer.input]).max()) for segment in signals.segments)
    motion = max(float(np.ptp(segment.channels[observer.output])) for segment in signals.segments) / 2
    velocity = _velocity(signals, observer)
    starts = [RoughFriction(FORCE_RATIO * thrust, ratio * motion, velocity) for ratio in WIDTH_RATIOS]
    found = [_plausible_friction(signals, observer, start) for start in starts]
    return min(found, key=lambda each: each[0])[1]


def _plausible_friction(
    signals: Signals, observer: EffectiveInput, start: RoughFriction
) -> tuple[float, RoughFriction]:
    """Return the cost of the most plausible friction around a start, and that friction."""
    changed = observer.model_copy(update={"friction": start.model(Rolling)})
    search = ScaleSearch(signals, changed.resolve_oversampling(signals.segments), SCALES, force_range=FORCE_RANGE)
    best = next(search.starts())
    cost = float(search.costs(best[None, :])[0])
    force, width = np.exp(best)
    return cost, start._replace(force=start.force * float(force), width=start.width * float(width))


def _velocity(signals: Signals, observer: EffectiveInput) -> float:
    """Return the largest velocity that an excited line causes [m/s]."""
    speeds: Sequence[float] = [
        float((2 * np.pi * segment.frequency * np.abs(phasors(segment, observer.output)).max(axis=0)).max())
        for segment in signals.segments
    ]
    return max(speeds)


MAX_ITERATIONS, MAX_STARTS, MAX_ROUNDS, MORE_MODES = 15, 2, 4, 3
"""Maximum numbers of steps of a search, of starts, of rounds from each, and of modes that a round adds. They bound the
time: half of the last two loses plants of five modes."""


@dataclass(frozen=True)
class MotionFit:
    """Plant and friction with which a law explains the measured motion best."""

    plant: Plant
    """Plant at the start."""
    shared: NDArray[np.float64]
    """Logarithms of the factors on friction's and the plant's numbers, shape (p,)."""
    residual: float
    """What is left over what is allowed for, shortened where it is much (soft L1), in the mean over all lines."""

    def is_better_than(self, other: "MotionFit", parts: int) -> bool:
        """Return whether its further parameters explain more than chance does, of so many real parts."""
        added = max(self.shared.size - other.shared.size, 1)
        return other.residual > greatest_chance_gain(added, parts) * self.residual


@dataclass(frozen=True)
class _Search:
    """The search for friction and plant from a start.

    What the motion does not tell stays there: elements share a force in ways that hardly differ.
    """

    records: MotionRecords
    free: FreeParameters
    models: Models
    """The machine whose numbers the parameters are factors on."""
    start: NDArray[np.float64]
    """Logarithms of friction's factors, shape (p,)."""

    def minimum(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the parameters around these ones with the smallest residual."""
        size = self.free.limit(np.full(logs.size, np.inf))
        steps = np.full(logs.size, COARSE_DIFFERENCE)
        return minimise(
            self._weighted, logs, (-size, size), MAX_ITERATIONS, lambda at: derivatives(self._weighted, at, steps)
        )[0]

    def residual(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the parameters leave of the records, shape (2 n,)."""
        models = self.free.applied_to(self.models, logs)
        return self.records.residual(self.records.forces(models), models.plant)

    def _weighted(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the same, then the distance from the start, shape (2 n + p,); infinite for what no model allows."""
        try:
            left = self.residual(logs)
        except ParameterError:
            left = np.full(2 * self.records.lines, np.inf)
        return np.concatenate([left, self._known @ (logs - np.pad(self.start, (0, logs.size - self.start.size)))])

    @property
    def _known(self) -> NDArray[np.float64]:
        """Rows that hold the logarithms of friction's parameters but the dead time, shape (p, p + plant).

        Their standard deviation is 1: a start may be wrong by a factor of three.
        """
        return np.pad(np.diag([float(n != DEAD_TIME) for n in self.free.friction]), ((0, 0), (0, len(self.free.plant))))


def fits_along_motion(problem: MachineProblem) -> list[MotionFit]:
    """Return plant and friction with which a law explains the measured motion, from the best starts, the best first.

    None is tried after one that explains the motion.
    The one position of a machine with several contacts does not say how each of them moves: its start is the given one.
    """
    if problem.frictions:
        assert problem.nominal_plant is not None
        return [MotionFit(problem.nominal_plant, np.zeros(len(problem.free.names)), np.nan)]
    records, found = MotionRecords.of(problem), list[MotionFit]()
    for start in islice(_starts(problem, records.observer), MAX_STARTS):
        found.append(_fit_from(problem, records, start))
        if found[-1].residual < 1:
            break
    return sorted(found, key=lambda each: each.residual)


def _starts(problem: MachineProblem, observer: EffectiveInput) -> Iterator[NDArray[np.float64]]:
    """Yield the logarithms of the free parameters at which a fit may begin, the most plausible first."""
    if not set(SCALES) & set(problem.free.friction):
        yield np.zeros(len(problem.free.names))
        return
    search = ScaleSearch(problem.signals, observer, problem.free.friction)
    yield from map(problem.free.logs_of, search.starts())


def _fit_from(problem: MachineProblem, records: MotionRecords, start: NDArray[np.float64]) -> MotionFit:
    """Return the best fit from a start of friction's parameters.

    A plant is looked for in the observer's response with the friction found before: it shows more and more modes.
    """
    best: MotionFit | None = None
    for _ in range(MAX_ROUNDS):
        logs = start if best is None else best.shared[: start.size]
        found = []
        for with_delay, plant in _plants(problem, records, logs, best):
            free = problem.free_of(plant)
            search = _Search(records, free, problem.models_around(plant), start)
            place = search.minimum(np.concatenate([with_delay, np.zeros(len(free.plant))]))
            found.append(MotionFit(plant, place, float(np.mean(search.residual(place) ** 2))))
            if found[-1].residual < 1:
                return found[-1]
        better = min(found, key=lambda each: each.residual, default=best)
        if better is None or (best is not None and not better.is_better_than(best, 2 * records.lines)):
            break
        best = better
    assert best is not None
    return best


def _plants(
    problem: MachineProblem, records: MotionRecords, logs: NDArray[np.float64], best: MotionFit | None
) -> Iterator[tuple[NDArray[np.float64], Plant]]:
    """Yield friction's parameters, with the dead time if it is free, and plants in the observer's response.

    They have as many modes as it shows, and up to MORE_MODES more than before: a friction that is wrong hides modes.
    """
    if problem.nominal_plant is not None:
        yield from [(logs, problem.nominal_plant)] if best is None else []
        return
    models = problem.free.applied_to(problem.models_around(ANY_PLANT), logs)
    before = len(best.plant.frequencies) if best is not None and isinstance(best.plant, Modal) else 0
    error = PLANT_MODEL_ERROR if best is not None else 10 * PLANT_MODEL_ERROR  # a search improves a start
    known: list[Plant] = []
    more = range(before + 1, before + 1 + MORE_MODES)
    for modes in (problem.modes,) if problem.modes is not None else (None, *more):
        plant, delay = records.plant(models, modes, error, DEAD_TIME in problem.free.friction)
        if plant not in known and len(plant.frequencies) >= before:
            known.append(plant)
            yield problem.free.with_dead_time(logs, delay, problem.sample_time), plant
