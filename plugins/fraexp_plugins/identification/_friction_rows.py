"""Rows of a regression: records, how friction shows in them, and the terms beside a law."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import comb
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Finding, Quantity, RecordError, Segment, Signals
from fraexp_plugins.identification._usable_records import HELD_OUT_STEP

CYCLE_STROKE_RATIO = 0.25
"""Swing over the stroke with which a reversal begins another cycle."""
MIN_QUANTISED_RATIO = 0.9
"""Fraction of a position's steps that are multiples of the smallest one, from which that is the quantisation step."""


def reversals(displacement: NDArray[np.float64]) -> list[int]:
    """Return the samples at which monotone parts of the motion end, the last sample included."""
    change = np.diff(displacement)
    moving = np.flatnonzero(change)
    turns = np.flatnonzero(np.diff(np.sign(change[moving])))
    ends = moving[turns + 1].tolist()
    return [*ends, displacement.size - 1] if displacement.size > 1 else []


def turning_points(displacement: NDArray[np.float64], swing: float) -> NDArray[np.int64]:
    """Return the samples at which the motion turns by more than `swing` [m], ascending, shape (turns,)."""
    ends = np.array([0, *reversals(displacement)])
    found: list[int] = []
    highest = lowest = 0
    direction = 0
    for sample in ends.tolist():
        y = displacement[sample]
        highest = sample if y > displacement[highest] else highest
        lowest = sample if y < displacement[lowest] else lowest
        if direction >= 0 and displacement[highest] - y > swing:
            found += [highest]
            direction, lowest = -1, sample
        elif direction <= 0 and y - displacement[lowest] > swing:
            found += [lowest]
            direction, highest = 1, sample
    return np.array([turn for turn in found if turn > 0], dtype=int)


@dataclass(frozen=True)
class FrictionRecord:
    """A record without gaps, from one segment."""

    sample_time: float
    """Sample time [s]."""
    displacement: NDArray[np.float64]
    """Displacement [m], shape (n,)."""
    force: NDArray[np.float64]
    """Friction force, or the thrust that drives mass and friction [N], shape (n,)."""
    before: NDArray[np.float64]
    """Displacement before the record [m] since all elements were at rest or have forgotten their state, shape (m,)."""
    from_rest: bool
    """Whether the elements were at rest when it began."""
    periodic: bool
    """Whether the displacement is periodic."""
    cycle: NDArray[np.int64]
    """Number of the cycle of each sample, over all records, shape (n,)."""

    def first_known_sample(self, max_threshold: float) -> int:
        """Return the first sample at which elements up to the threshold `max_threshold` [m] have forgotten their state.

        A stop operator forgets its initial state once the motion has spanned twice its threshold.
        """
        if self.from_rest:
            return 0
        motion = np.concatenate([self.before, self.displacement])
        span = np.maximum.accumulate(motion) - np.minimum.accumulate(motion)
        known = int(np.searchsorted(span, 2 * max_threshold * (1 - 1e-12)))
        return max(known - self.before.size, 0)

    def velocity(self) -> NDArray[np.float64]:
        """Return the velocity [m/s], shape (n,)."""
        if self.periodic:
            omega = 2 * np.pi * np.fft.rfftfreq(self.displacement.size, self.sample_time)
            return np.fft.irfft(1j * omega * np.fft.rfft(self.displacement), self.displacement.size)
        return np.gradient(self.displacement, self.sample_time)


def friction_records(signals: Signals, displacement: str, force: str) -> list[FrictionRecord]:
    """Return the record of each segment; RecordError for channels that are missing or do not move."""
    for name, unit in ((displacement, "m"), (force, "N")):
        if (found_unit := signals.unit(name)) != unit:  # kilograms do not follow from volts
            raise RecordError(
                f"'{name}' is in {found_unit}; expected {unit}: give the channel its gain, such as 'x * 31.5 [{unit}]'"
            )
    found: list[FrictionRecord] = []
    first_cycle = 0
    for segment in signals.segments:
        record = _friction_record(segment, displacement, force, first_cycle)
        if np.ptp(record.displacement) == 0:
            raise RecordError(f"'{displacement}' does not move; expected a back-and-forth motion: raise the excitation")
        first_cycle = int(record.cycle.max()) + 1
        found.append(record)
    if not found:
        raise RecordError("the signals are empty; expected a record of displacement and force")
    return found


def _friction_record(segment: Segment, displacement: str, force: str, first_cycle: int) -> FrictionRecord:
    periods = segment.channels[displacement]
    y = periods.ravel().astype(float)
    from_rest = segment.settling is not None and segment.settling.time == 0
    # A simulated record in the steady state is periodic, a measured one need not be. The Fourier transform
    # differentiates only a periodic one: of another it makes ripple from the jump between its end and its beginning.
    repeats = segment.settling is not None or len(periods) == 1
    is_periodic = segment.periodic and not from_rest and repeats
    return FrictionRecord(
        sample_time=segment.sample_time,
        displacement=y,
        force=segment.channels[force].ravel().astype(float),
        before=y if is_periodic else np.empty(0),
        from_rest=from_rest,
        periodic=is_periodic,
        cycle=first_cycle + _cycles(y, len(periods)),
    )


def _cycles(displacement: NDArray[np.float64], periods: int) -> NDArray[np.int64]:
    """Return the cycle number of each sample: its period, its back-and-forth motion, or a part of the record."""
    size = displacement.size
    if periods >= HELD_OUT_STEP:
        return np.repeat(np.arange(periods), size // periods)
    turns = turning_points(displacement, CYCLE_STROKE_RATIO * float(np.ptp(displacement)))[::2]
    if turns.size < HELD_OUT_STEP:
        return np.arange(size) * 2 * HELD_OUT_STEP // size
    return np.searchsorted(turns, np.arange(size), side="right")


def quantisation_step(records: Sequence[FrictionRecord]) -> float:
    """Return the quantisation step of the encoder [m] that the positions show; 0 if they show none."""
    steps = np.abs(np.concatenate([np.diff(record.displacement) for record in records]))
    largest = float(steps.max())
    moving = steps[steps > 1e-9 * largest]
    smallest = float(np.percentile(moving, 1))
    multiples = moving / smallest
    whole = float(np.mean(np.abs(multiples - np.rint(multiples)) < 0.02))
    has_constant_velocity = largest < 1.5 * smallest and moving.size > MIN_QUANTISED_RATIO * steps.size
    return smallest if whole > MIN_QUANTISED_RATIO and not has_constant_velocity else 0.0


FILTER_HALF_LENGTH_STDS = 4.0
"""Half length of the low-pass filter in its standard deviations."""
HAT_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6
"""Effect of a force that is linear between samples on the second difference of the position."""
DIFFERENCE_ORDER = 8
"""Order of the differences that show noise: with half of it fast motion looks like noise."""
HELD, EVEN = 0.0, 0.5
"""Samples by which a thrust comes earlier than a held one: one that is held, and one that goes on between samples."""
TRIM_START, TRIM_END = 0.4, 0.15
"""Parts of a run that are left out: presliding and the loop settle at its start, and it brakes at its end."""
MAX_VELOCITY_CHANGE = 0.1
"""Relative difference of the velocities of a run's two halves up to which the velocity is constant."""


class Observation(ABC):
    """The rows of a regression that a record gives: each is a linear combination of samples."""

    min_rows: int = 60
    """Rows that a regression needs."""
    rows_name: str = "rows"

    @abstractmethod
    def force(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the left-hand side of the regression [N], shape (rows, 1)."""

    @abstractmethod
    def friction(self, record: FrictionRecord, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the regression's columns, shape (rows, p), of friction forces at the samples, shape (n, p)."""

    @abstractmethod
    def acceleration(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the column of the mass [m/s²], shape (rows, 1)."""

    @abstractmethod
    def noise(self, record: FrictionRecord, mass: float) -> float:
        """Return the standard deviation of a row's force [N] by white noise of the channels."""

    @abstractmethod
    def samples(self, record: FrictionRecord) -> NDArray[np.int64]:
        """Return the sample in the middle of each row, shape (rows,)."""

    def rows_per_noise(self, record: FrictionRecord) -> float:
        """Return over how many rows white noise of the channels is correlated."""
        return 1.0

    def successive(self, residuals: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
        """Return the residuals of rows [N] in parts between which they are independent."""
        return list(residuals)


class MeasuredFriction(Observation):
    """A measured friction force: each sample is a row."""

    def force(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the measured force."""
        return record.force[:, None]

    def friction(self, record: FrictionRecord, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the columns as they are."""
        return columns

    def acceleration(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return no acceleration: measured friction accelerates nothing."""
        return np.zeros((record.displacement.size, 1))

    def noise(self, record: FrictionRecord, mass: float) -> float:
        """Return the noise of the force."""
        return white_noise(record.force)

    def samples(self, record: FrictionRecord) -> NDArray[np.int64]:
        """Return all samples."""
        return np.arange(record.displacement.size)


@dataclass(frozen=True)
class ThrustAndMotion(Observation):
    """Friction as the part of the thrust that does not accelerate the mass.

    The second difference of the position of a mass M obeys M (y₊ - 2y + y₋)/Ts² = the mean of thrust less friction
    over two samples, weighted by a triangle: exactly, for a held thrust and a friction that is linear between samples.
    The same filter acts on both sides, so that the noise of a differentiated encoder signal does not enter.
    """

    max_frequency: float
    """Frequency up to which both are compared [Hz]."""
    delay: float
    """Delay of a held thrust relative to the position's samples [s]."""
    lead: float = HELD
    """Samples by which the thrust comes earlier than a held one."""

    def force(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the delayed and filtered thrust."""
        delay = self.delay / record.sample_time - self.lead
        whole = int(np.floor(delay + 1e-9))
        part = max(delay - whole, 0.0)
        weights = ((1 - part) ** 2 / 2, 0.5 + part - part**2, part**2 / 2)
        shifted = [weight * np.roll(record.force, whole + step) for step, weight in enumerate(weights)]
        return self._filter(record, np.sum(shifted, axis=0)[:, None])

    def friction(self, record: FrictionRecord, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the filtered effect of the columns on the second difference."""
        before, after = np.roll(columns, 1, axis=0), np.roll(columns, -1, axis=0)
        return self._filter(record, HAT_WEIGHTS[0] * before + HAT_WEIGHTS[1] * columns + HAT_WEIGHTS[2] * after)

    def acceleration(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the filtered second difference of the position."""
        y = record.displacement
        second = (np.roll(y, -1) - 2 * y + np.roll(y, 1)) / record.sample_time**2
        return self._filter(record, second[:, None])

    def noise(self, record: FrictionRecord, mass: float) -> float:
        """Return what the filter leaves of the noise of thrust and motion."""
        taps, step = self._taps(record), np.array([1.0, -2.0, 1.0]) / record.sample_time**2
        by_force = white_noise(record.force) * np.linalg.norm(taps)
        by_motion = mass * white_noise(record.displacement) * np.linalg.norm(np.convolve(taps, step))
        return float(np.hypot(by_force, by_motion))

    def samples(self, record: FrictionRecord) -> NDArray[np.int64]:
        """Return the samples on which the filter is centred."""
        half_length, step, margin = self._filter_sizes(record)
        return np.arange(margin + half_length, record.displacement.size - margin - half_length, step)

    def rows_per_noise(self, record: FrictionRecord) -> float:
        """Return over how many rows the low-pass correlates white noise.

        White noise after a Gaussian of standard deviation s is correlated over 2 √π s.
        """
        return float(max(2 * np.sqrt(np.pi) * self._filter_std(record) / self._filter_sizes(record).step, 1.0))

    def _taps(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the taps of the Gaussian low-pass, -3 dB at `max_frequency`."""
        half_length = self._filter_sizes(record).half_length
        taps = np.exp(-((np.arange(-half_length, half_length + 1) / self._filter_std(record)) ** 2) / 2)
        return np.asarray(taps / taps.sum())

    def _filter_std(self, record: FrictionRecord) -> float:
        """Return the standard deviation of the low-pass in samples."""
        return np.sqrt(np.log(2)) / (2 * np.pi * self.max_frequency) / record.sample_time

    def _filter_sizes(self, record: FrictionRecord) -> "_FilterSizes":
        """Return the sizes of the low-pass."""
        std = self._filter_std(record)
        delay = int(np.ceil(abs(self.delay) / record.sample_time)) + 1
        return _FilterSizes(int(np.ceil(FILTER_HALF_LENGTH_STDS * std)), max(int(std), 1), delay + 2)

    def _filter(self, record: FrictionRecord, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return low-pass filtered columns at all rows."""
        half_length, step, margin = self._filter_sizes(record)
        inner = columns[margin : len(columns) - margin]
        if len(inner) <= 2 * half_length:
            raise RecordError(
                f"a record of {len(columns) * record.sample_time:g} s is too short for a low-pass of "
                f"{self.max_frequency:g} Hz; record for longer, or raise max_frequency"
            )
        taps = self._taps(record)
        windows = np.lib.stride_tricks.sliding_window_view(inner, taps.size, axis=0)[::step]
        return np.einsum("rpt,t->rp", windows, taps)


class _FilterSizes(NamedTuple):
    """Sizes of the low-pass in samples."""

    half_length: int
    step: int
    """Distance of the rows."""
    margin: int
    """Samples at the ends of a record that have no neighbours, or no delayed thrust."""


class ConstantVelocityRuns(Observation):
    """The mean of each run at constant velocity is a row: force over velocity, eq (12).

    A run is the motion from one reversal to the next without its beginning, in which presliding and the loop settle,
    and without its end. What its velocity still changes is the acceleration of the mass.
    """

    min_rows = 4
    rows_name = "runs at constant velocity"

    def force(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the mean force of each run."""
        return self.friction(record, record.force[:, None])

    def friction(self, record: FrictionRecord, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the means of the columns over each run."""
        means = [np.mean(columns[run.first : run.last], axis=0) for run in _runs(record)]
        return np.array(means).reshape(len(means), columns.shape[1])

    def acceleration(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the mean acceleration of each run."""
        return np.array([run.acceleration for run in _runs(record)]).reshape(-1, 1)

    def noise(self, record: FrictionRecord, mass: float) -> float:
        """Return the noise of the shortest run's mean."""
        shortest = min((run.last - run.first for run in _runs(record)), default=1)
        return white_noise(record.force) / np.sqrt(shortest)

    def samples(self, record: FrictionRecord) -> NDArray[np.int64]:
        """Return the middle of each run."""
        return np.array([(run.first + run.last) // 2 for run in _runs(record)], dtype=np.int64)

    def successive(self, residuals: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
        """Return each run by itself."""
        return [each for part in residuals for each in part[:, None]]


class _Run(NamedTuple):
    """A run at constant velocity."""

    first: int
    last: int
    acceleration: float
    """[m/s²]"""


def _runs(record: FrictionRecord) -> list[_Run]:
    """Return the runs of a record."""
    y, stroke = record.displacement, float(np.ptp(record.displacement))
    turns = turning_points(y, CYCLE_STROKE_RATIO * stroke).tolist()
    found = []
    for begin, stop in zip([0, *turns], [*turns, y.size - 1], strict=True):
        length = stop - begin
        first, last = begin + int(TRIM_START * length), stop - int(TRIM_END * length)
        if last - first < 4 or abs(y[stop] - y[begin]) < CYCLE_STROKE_RATIO * stroke:
            continue
        middle = (first + last) // 2
        halves = np.array([(y[middle] - y[first]) / (middle - first), (y[last] - y[middle]) / (last - middle)])
        if np.ptp(halves) < MAX_VELOCITY_CHANGE * np.abs(halves).mean():
            change = (halves[1] - halves[0]) / record.sample_time**2 / ((last - first) / 2)
            found.append(_Run(first, last, float(change)))
    return found


def white_noise(values: NDArray[np.float64]) -> float:
    """Return an upper bound of the standard deviation of white noise on a smooth signal, by high-order differences."""
    differences = np.diff(values, DIFFERENCE_ORDER)
    if not differences.size:
        return 0.0
    median = float(np.median(np.abs(differences))) / NormalDist().inv_cdf(0.5 + 0.25)  # over that of |x|
    return median / np.sqrt(comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER))


@dataclass(frozen=True)
class Rows:
    """Rows of a regression that a record gives: columns, left-hand side, and their place in the record."""

    columns: NDArray[np.float64]
    """Shape (rows, p): those of either sign first, then forces that are not negative."""
    force: NDArray[np.float64]
    """Shape (rows,) [N]."""
    velocity: NDArray[np.float64]
    """Shape (rows,) [m/s]."""
    cycle: NDArray[np.int64]
    """Shape (rows,)."""
    time: NDArray[np.float64]
    """Time of the middle of each row [s], shape (rows,)."""
    place: NDArray[np.int64]
    """Place among all rows of the record, shape (rows,)."""

    def select(self, chosen: NDArray[np.bool_]) -> "Rows":
        """Return some of the rows."""
        return replace(self, **{each.name: getattr(self, each.name)[chosen] for each in fields(self)})


TERM_UNITS = {"mass": "kg", "viscous": "N s/m", "offset": "N", "asymmetry": "N s/m"}
"""Terms that may be fitted beside a law, with their units."""
SIGNED_TERMS = ("offset", "asymmetry")
"""Those of either sign, which come first; all others are not negative."""
MAX_UNKNOWN_WEIGHT = 1e-3
"""Weight of samples whose friction is unknown up to which a row is used."""
STANDSTILL_SPEED_RATIO = 0.3
"""Speed over that of sliding below which the machine turns: a jump of friction looks like inertia there."""


@dataclass(frozen=True)
class FrictionProblem:
    """Records, their observation, and the terms beside a law."""

    records: tuple[FrictionRecord, ...]
    observation: Observation
    terms: tuple[str, ...]
    """Those of either sign first."""
    known: tuple[NDArray[np.bool_], ...]
    """Whether the law's force is known at each sample of a record if its parameters are, shape (n,) each."""
    thresholds: NDArray[np.float64]
    """Y_i of the grid [m], ascending, shape (N,)."""
    viscous: float | None
    """Known viscous coefficient [N s/m], or None."""
    resolution: float
    """Quantisation step of the encoder [m]; 0 if it is ideal."""
    held_out: NDArray[np.int64]
    """Numbers of the cycles that are held out."""
    cycles: NDArray[np.int64]
    """Numbers of the cycles that are fitted."""
    findings: tuple[Finding | str, ...] = ()
    speed: float | None = None
    """The speed of all sliding [m/s] if there is only one."""
    is_sliding: bool = False
    """Whether only rows in which the machine slides are fitted."""
    lead_doubt: float = 0.0
    """Samples by which the thrust may come earlier than the observation assumes."""

    @cached_property
    def rows(self) -> list[Rows]:
        """Rows of each record, with the terms as columns."""
        found = [self._rows(*pair) for pair in zip(self.records, self.known, strict=True)]
        count = sum(each.force.size for each in found)
        if count < self.observation.min_rows:
            spans: tuple[Quantity | str, ...] = ("the machine slides",)
            if self.thresholds.size:
                largest = Quantity(float(self.thresholds.max()), "m")
                spans = ("the motion spans twice the largest threshold, ", largest, ",")
            found_rows = f" in {count} {self.observation.rows_name}; expected {self.observation.min_rows} or more: "
            raise RecordError(*spans, found_rows, "record more cycles with gross sliding")
        return found

    def _rows(self, record: FrictionRecord, known: NDArray[np.bool_]) -> Rows:
        seen, v = self.observation, record.velocity()
        plain = seen.friction(record, np.column_stack([np.ones_like(v), np.abs(v), v, ~known]))
        columns = dict(zip(("offset", "asymmetry", "viscous", "unknown"), plain.T, strict=True))
        columns["mass"] = seen.acceleration(record)[:, 0]
        samples = seen.samples(record)
        every = Rows(
            columns=np.array([columns[term] for term in self.terms]).reshape(-1, samples.size).T,
            force=seen.force(record)[:, 0] - (self.viscous or 0.0) * columns["viscous"],
            velocity=columns["viscous"],
            cycle=record.cycle[samples],
            time=np.asarray(record.sample_time * samples, dtype=np.float64),
            place=np.arange(samples.size),
        )
        return every.select(columns["unknown"] < MAX_UNKNOWN_WEIGHT)

    def forces_in_rows(self, forces: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
        """Return forces at the samples of each record, shape (n, N), in its rows, shape (rows, N)."""
        triples = zip(self.records, forces, self.rows, strict=True)
        return [self.observation.friction(record, each)[rows.place] for record, each, rows in triples]

    def rows_with(self, forces: Sequence[NDArray[np.float64]]) -> list[Rows]:
        """Return the rows with further columns, of forces at the samples of each record, shape (n, N)."""
        pairs = zip(self.rows, self.forces_in_rows(forces), strict=True)
        return [replace(rows, columns=np.hstack([rows.columns, each])) for rows, each in pairs]

    @property
    def signed(self) -> int:
        """Number of terms of either sign."""
        return sum(term in SIGNED_TERMS for term in self.terms)

    def fitted(self, parts: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
        """Return what belongs to the cycles that are fitted, of each record."""
        return [part[np.isin(rows.cycle, self.cycles)] for part, rows in zip(parts, self.rows, strict=True)]

    def with_lead(self, lead: float) -> "FrictionProblem":
        """Return the problem with a thrust that comes so many samples earlier than a held one."""
        assert isinstance(self.observation, ThrustAndMotion)
        return replace(self, observation=replace(self.observation, lead=lead))

    @property
    def thrust_doubt(self) -> NDArray[np.float64]:
        """Change of the forces of all fitted rows [N] by the lead of the thrust that is not known, shape (rows,)."""
        assert isinstance(self.observation, ThrustAndMotion)
        moved = self.with_lead(self.observation.lead + self.lead_doubt)
        return np.concatenate(self.fitted([a.force - b.force for a, b in zip(moved.rows, self.rows, strict=True)]))

    def noise(self, mass: float) -> float:
        """Return the error of a row [N] by noise of the channels."""
        return max(self.observation.noise(record, max(mass, 0.0)) for record in self.records)

    @property
    def rows_per_noise(self) -> float:
        """Rows over which white noise is correlated."""
        return self.observation.rows_per_noise(self.records[0])

    @property
    def standstill_time(self) -> float:
        """Standstill time at a reversal of a motion at one speed, plus one sample [s]."""
        return max(_standstill_time(record, self.speed or 0.0) for record in self.records)


def _standstill_time(record: FrictionRecord, speed: float) -> float:
    turns = turning_points(record.displacement, speed * record.sample_time).size
    slow = int(np.sum(np.abs(record.velocity()) < STANDSTILL_SPEED_RATIO * speed))
    return (1 + slow / max(turns, 1)) * record.sample_time
