"""The plan of a measurement that tells most in a given time: amplitude and number of periods of each frequency."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from fraexp_plugins.identification.whole_record._shared.planned_records import (
    Plan,
    PlannedRecord,
    log_deviation,
)

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
