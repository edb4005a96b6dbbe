"""Records of force and motion, and the rows of a regression that they give."""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ROUNDING, Finding, Quantity, RecordError, Segment, Signals, grid_step
from fraexp_plugins.identification._usable_records import FORCE_FLOOR, HELD_OUT_STEP

CYCLE_STROKE_RATIO = 0.25
"""Swing over the stroke with which a reversal begins another cycle."""


def turning_points(displacement: NDArray[np.float64], swing: float) -> NDArray[np.int64]:
    """Return the samples at which the motion turns by more than `swing` [m], ascending, shape (turns,)."""
    change = np.diff(displacement)
    moving = np.flatnonzero(change)
    ends = moving[np.flatnonzero(np.diff(np.sign(change[moving]))) + 1]  # of monotone parts
    found: list[int] = []
    highest = lowest = 0
    direction = 0
    for sample in [*ends.tolist(), displacement.size - 1]:
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


@dataclass(frozen=True, eq=False)
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

    @cached_property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity [m/s], shape (n,)."""
        if self.periodic:
            omega = 2 * np.pi * np.fft.rfftfreq(self.displacement.size, self.sample_time)
            return np.fft.irfft(1j * omega * np.fft.rfft(self.displacement), self.displacement.size)
        return np.gradient(self.displacement, self.sample_time)


def friction_records(signals: Signals, displacement: str, force: str) -> list[FrictionRecord]:
    """Return the record of each segment; RecordError for channels that are missing or do not move.

    A velocity of a record that does not repeat itself stands for its position: no law asks where that begins.
    """
    if signals.unit(displacement) == "m/s":
        signals = _integrated(signals, displacement)
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


def _integrated(signals: Signals, name: str) -> Signals:
    """Return the signals with the position in place of a velocity; RecordError for one that is periodic."""
    if any(segment.periodic for segment in signals.segments):
        raise RecordError(f"'{name}' is a velocity; expected a position: integrate it (--integrate {name})")
    segments = []
    for segment in signals.segments:
        speed = segment.channels[name]
        position = (np.cumsum(speed, axis=1) - (speed + speed[:, :1]) / 2) * segment.sample_time  # by trapezoids
        segments.append(replace(segment, channels={**segment.channels, name: position}))
    return replace(signals, segments=tuple(segments), units={**signals.units, name: "m"})


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
    step = grid_step(np.concatenate([record.displacement for record in records]))
    change = np.abs(np.concatenate([np.diff(record.displacement) for record in records]))
    has_constant_velocity = change.max() < 1.5 * step and np.mean(change > 0.5 * step) > 0.9
    return 0.0 if has_constant_velocity else step


FILTER_HALF_LENGTH_STDS = 4.0
"""Half length of the low-pass filter in its standard deviations."""
DIFFERENCE_ORDER = 8
"""Order of the differences that show noise: with half of it fast motion looks like noise."""
TRIM_START, TRIM_END = 0.4, 0.15
"""Parts of a run that are left out: presliding and the loop settle at its start, and it brakes at its end."""
MAX_VELOCITY_CHANGE = 0.1
"""Relative difference of the velocities of a run's two halves up to which the velocity is constant."""


class RowWeights(NamedTuple):
    """The weights of a record's samples in the rows of a regression: sparse matrices of shape (rows, n)."""

    force: Any
    """Of the measured force."""
    friction: Any
    """Of a friction force at the samples."""
    acceleration: Any
    """Of the displacement [1/s²]: the acceleration that the measured force has to explain."""

    @classmethod
    def of_records(cls, parts: Sequence["RowWeights"]) -> "RowWeights":
        """Return the weights of the samples of several records, one after the other."""
        from scipy.sparse import block_diag  # slow to import: only when something is estimated

        return cls(*(block_diag(each, format="csr") for each in zip(*parts, strict=True)))

    def select(self, chosen: NDArray[np.bool_]) -> "RowWeights":
        """Return the weights of some rows."""
        return RowWeights(*(each[chosen] for each in self))

    def noise(self, record: FrictionRecord, mass: float) -> float:
        """Return the greatest standard deviation of a row's force [N] by white noise of the channels."""
        by_force, by_motion = (
            np.sqrt(each.power(2).sum(axis=1).max() if each.nnz else 0.0) for each in (self.force, self.acceleration)
        )
        return float(
            np.hypot(white_noise(record.force) * by_force, mass * white_noise(record.displacement) * by_motion)
        )

    def rows_per_noise(self) -> float:
        """Return over how many rows white noise of the force is correlated."""
        products = self.force @ self.force.T
        return float(np.median(np.asarray(products.sum(axis=1)).ravel() / products.diagonal()))


class Observation(ABC):
    """How a record's samples give the rows of a regression."""

    min_rows: int = 60
    """Rows that a regression needs."""
    rows_name: str = "rows"
    later: float = 0.0
    is_independent: bool = False
    """Whether the rows are independent of each other."""

    @abstractmethod
    def weights(self, record: FrictionRecord) -> RowWeights:
        """Return the weights of the samples in the rows; RecordError for a record that is too short."""


class MeasuredFriction(Observation):
    """A measured friction force, which accelerates nothing: each sample is a row."""

    def weights(self, record: FrictionRecord) -> RowWeights:
        """Return a weight of 1 for each sample."""
        each = _band((1.0,), 0, record.displacement.size)
        return RowWeights(each, each, 0.0 * each)


@dataclass(frozen=True)
class ThrustAndMotion(Observation):
    """Friction as the part of the thrust that does not accelerate the mass.

    The second difference of the position of a mass M obeys M (y₊ - 2y + y₋)/Ts² = the mean of thrust less friction
    over two samples, weighted by a triangle: exactly, for a held thrust and a friction that is linear between samples.
    The same low-pass, a Gaussian with -3 dB at `max_frequency`, acts on both sides, so that the noise of a
    differentiated encoder signal does not enter.
    """

    max_frequency: float
    """Frequency up to which both are compared [Hz]."""
    delay: float
    """Delay of a held thrust relative to the position's samples [s]."""
    later: float = 0.0
    """Further dead time that was found [s]."""

    def weights(self, record: FrictionRecord) -> RowWeights:
        """Return the weights in low-pass filtered second differences."""
        low_pass, size = self._low_pass(record), record.displacement.size
        delay = (self.delay + self.later) / record.sample_time
        whole = int(np.floor(delay + 1e-9))
        part = max(delay - whole, 0.0)
        late = part**2 / 2, 0.5 + part - part**2, (1 - part) ** 2 / 2
        per_square = record.sample_time**-2
        return RowWeights(
            low_pass @ _band(late, -whole - 1, size),
            low_pass @ _band((1 / 6, 4 / 6, 1 / 6), 0, size),
            low_pass @ _band((per_square, -2 * per_square, per_square), 0, size),
        )

    def _low_pass(self, record: FrictionRecord) -> Any:
        """Return the weights of the low-pass, shape (rows, n); rows are a standard deviation apart."""
        from scipy.sparse import csr_array  # slow to import: only when something is estimated

        size = record.displacement.size
        std = np.sqrt(np.log(2)) / (2 * np.pi * self.max_frequency) / record.sample_time
        half_length = int(np.ceil(FILTER_HALF_LENGTH_STDS * std))
        margin = half_length + int(np.ceil(abs(self.delay + self.later) / record.sample_time)) + 2
        centres = np.arange(margin, size - margin, max(int(std), 1))
        if not centres.size:
            raise RecordError(
                f"a record of {size * record.sample_time:g} s is too short for a low-pass of "
                f"{self.max_frequency:g} Hz; record for longer, or raise max_frequency"
            )
        lags = np.arange(-half_length, half_length + 1)
        taps = np.exp(-((lags / std) ** 2) / 2)
        ends = np.arange(centres.size + 1) * taps.size
        table = np.tile(taps / taps.sum(), centres.size), (centres[:, None] + lags).ravel(), ends
        return csr_array(table, shape=(centres.size, size))


class ConstantVelocityRuns(Observation):
    """The mean of each run at constant velocity is a row: force over velocity, eq (12).

    A run is the motion from one reversal to the next without its beginning, in which presliding and the loop settle,
    and without its end. What its velocity still changes is the acceleration of the mass.
    """

    min_rows = 4
    rows_name = "runs at constant velocity"
    is_independent = True

    def weights(self, record: FrictionRecord) -> RowWeights:
        """Return the weights of means over runs, and of differences between the velocities of their halves."""
        from scipy.sparse import lil_array  # slow to import: only when something is estimated

        runs = _runs(record)
        means, differences = (lil_array((len(runs), record.displacement.size)) for _ in range(2))
        for row, (first, last) in enumerate(runs):
            middle, factor = (first + last) // 2, 2 / (last - first) / record.sample_time**2
            means[row, first:last] = 1 / (last - first)
            halves = 1 / (middle - first), 1 / (last - middle)
            differences[row, [first, middle, last]] = factor * np.array([halves[0], -sum(halves), halves[1]])
        return RowWeights(means.tocsr(), means.tocsr(), differences.tocsr())


def _band(values: Sequence[float], offset: int, size: int) -> Any:
    """Return a sparse matrix of shape (size, size) with these values beside each other in each row."""
    from scipy.sparse import diags_array  # slow to import: only when something is estimated

    first = offset - len(values) // 2
    return diags_array(values, offsets=range(first, first + len(values)), shape=(size, size), format="csr")


def _runs(record: FrictionRecord) -> list[tuple[int, int]]:
    """Return first and last sample of each run of a record."""
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
            found.append((first, last))
    return found


def white_noise(values: NDArray[np.float64]) -> float:
    """Return an upper bound of the standard deviation of white noise on a smooth signal, by high-order differences."""
    differences = np.diff(values, DIFFERENCE_ORDER)
    if not differences.size:
        return 0.0
    median = float(np.median(np.abs(differences))) / NormalDist().inv_cdf(0.5 + 0.25)  # over that of |x|
    return median / np.sqrt(comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER))


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a regression that records give: columns, left-hand side, and their place in the records."""

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
    record: NDArray[np.int64]
    """Place of the record of each row, shape (rows,)."""
    weights: RowWeights
    """Weights of the samples of all records, one after the other."""


TERM_UNITS = {"mass": "kg", "viscous": "N s/m", "offset": "N", "asymmetry": "N s/m", "dead_time": "s"}
"""Terms that may be fitted beside a law, with their units."""
SIGNED_TERMS = ("offset", "asymmetry", "dead_time")
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
    findings: tuple[Finding | str, ...] = ()
    speed: float | None = None
    """The speed of all sliding [m/s] if there is only one."""
    is_sliding: bool = False
    """Whether only rows in which the machine slides are fitted."""
    row_std: float = 0.0
    """Standard deviation of a row [N], to which what is known before of a dead time is compared."""

    @cached_property
    def rows(self) -> Rows:
        """Rows of all records, with the terms as columns; RecordError for too few."""
        weights = RowWeights.of_records([self.observation.weights(record) for record in self.records])
        unknown = weights.friction @ (~np.concatenate(self.known)).astype(float)
        weights = weights.select(unknown < MAX_UNKNOWN_WEIGHT)
        self._check_count(weights.friction.shape[0])
        y, force, v, cycle = (
            np.concatenate([getattr(record, name) for record in self.records])
            for name in ("displacement", "force", "velocity", "cycle")
        )
        slopes = np.concatenate([np.gradient(record.force, record.sample_time) for record in self.records])
        columns = {name: weights.friction @ each for name, each in (("asymmetry", np.abs(v)), ("viscous", v))}
        columns |= {"mass": weights.acceleration @ y, "dead_time": weights.force @ slopes}
        columns["offset"] = np.ones(weights.friction.shape[0])
        first = np.cumsum([0, *(record.force.size for record in self.records)])
        samples = np.rint(weights.friction @ np.arange(v.size)).astype(np.int64)
        place = np.searchsorted(first, samples, side="right") - 1
        return Rows(
            columns=np.column_stack([columns[term] for term in self.terms]),
            force=weights.force @ force - (self.viscous or 0.0) * columns["viscous"],
            velocity=columns["viscous"],
            cycle=cycle[samples],
            time=np.array([record.sample_time for record in self.records])[place] * (samples - first[place]),
            record=place,
            weights=weights,
        )

    def _check_count(self, count: int) -> None:
        if count >= self.observation.min_rows:
            return
        spans: tuple[Quantity | str, ...] = ("the machine slides",)
        if self.thresholds.size:
            largest = Quantity(float(self.thresholds.max()), "m")
            spans = ("the motion spans twice the largest threshold, ", largest, ",")
        found_rows = f" in {count} {self.observation.rows_name}; expected {self.observation.min_rows} or more: "
        wider = ", or raise max_frequency" if isinstance(self.observation, ThrustAndMotion) else ""
        raise RecordError(*spans, found_rows, f"record more cycles with gross sliding{wider}")

    @cached_property
    def is_fitted(self) -> NDArray[np.bool_]:
        """Whether each row belongs to a cycle that is fitted, shape (rows,)."""
        return ~np.isin(self.rows.cycle, self.held_out)

    @property
    def is_judge(self) -> NDArray[np.bool_]:
        """Whether a fit is judged by each row, shape (rows,): those that are held out, or all if none are."""
        return self.is_fitted if self.is_fitted.all() else ~self.is_fitted

    @property
    def judging_rows(self) -> float:
        """How many of these are independent, if the residual is noise."""
        return max(float(self.is_judge.sum()) / self.rows_per_noise, 1.0)

    @property
    def signed(self) -> int:
        """Number of terms of either sign."""
        return sum(term in SIGNED_TERMS for term in self.terms)

    def prior_rows(self, columns: int) -> NDArray[np.float64]:
        """Return what is known before as rows of columns and left-hand side, shape (k, columns + 1).

        A thrust is held between samples, as that of a controller, or goes on, as that of a force sensor, and is half a
        sample earlier: the mean of both is known to half of their difference.
        """
        found, half = np.zeros((1, columns + 1)), self.records[0].sample_time / 4
        if "dead_time" not in self.terms:
            return found[:0]
        found[0, self.terms.index("dead_time")] = self.row_std / half
        found[0, -1] = self.row_std * (-half - self.observation.later) / half
        return found

    def moved(self, dead_time: float, row_std: float) -> "FrictionProblem":
        """Return the problem with a thrust that comes later by a dead time [s], and another deviation of rows [N]."""
        assert isinstance(self.observation, ThrustAndMotion)
        later = self.observation.later + dead_time
        return replace(self, observation=replace(self.observation, later=later), row_std=row_std)

    def noise(self, mass: float) -> float:
        """Return the error of a row [N] by noise of the channels."""
        weights, place = self.rows.weights, self.rows.record
        return max(weights.select(place == k).noise(r, max(mass, 0.0)) for k, r in enumerate(self.records))

    @cached_property
    def rows_per_noise(self) -> float:
        """Rows over which white noise is correlated."""
        return self.rows.weights.rows_per_noise()

    @property
    def standstill_time(self) -> float:
        """Standstill time at a reversal of a motion at one speed, plus one sample [s]."""
        found, speed = [], self.speed or 0.0
        for record in self.records:
            turns = turning_points(record.displacement, speed * record.sample_time).size
            slow = int(np.sum(np.abs(record.velocity) < STANDSTILL_SPEED_RATIO * speed))
            found.append((1 + slow / max(turns, 1)) * record.sample_time)
        return max(found)


def speed_quantile(velocity: NDArray[np.float64], share: float) -> float:
    """Return the speed [m/s] below which this part of the travel takes place: dwells at the ends do not count."""
    ordered = np.sort(np.abs(velocity))
    travel = np.cumsum(ordered)
    return float(ordered[np.searchsorted(travel, share * travel[-1])]) if ordered.any() else 1.0


MIN_SLIDING_RATIO = 0.03
"""Slowest over fast sliding."""
MIN_STEPS_PER_SAMPLE = 4.0
"""Quantisation steps per sample in the slowest sliding: with fewer steps its direction is uncertain."""
START_FRACTIONS = 0.0, 1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4
"""Parts of a record between which its start may end; the rest of it is fitted."""
MIN_START_RATIO, MIN_NEXT_RATIO = 4.0, 2.0
"""Residual in a part over that in the rest, root mean squares, from which the start is disturbed, and a next part."""


def slides(records: Sequence[FrictionRecord], presliding_distance: float) -> tuple[NDArray[np.bool_], ...]:
    """Return whether the machine slides at each sample, shape (n,): fast, and far from the last reversal [m]."""
    velocities = [record.velocity for record in records]
    step = quantisation_step(records) / records[0].sample_time
    fast = MIN_SLIDING_RATIO * float(np.percentile(np.abs(np.concatenate(velocities)), 95))
    least = max(fast, MIN_STEPS_PER_SAMPLE * step)
    return tuple(
        (np.abs(v) >= least) & (_travel_since_reversal(record.displacement, v) >= presliding_distance)
        for record, v in zip(records, velocities, strict=True)
    )


def _travel_since_reversal(displacement: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the travel of each sample since the last reversal [m], shape (n,)."""
    turned = np.diff(np.sign(velocity), prepend=np.sign(velocity[0])) != 0
    turned[0] = True  # the motion before is unknown
    last = np.maximum.accumulate(np.where(turned, np.arange(velocity.size), 0))
    return np.abs(displacement - displacement[last])


def disturbed_start(rows: Rows, duration: float) -> tuple[float, list[str]]:
    """Return the beginning of the records [s] that the model of the rest does not explain, and a remark; 0 if none.

    After a jump of the reference, a transient of the drive or of a mode, the beginning differs from the rest. One part
    more is left out than differs clearly, because such a transient decays.
    """
    limits = duration * np.array(START_FRACTIONS)
    columns, force, time = rows.columns, rows.force, rows.time
    rest = time >= limits[-1]
    if rest.sum() < Observation.min_rows:
        return 0.0, []
    scale = np.sqrt(np.mean(columns[rest] ** 2, axis=0))
    residual = force - columns @ (np.linalg.lstsq(columns[rest] / scale, force[rest], ROUNDING)[0] / scale)
    parts = [residual[(time >= low) & (time < high)] for low, high in itertools.pairwise(limits)]
    sizes = np.array([np.sqrt(np.mean(part**2)) if part.size > columns.shape[1] else 0.0 for part in parts])
    error = max(float(np.sqrt(np.mean(residual[rest] ** 2))), np.finfo(float).tiny)
    ratios = np.where(sizes > FORCE_FLOOR * float(np.sqrt(np.mean(force[rest] ** 2))), sizes / error, 0.0)
    if ratios.max() < MIN_START_RATIO:
        return 0.0, []
    last = int(np.flatnonzero(ratios > MIN_NEXT_RATIO)[-1])
    end = float(limits[min(last + 2, limits.size - 1)])
    return end, [
        f"the first {end:.3g} s are left out, because their error is up to {ratios.max():.2g} times that of the rest, "
        "as after a jump of the reference; to choose that time yourself set skip_time in [record] (--skip-time)"
    ]
