"""The plan of a measurement that tells most in a given time: amplitude and number of periods of each frequency."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.whole_record._joint_fit import LinearRecord, interval_loss
from fraexp_plugins.identification.whole_record._record_fit import RecordFit, State

MIN_DITHER_RATIO = 0.1
"""Noise over the encoder's step below which a repeated period is rounded as the one before, and tells nothing new."""


class PlannedRecord(NamedTuple):
    """One sine that may be measured, and what a period of it would tell."""

    frequency: float
    """[Hz]"""
    amplitude: float
    """[N]"""
    period: float
    """Time of a period [s]: whole cycles in whole samples."""
    settled: float
    """Time until it has settled [s], which the one period of the shortest record is part of."""
    stroke: float
    """Peak to peak motion [m]."""
    shared: NDArray[np.float64]
    """Information of a period about the shared parameters, where the response is the plant's, shape (p, p)."""
    own: NDArray[np.float64]
    """Relative covariance of 1/P̂ from a period whose friction is known, shape (2, 2)."""
    slopes: NDArray[np.float64]
    """Relative change of 1/P̂ by the shared parameters, shape (2, p): as they are wrong, so is the response."""
    told: NDArray[np.float64]
    """Covariance of the error of 1/P̂ that is the record's own with the shared parameters, over that of the latter,
    shape (2, p): the record tells them, too."""
    has_dither: bool
    """Whether a repeated period tells as much again."""

    def time(self, count: int) -> float:
        """Return the time that so many periods take [s]; none if it is not measured.

        A record no longer than the windows in which settling shows is the last of them; a longer one comes after it.
        """
        if not count:
            return 0.0
        return self.settled + (count * self.period if count > 1 else 0.0)

    def weight(self, count: int) -> int:
        """Return how many periods tell something new."""
        return count if self.has_dither else min(count, 1)


def planned_records(fit: RecordFit, amplitudes: Sequence[float]) -> list[PlannedRecord]:
    """Return what the simulated records of a fit would tell about the machine that was simulated, and the fit knows.

    `amplitudes` are those of their excitation [N].
    """
    state = State(np.zeros(len(fit.free.names)), tuple(np.zeros(record.count) for record in fit.records))
    fit = fit.with_needed_drifts(state)
    state = State(state.shared, tuple(np.zeros(record.count) for record in fit.records))
    linear, has_dither = fit.linearised_at(state), fit.noise >= MIN_DITHER_RATIO * fit.resolution
    found = []
    for amplitude, record, each, inverse, slopes in zip(
        amplitudes, fit.records, linear.records, linear.inverse, linear.inverse_slopes, strict=True
    ):
        segment = record.segment
        shared, own, by_shared, told = _information(each, slopes[0] / inverse[0], record.forces)
        found.append(
            PlannedRecord(
                frequency=float(record.frequency[0]),
                amplitude=amplitude,
                period=segment.samples * segment.sample_time,
                settled=(segment.settling.time if segment.settling else 0.0) + segment.samples * segment.sample_time,
                stroke=float(np.ptp(record.position)),
                shared=shared,
                own=own,
                slopes=by_shared,
                told=told,
                has_dither=has_dither,
            )
        )
    return found


def _information(
    record: LinearRecord, slopes: NDArray[np.complex128], forces: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return what a planned record knows: `shared`, `own`, `slopes` and `told`."""
    p = record.shared.shape[1]
    curvature = interval_loss(record.residual, record.resolution, record.std).curvature
    jacobian = np.hstack([record.shared, record.own])
    hessian = (jacobian.T * curvature) @ jacobian
    # Where the response is the plant's, a record has a drift of its own only.
    drift = hessian[p + forces :, p + forces :]
    mixed_drift = hessian[p + forces :, :p]
    by_drift = np.linalg.solve(drift, mixed_drift)
    shared = hessian[:p, :p] - mixed_drift.T @ by_drift
    parts = np.stack([slopes.real, slopes.imag])
    gain = np.linalg.solve(hessian[p:, p:], parts[:, p:].T).T
    own, mixed = gain @ parts[:, p:].T, hessian[p:, :p]
    told = gain @ (mixed - hessian[p:, p + forces :] @ by_drift)
    return shared, own, parts[:, :p] - gain @ mixed, told


class Plan(NamedTuple):
    """Records that are to be measured, and how often each of them."""

    records: tuple[PlannedRecord, ...]
    counts: tuple[int, ...]
    """Periods of each; 0 for one that is left out."""

    @property
    def time(self) -> float:
        """Measuring time [s]."""
        return sum(record.time(count) for record, count in zip(self.records, self.counts, strict=True))

    @property
    def measured(self) -> list[tuple[PlannedRecord, int]]:
        """The records that are measured, each with its number of periods."""
        return [pair for pair in zip(self.records, self.counts, strict=True) if pair[1]]

    def covariance(self) -> NDArray[np.float64]:
        """Return the covariance of the shared parameters, shape (p, p)."""
        return np.asarray(np.linalg.pinv(sum(r.weight(n) * r.shared for r, n in self.measured), hermitian=True))

    def standard_deviations(self) -> NDArray[np.float64]:
        """Return the relative standard deviation of P̂ of each measured record, shape (n,).

        The shared parameters are told by all records, that of the response among them: see `covariances_beside`.
        """
        covariance, measured = self.covariance(), self.measured
        weights = np.array([record.weight(count) for record, count in measured])
        own = np.array([np.trace(record.own) for record, _ in measured]) / weights
        slopes, told = (np.array(each) for each in zip(*((r.slopes, r.told) for r, _ in measured), strict=True))
        by_shared = np.einsum("kip,pq,kiq->k", slopes, covariance, slopes + 2 * told)
        return np.asarray(np.sqrt(own + by_shared))


def log_deviation(plan: Plan, friction: int, is_wanted: Sequence[bool]) -> float:
    """Return the logarithm of what a plan leaves open: of wanted responses and of the first shared parameters.

    Of the responses it is the root mean square of the relative standard deviations, in which the widest band counts
    most; of friction's parameters, which have no common size, the geometric mean. Both count alike.
    """
    wanted = [each for each, count in zip(is_wanted, plan.counts, strict=True) if count]
    responses = plan.standard_deviations()[np.array(wanted, dtype=bool)]
    logs = [0.5 * np.log(np.mean(responses**2))]
    if friction:
        logs.append(0.5 * np.mean(np.log(np.diag(plan.covariance())[:friction])))
    return float(np.mean(logs))


PORTION = 0.01
"""Part of the measuring time that is moved from one record to another at once."""
TAKEN_PORTIONS, MAX_TAKEN = (1, 3), 4
"""How many portions are taken from a record, and from how many records in turn."""
ADDED_PORTIONS = (1, 3, 10)
"""How many portions are given to a record of at most one: where a second one begins, settling is waited for."""
MAX_EXCHANGES, MIN_GAIN = 400, 1e-5
"""Maximum number of exchanges, and the least gain of the criterion for which there is one."""
MAX_COUNT = 100_000


@dataclass(frozen=True)
class PlanSearch:
    """What can be measured, and for how long.

    To halve the bands of the responses counts as much as to halve those of friction's parameters.
    """

    choices: tuple[tuple[PlannedRecord, ...], ...]
    """Records of each frequency, one for each amplitude, shape (frequencies, amplitudes)."""
    is_wanted: tuple[bool, ...]
    """Whether the response of a frequency is wanted; others are measured only for what they tell of friction."""
    friction: int
    """Number of shared parameters, the first ones, that are friction's."""
    time: float
    """Measuring time [s]."""

    def criterion(self, plan: Plan) -> float:
        """Return what is to be as small as possible."""
        return log_deviation(plan, self.friction, self.is_wanted)

    @property
    def shortest_time(self) -> float:
        """Least time in which the wanted responses can be measured [s]."""
        pairs = zip(self.choices, self.is_wanted, strict=True)
        return sum(min(record.time(1) for record in records) for records, is_wanted in pairs if is_wanted)

    def uniform(self) -> Plan | None:
        """Return the best plan of one amplitude with equal times, or equal numbers of periods; None without time."""
        found = list(self._uniform_plans())
        return min(found, key=self.criterion) if found else None

    def _uniform_plans(self) -> Iterator[Plan]:
        amplitudes = range(min(len(records) for records in self.choices))
        for place, is_equal_time in product(amplitudes, (True, False)):
            records = tuple(
                each[place] for each, is_wanted in zip(self.choices, self.is_wanted, strict=True) if is_wanted
            )
            plans = [_uniform_plan(records, share, is_equal_time) for share in _shares(records, self.time)]
            fitting = [plan for plan in plans if plan.time <= self.time]
            if fitting:
                yield self._with_others(max(fitting, key=lambda plan: plan.time))

    def _with_others(self, plan: Plan) -> Plan:
        """Return the plan of wanted records with the others, which are not measured."""
        pairs, found = iter(zip(*plan, strict=True)), []
        for records, is_wanted in zip(self.choices, self.is_wanted, strict=True):
            found.append(next(pairs) if is_wanted else (records[0], 0))
        return Plan(*zip(*found, strict=True))

    def best(self) -> Plan | None:
        """Return the best plan to which exchanges lead from a plan of one amplitude; None without time."""
        found = [self._improved(plan) for plan in self._uniform_plans()]
        return min(found, key=self.criterion) if found else None

    def _improved(self, plan: Plan) -> Plan:
        """Return the plan to which exchanges lead from one."""
        cost = self.criterion(plan)
        for _ in range(MAX_EXCHANGES):
            found = self._with_best_amplitudes(plan)
            found = self._exchanged(found)
            reached = self.criterion(found)
            if cost - reached < MIN_GAIN:
                return plan if reached >= cost else found
            plan, cost = found, reached
        return plan

    def _with_best_amplitudes(self, plan: Plan) -> Plan:
        """Return the plan in which each record in turn has the amplitude that tells most in the same time."""
        for place, records in enumerate(self.choices):
            if plan.counts[place]:
                time = plan.records[place].time(plan.counts[place])
                options = [_with_record(plan, place, each, _count_within(each, time)) for each in records]
                plan = min([plan, *(o for o in options if o.counts[place])], key=self.criterion)
        return plan

    def _exchanged(self, plan: Plan) -> Plan:
        """Return the plan with time given to the records that make most of it, taken from one that needs it least."""
        before = self.criterion(plan)
        less = [
            option
            for place in range(len(plan.counts))
            for portions in TAKEN_PORTIONS
            if (option := self._shorter(plan, place, portions)) is not None
        ]
        less.sort(key=lambda option: (self.criterion(option) - before) / (plan.time - option.time))
        return min([plan, *map(self._fill, [plan, *less[:MAX_TAKEN]])], key=self.criterion)

    def _fill(self, plan: Plan) -> Plan:
        """Return the plan whose time is used up, by what gains most for the time that it takes."""
        while True:
            before, time = self.criterion(plan), plan.time
            more = [option for place in range(len(plan.counts)) for option in self._longer(plan, place)]
            gains = [(before - self.criterion(o)) / (o.time - time) if o.time <= self.time else 0.0 for o in more]
            if max(gains, default=0.0) <= 0:
                return plan
            plan = more[int(np.argmax(gains))]

    def _longer(self, plan: Plan, place: int) -> Iterator[Plan]:
        record, count = plan.records[place], plan.counts[place]
        for each in (record,) if count else self.choices[place]:
            for portions in ADDED_PORTIONS if count <= self._portion(each) else (1,):
                yield _with_record(plan, place, each, min(count + portions * self._portion(each), MAX_COUNT))

    def _shorter(self, plan: Plan, place: int, portions: int) -> Plan | None:
        record, count = plan.records[place], plan.counts[place]
        fewer = max(count - portions * self._portion(record), int(self.is_wanted[place]))
        return _with_record(plan, place, record, fewer) if fewer < count else None

    def _portion(self, record: PlannedRecord) -> int:
        return max(round(PORTION * self.time / record.period), 1)


def _with_record(plan: Plan, place: int, record: PlannedRecord, count: int) -> Plan:
    records, counts = list(plan.records), list(plan.counts)
    records[place], counts[place] = record, count
    return Plan(tuple(records), tuple(counts))


def _count_within(record: PlannedRecord, time: float) -> int:
    """Return the number of periods for which there is time [s]."""
    count = int((time - record.settled) / record.period + 1e-9)
    return count if count > 1 else int(record.time(1) <= time)


def _shares(records: Sequence[PlannedRecord], time: float) -> list[float]:
    """Return times [s] for each record that may fill the measuring time."""
    return np.geomspace(min(record.period for record in records), max(time, 1e-9), 400).tolist()


def _uniform_plan(records: tuple[PlannedRecord, ...], share: float, is_equal_time: bool) -> Plan:
    """Return the plan in which each record lasts as long, or has as many periods as that of the shortest period."""
    if is_equal_time:
        return Plan(records, tuple(max(round(share / record.period), 1) for record in records))
    count = max(int(share / min(record.period for record in records)), 1)
    return Plan(records, (count,) * len(records))
