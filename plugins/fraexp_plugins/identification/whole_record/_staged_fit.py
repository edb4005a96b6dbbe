"""The fit of plant and friction to all records of an experiment, in stages that begin where friction is weak."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, Plant, RecordError, ReplayModel, Segment, Signals, phasors
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.parameter_uncertainty import parameter_value, with_parameter
from fraexp_plugins.estimators._shared.realisations import Part, circular_covariance, combine_parts
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification.plant.modal_fit import ModalFit
from fraexp_plugins.identification.whole_record._fitted_records import (
    LAST_GAIN,
    MAX_PLANT_RATIO,
    Fitted,
    along_directions,
    evidence,
    replay_error,
    with_own_responses,
    without_plant,
)
from fraexp_plugins.identification.whole_record._free_parameters import (
    DEAD_TIME,
    DISPLACEMENT_SCALE,
    FORCE_SCALE,
    SCALES,
    FreeParameters,
    Models,
    nonzero_numbers,
)
from fraexp_plugins.identification.whole_record._record_fit import MAX_STEPS, RecordFit, State
from fraexp_plugins.identification.whole_record._replayed_record import ReplayedRecord
from fraexp_plugins.plants.modal import Modal

PLANT_MODEL_ERROR = 1e-3
"""Relative error of the plant model that a fit allows for."""
MAX_FRICTION_RATIO, MIN_POINTS = 3.0, 8
"""Friction over effective input up to which a response is taken for the plant's, if that leaves as many points."""
MAX_RESPONSE_ERROR = 0.5
"""Relative error by friction up to which it is otherwise."""


@dataclass(frozen=True)
class ObservedStart:
    """What the observer finds with one friction model."""

    effective: tuple[NDArray[np.complex128], ...]
    """Effective input of each segment [N], mean over periods, shape (lines,) each."""
    friction: tuple[NDArray[np.complex128], ...]
    """Friction force likewise [N]."""

    @classmethod
    def of(cls, observer: EffectiveInput, signals: Signals) -> "ObservedStart":
        """Return what an observer finds along signals."""
        effective = tuple(each.mean(axis=0) for each in observer.effective_phasors(signals.segments))
        friction = tuple(each.mean(axis=0) for each in observer.friction_phasors(signals.segments))
        return cls(effective, friction)

    @property
    def friction_ratios(self) -> NDArray[np.float64]:
        """Friction force over effective input at all lines, shape (n,)."""
        return np.abs(np.concatenate(self.friction)) / np.maximum(np.abs(np.concatenate(self.effective)), 1e-300)

    def places_by_friction(self) -> list[int]:
        """Return the places of the segments, those with the least friction first."""
        ends = np.cumsum([each.size for each in self.effective])[:-1]
        ratios = [float(each.mean()) for each in np.split(self.friction_ratios, ends)]
        return [int(place) for place in np.argsort(ratios, kind="stable")]

    def plant(
        self,
        signals: Signals,
        observer: EffectiveInput,
        modes: int | None,
        friction_error: float,
        has_dead_time: bool = False,
    ) -> tuple[Modal, float]:
        """Return the modal plant in the observer's response, if friction may be wrong by this share, and a dead time.

        Where the response supports no modes it is a rigid body. The dead time [s] is 0 unless it may have one.
        """
        found = self._response(signals, observer)
        error = friction_error * self.friction_ratios
        covariance = circular_covariance(np.abs(found.response) ** 2 * (error**2 + PLANT_MODEL_ERROR**2))
        settled = found.settled & (self.friction_ratios < MAX_FRICTION_RATIO)
        if settled.sum() < MIN_POINTS:
            settled = found.settled & (error < MAX_RESPONSE_ERROR)
        if settled.sum() < 2:
            settled = found.settled
        return plant_in(replace(found, covariance=covariance, settled=settled), modes, has_dead_time)

    def _response(self, signals: Signals, observer: EffectiveInput) -> FrequencyResponse:
        """Return y'/û_e, each segment for itself: their amplitudes may differ."""
        parts = []
        for segment, effective in zip(signals.segments, self.effective, strict=True):
            output = phasors(segment, observer.output).mean(axis=0)
            unknown = np.full((output.size, 2, 2), np.nan)
            amplitudes = np.abs(effective), np.abs(output)
            parts.append(Part((segment,), segment.frequency, output / effective, unknown, np.inf, *amplitudes))
        units = signals.unit(observer.input), signals.unit(observer.output)
        found = combine_parts(signals, parts, names=(EFFECTIVE_INPUT, observer.output), units=units)
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


def spread_places(count: int, chosen: int) -> list[int]:
    """Return `chosen` places, or all if there are fewer, spread over `count`."""
    return sorted({round(place) for place in np.linspace(0, count - 1, min(chosen, count))})


def union_of(places: Sequence[int], others: Sequence[int]) -> list[int]:
    """Return all places of both, ascending."""
    return sorted({*places, *others})


RANGE, POINTS, OBSERVED_POINTS = 3.0, 29, 15
"""Largest scale of the grid, the least one being its reciprocal, its points, and those at which an observer is run."""
ORDERS = (2, 4, 6)
"""Degrees of numerator and denominator: two for each mode."""
ORDER_COST = 0.1
"""Mean logarithm of the error by which two more degrees must be better."""
ITERATIONS = 4
"""Times that the linear fit is repeated with the denominator of the one before as its weight."""
LEAST_ERROR = 1e-3
"""Error over û_e, and over the force that it is a difference of, that counts as none."""
DISTINCT = 0.02
"""Difference of two logarithms from which they are two starts."""
REFINED, FINER_POINTS, FINER_RATIO, FINER_GRIDS = 6, 5, 0.4, 7
"""Points of the grid around which finer grids refine the scales, points of such a grid along a scale, width of one over
that of the one before, and their number."""
RANK_TOLERANCE = 1e-14
"""Diagonal of a triangle, over its greatest number, below which a column counts as one of those before."""
MAX_LINES = 40
"""Lines, spread over all, that are compared."""


class ScaleSearch:
    """The observer's response over scales of friction.

    The force is proportional to one scale. Along the other its phasors are interpolated between those of a grid.
    """

    def __init__(
        self, segments: Sequence[Segment], observer: EffectiveInput, free: Sequence[str], force_range: float = RANGE
    ) -> None:
        segments = _spread_segments(segments)
        self.frequency = np.concatenate([segment.frequency for segment in segments])
        self.has_force, self.has_displacement = FORCE_SCALE in free, DISPLACEMENT_SCALE in free
        from scipy.interpolate import CubicSpline  # slow to import: listing plugins must stay fast

        output = [phasors(segment, observer.output).mean(axis=0) for segment in segments]
        linear = [each.mean(axis=0) for each in observer.linear_phasors(segments)]
        self.output, self.linear = np.concatenate(output), np.concatenate(linear)
        self.grid = np.linspace(-np.log(RANGE), np.log(RANGE), POINTS)
        points = round(POINTS * np.log(force_range) / np.log(RANGE))
        self.force_grid = np.linspace(-np.log(force_range), np.log(force_range), points)
        observed = np.linspace(self.grid[0], self.grid[-1], OBSERVED_POINTS) if self.has_displacement else np.zeros(1)
        forces = [self._forces(segments, observer, float(np.exp(log))) for log in observed]
        self.force_over_scale = CubicSpline(observed, forces) if self.has_displacement else lambda _: forces[0]

    def _forces(self, segments: Sequence[Segment], observer: EffectiveInput, scale: float) -> NDArray[np.complex128]:
        moved = observer.model_copy(update={DISPLACEMENT_SCALE: scale, FORCE_SCALE: 1.0})
        effective = np.concatenate([each.mean(axis=0) for each in moved.effective_phasors(segments)])
        return np.asarray(self.linear - effective)

    def starts(self) -> list[NDArray[np.float64]]:
        """Return the logarithms of both scales that give the most plausible responses, the best first."""
        forces = self.force_grid if self.has_force else np.zeros(1)
        displacements = self.grid if self.has_displacement else np.zeros(1)
        points = _pairs(forces, displacements)
        best = points[np.argsort(self.costs(points), kind="stable")[:REFINED]]
        costs, refined = self._refine(best)
        found: list[NDArray[np.float64]] = []
        for point in refined[np.argsort(costs, kind="stable")]:
            if all(np.abs(point - other).max() > DISTINCT for other in found):
                found.append(point)
        return found

    def _refine(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the least costs on ever finer grids around points, shape (points,), and where they are."""
        width = float(self.grid[1] - self.grid[0])
        side = np.linspace(-1.0, 1.0, FINER_POINTS)
        offsets = _pairs(side if self.has_force else np.zeros(1), side if self.has_displacement else np.zeros(1))
        for _ in range(FINER_GRIDS):
            tried = points[:, None, :] + width * offsets
            costs = self.costs(tried.reshape(-1, 2)).reshape(len(points), -1)
            best = np.argmin(costs, axis=1)
            points, width = tried[np.arange(len(points)), best], FINER_RATIO * width
        return costs.min(axis=1), points

    def costs(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean logarithm of the error of a rational function, for logarithms of both scales, (n, 2)."""
        effective = self.linear - np.exp(logs[:, :1]) * self.force_over_scale(logs[:, 1])
        fits = [_rational_errors(self.frequency, self.output, effective, np.abs(self.linear), n) for n in ORDERS]
        return np.asarray(np.min([cost + ORDER_COST * n / 2 for cost, n in zip(fits, ORDERS, strict=True)], axis=0))


def _spread_segments(segments: Sequence[Segment]) -> list[Segment]:
    """Return segments spread over the frequencies, with about as many lines as are compared."""
    ordered = sorted(segments, key=lambda segment: float(segment.frequency[0]))
    lines = sum(segment.lines.size for segment in segments) / len(segments)
    return [ordered[place] for place in spread_places(len(ordered), max(int(MAX_LINES / lines), 1))]


def _pairs(forces: NDArray[np.float64], displacements: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return all pairs of two values, shape (n, 2)."""
    return np.stack(np.meshgrid(forces, displacements, indexing="ij"), axis=-1).reshape(-1, 2)


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
    allowed = np.hypot(LEAST_ERROR * np.abs(effective), LEAST_ERROR * force)
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
    return np.asarray(np.mean(np.log(np.hypot(error, LEAST_ERROR)), axis=1))


def _least_squares(columns: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return real x of least |A x - b|² for each [A, b], shape (n, lines, k + 1): shape (n, k)."""
    triangle = np.asarray(np.linalg.qr(np.concatenate([columns.real, columns.imag], axis=1), mode="r"))
    matrix = triangle[:, :-1, :-1]
    least = RANK_TOLERANCE * np.abs(triangle).max(axis=(1, 2))[:, None]
    diagonal = np.einsum("nii->ni", matrix)
    np.einsum("nii->ni", matrix)[...] = np.where(np.abs(diagonal) < least, least, diagonal)
    return np.asarray(np.linalg.solve(matrix, triangle[:, :-1, -1:]), dtype=float)[..., 0]


FIRST_RECORDS, SECOND_RECORDS = 8, 12
"""Records of the first stage, and those that the second one adds, spread over the frequencies."""
STAGE_GAIN = 5.0
"""Gain of the log-likelihood with which a stage ends, before the last ones."""
HOPELESS_RATIO, HOPELESS_STEPS = 10.0, 2
"""Residual over what noise and rounding explain, from which a start is given up, and the steps taken after it."""
NEAR_STEPS = 2 * MAX_STEPS
"""Steps from a start that is near: elements that share a force in ways that hardly differ take many."""
MODES = (1, 2, 3)
"""Numbers of modes that are tried where the plant may lack one."""
MAX_MODE_STD = 0.1
"""Relative standard deviation of a mode's numbers from which the plant may have one too many."""
WRONG_LAW_RATIO = 1000.0
"""Residual over what noise and rounding explain from which no mode helps."""
MAX_START_RATIO, MAX_MEAN_RATIO = 1.3, 1.05
"""Geometric mean of the same up to which no other start is tried, and up to which the model repeats the records."""
MAX_PARAMETER_STD = 0.5
"""Relative standard deviation from which records do not tell a parameter."""
MAX_REFINEMENTS, REFINEMENT = 2, 3
"""How often the replay's steps are refined if they matter, and by which factor."""
REPLAY_TOLERANCE_RATIO = 0.1
"""Tolerance of the replay over that of y'/u: û_e may be a small part of the input."""


def _weak_friction(observed: ObservedStart, count: int) -> list[int]:
    return sorted(observed.places_by_friction()[:FIRST_RECORDS])


def _spread(observed: ObservedStart, count: int) -> list[int]:
    return union_of(_weak_friction(observed, count), spread_places(count, SECOND_RECORDS))


class _Stage(NamedTuple):
    """A fit to some of the records, before that to all."""

    places: Callable[[ObservedStart, int], list[int]]
    """The records, by what the observer finds and how many there are."""
    friction_error: float
    """By how much friction may then be wrong, relatively."""


STAGES = (_Stage(_weak_friction, 0.01), _Stage(_spread, 0.01))


@dataclass(frozen=True)
class StagedFit:
    """What is to be fitted.

    The response of each record is first that of the plant, whose numbers are estimated with those of friction: where
    friction is weak, then at some other frequencies, then at all. At last each record has a response of its own.
    """

    signals: Signals
    observer: EffectiveInput
    """The friction model at the start, the delays and the encoder."""
    free: FreeParameters
    nominal_plant: Plant | None
    modes: int | None
    is_thorough: bool = True
    """Whether several starts and numbers of modes are tried where the first ones do not explain the records."""

    @property
    def sample_time(self) -> float:
        """Sample time of all records [s]."""
        return self.signals.segments[0].sample_time

    def run(self, known: Fitted | None = None) -> tuple[Fitted, int]:
        """Return the fit with a response for each record, and from how many starts it was tried.

        `known` is a joint fit to other records of the same machine, from which it starts without a search.
        """
        best, starts = self._best_start() if known is None else (known, 1)
        every = replace(best.fit, records=self._records(range(len(self.signals.segments))))
        every = every.with_needed_drifts(State(best.state.shared, tuple(np.zeros(r.count) for r in every.records)))
        whole = self._whole(every, best)
        for _ in range(MAX_REFINEMENTS):
            if whole.is_exact or whole.mean_ratio > MAX_PLANT_RATIO:
                break
            every = every.with_more_steps(REFINEMENT)
            whole = self._whole(every, whole)
        return whole, starts

    def joint(self) -> Fitted:
        """Return the fit in which the response of every record is that of the plant."""
        best, _ = self._best_start()
        steps = MAX_STEPS if best.mean_ratio < HOPELESS_RATIO else HOPELESS_STEPS
        every = replace(best.fit, records=self._records(range(len(self.signals.segments))))
        return self._converged(every, best.state.shared, LAST_GAIN, steps)

    def joint_from(self, plant: Plant, shared: NDArray[np.float64]) -> Fitted:
        """Return the same from a plant, and logarithms of all parameters that are near the right ones."""
        return self._converged(self.fit_around(plant), shared, LAST_GAIN, NEAR_STEPS)

    def predicted_ratios(self, found: Fitted, signals: Signals) -> NDArray[np.float64]:
        """Return what a joint fit leaves of other records, over what noise and rounding explain, shape (records,)."""
        records = [replayed_record(segment, self.observer) for segment in signals.segments]
        return replace(found.fit, records=records).predicted_ratios(found.state.shared)

    def _best_start(self) -> tuple[Fitted, int]:
        """Return the best fit of some records, and from how many starts it was tried."""
        found: list[Fitted] = []
        for start in self.starts():
            found.append(self._first_fits(start))
            if found[-1].mean_ratio < MAX_START_RATIO or not self.is_thorough:
                break
        return min(found, key=lambda each: each.mean_ratio), len(found)

    def _whole(self, fit: RecordFit, before: Fitted) -> Fitted:
        """Return the fit of all records with a response for each, from that of some."""
        steps = MAX_STEPS if before.mean_ratio < HOPELESS_RATIO else HOPELESS_STEPS
        joint = self._without_untold_modes(self._converged(fit, before.state.shared, LAST_GAIN, steps))
        joint = along_directions(joint)
        whole = with_own_responses(joint, steps)
        if whole.mean_ratio < MAX_PLANT_RATIO:
            return whole
        logs = before.state.shared[: len(self.free.names)]
        effective = ObservedStart.of(self.observer_at(logs), self.signals).effective
        alone = without_plant(replace(fit, free=self.free), logs, effective, steps)
        if alone.mean_ratio > whole.mean_ratio:
            return whole
        return replace(alone, error=replay_error(alone.fit, alone.state, alone.linear))

    def _without_untold_modes(self, joint: Fitted) -> Fitted:
        """Return the joint fit without modes that the records do not tell.

        Noise looks like a mode to the observer where friction hides the plant. It then takes part of the rigid body's
        motion, so that friction's scales and the plant are known several times worse.
        """
        plant = joint.models.plant
        if not isinstance(plant, Modal) or self.modes is not None or not joint.fit.free.plant:
            return joint
        count, std = len(plant.frequencies), np.sqrt(np.diag(joint.covariances[0])[len(self.free.names) :])
        if not count or joint.mean_ratio > MAX_PLANT_RATIO or std.max(initial=0.0) < MAX_MODE_STD:
            return joint
        logs = joint.state.shared[: len(self.free.names)]
        observer = self.observer_at(logs)
        plant, _ = ObservedStart.of(observer, self.signals).plant(
            self.signals, observer, count - 1, STAGES[-1].friction_error
        )
        fit = replace(joint.fit, start=joint.fit.start.with_plant(plant))
        simpler = self._converged(fit, logs, LAST_GAIN)
        return self._without_untold_modes(simpler) if evidence(simpler, joint) > 0 else joint

    def starts(self) -> list[NDArray[np.float64]]:
        """Return the logarithms of the free parameters at which a fit may begin, the most plausible first."""
        if not set(SCALES) & set(self.free.friction):
            return [np.zeros(len(self.free.names))]
        search = ScaleSearch(
            self.signals.segments, self.observer_at(np.zeros(len(self.free.names))), self.free.friction
        )
        return [self.free.from_scales(scales) for scales in search.starts()]

    def _first_fits(self, start: NDArray[np.float64]) -> Fitted:
        """Return the fit of some records, from a start."""
        logs, found = start, None
        for stage in STAGES:
            found = self._stage_fit(stage, logs, found)
            logs = found.state.shared[: logs.size]
            if found.mean_ratio > HOPELESS_RATIO:
                break
        assert found is not None
        return found

    def _stage_fit(self, stage: "_Stage", logs: NDArray[np.float64], before: Fitted | None) -> Fitted:
        """Return the fit of a stage's records with the plant of the one before, if it explains them as well.

        Otherwise it is that with the plant of fewest modes that explains them, or without a plant.
        """
        observed = ObservedStart.of(self.observer_at(logs), self.signals)
        places = stage.places(observed, len(self.signals.segments))
        records = self._records(places)
        if before is not None and before.mean_ratio < MAX_PLANT_RATIO and not before.fit.has_own_forces:
            found = self._converged(replace(before.fit, records=records), before.state.shared, STAGE_GAIN)
            if found.mean_ratio < MAX_PLANT_RATIO:
                return found
        tried: list[Fitted] = []
        for modes, start, seen in self._plant_starts(logs, observed, tried):
            has_dead_time, observer = DEAD_TIME in self.free.friction, self.observer_at(start)
            in_response, dead_time = seen.plant(self.signals, observer, modes, stage.friction_error, has_dead_time)
            plant = self.nominal_plant or in_response
            if any(plant == each.fit.start.plant for each in tried):
                continue
            fit = self._fit(plant, records)
            tried.append(self._converged(fit, self.free.with_dead_time(start, dead_time, self.sample_time), STAGE_GAIN))
            if not (self.is_thorough and MAX_PLANT_RATIO < tried[-1].mean_ratio < WRONG_LAW_RATIO):
                return tried[-1]
        tried.append(without_plant(fit, logs, [observed.effective[place] for place in places]))
        return min(tried, key=lambda each: each.mean_ratio)

    def _plant_starts(
        self, logs: NDArray[np.float64], observed: ObservedStart, tried: Sequence[Fitted]
    ) -> Iterator[tuple[int | None, NDArray[np.float64], ObservedStart]]:
        """Yield modes, friction and what the observer finds with it, from which a stage may get its plant.

        A friction that is wrong by more than its scales, such as in its viscous coefficient, hides modes of the plant.
        What was fitted without them is nearer to the right one, and shows them.
        """
        is_given = self.modes is not None or self.nominal_plant is not None
        choices = (self.modes,) if is_given else MODES
        yield self.modes, logs, observed
        yield from ((modes, logs, observed) for modes in choices)
        found = tried[0].state.shared[: logs.size]
        again = ObservedStart.of(self.observer_at(found), self.signals)
        yield from ((modes, found, again) for modes in choices)

    def _converged(
        self, fit: RecordFit, shared: NDArray[np.float64], gain: float, max_steps: int = MAX_STEPS
    ) -> Fitted:
        """Return the fit in which every response is that of the plant."""
        parameters = () if self.nominal_plant is not None else nonzero_numbers(fit.start.plant)
        joint = replace(fit, free=FreeParameters(self.free.friction, parameters), has_own_forces=False)
        missing = len(joint.free.names) - shared.size
        own = tuple(np.zeros(record.count) for record in fit.records)
        return Fitted(joint, *joint.converge(State(np.append(shared, np.zeros(missing)), own), gain, max_steps))

    def fit_around(self, plant: Plant) -> RecordFit:
        """Return the fit of all records to a machine with this plant and the observer's friction."""
        return self._fit(plant, self._records(range(len(self.signals.segments))))

    def observer_at(self, logs: NDArray[np.float64]) -> EffectiveInput:
        """Return the observer with these parameters of friction."""
        force, displacement = self.free.scales(logs)
        friction = self.observer.law
        for name, factor in zip(self.free.friction, np.exp(logs), strict=False):
            if name not in (*SCALES, DEAD_TIME):
                friction = with_parameter(friction, name, parameter_value(friction, name) * float(factor))
        dead_time = max(self.observer.input_dead_time + self.free.dead_time(logs, self.sample_time), 0.0)
        changed = {
            "friction": friction, "force_scale": force, "displacement_scale": displacement, DEAD_TIME: dead_time
        }  # fmt: skip
        return self.observer.model_copy(update=changed).resolve_oversampling(self.signals.segments)

    def _fit(self, plant: Plant, records: Sequence[ReplayedRecord]) -> RecordFit:
        observer, ports = self.observer, plant.ports()
        (contact,) = ports.contacts
        model = ReplayModel(
            ports,
            {contact: observer.law},
            records[0].segment.sample_time,
            (observer.input_dead_time, observer.input_time_constants),
            (observer.output_dead_time, observer.output_time_constants),
            REPLAY_TOLERANCE_RATIO * observer.interpolation_tolerance,
        )
        start = Models(plant, model)
        return RecordFit(records, start, self.free, observer.resolution, observer.noise)

    def _records(self, places: Sequence[int]) -> list[ReplayedRecord]:
        return [replayed_record(self.signals.segments[place], self.observer) for place in places]


def replayed_record(segment: Segment, observer: EffectiveInput) -> ReplayedRecord:
    """Return a record with the delays around the plant that an observer has."""
    omega = 2 * np.pi * segment.frequency
    path = observer.input_path(omega, segment.sample_time) * observer.output_path(omega)
    return ReplayedRecord(segment, observer.input, observer.output, path)
