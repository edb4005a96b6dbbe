"""How friction shows in a record: sample by sample, behind the inertia of a mass, or in runs at constant velocity."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError
from fraexp_plugins.identification._shared.stop_operator import turning_points
from fraexp_plugins.identification.friction._friction_record import CYCLE_STROKE_RATIO, FrictionRecord

FILTER_HALF_LENGTH_STDS = 4.0
"""Half length of the low-pass filter in its standard deviations."""
HAT_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6
"""Effect of a force that is linear between samples on the second difference of the position."""
NORMAL_MEDIAN, DIFFERENCE_ORDER = 0.6745, 8
"""Median of |x| of a normal distribution of variance 1, and order of the differences that show noise."""
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

    def half_length(self, record: FrictionRecord) -> int:
        """Return how many samples a row contains on either side of its middle."""
        return 0

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
        """Return the filtered second difference of the position, or the measured acceleration."""
        if record.acceleration is not None:
            return self.friction(record, record.acceleration[:, None])
        y = record.displacement
        second = (np.roll(y, -1) - 2 * y + np.roll(y, 1)) / record.sample_time**2
        return self._filter(record, second[:, None])

    def noise(self, record: FrictionRecord, mass: float) -> float:
        """Return what the filter leaves of the noise of thrust and motion."""
        taps, step = self._taps(record), np.array([1.0, -2.0, 1.0]) / record.sample_time**2
        by_force = white_noise(record.force) * np.linalg.norm(taps)
        if record.acceleration is not None:
            return float(np.hypot(by_force, mass * white_noise(record.acceleration) * np.linalg.norm(taps)))
        return float(
            np.hypot(by_force, mass * white_noise(record.displacement) * np.linalg.norm(np.convolve(taps, step)))
        )

    def samples(self, record: FrictionRecord) -> NDArray[np.int64]:
        """Return the samples on which the filter is centred."""
        half_length, step, margin = self._filter_sizes(record)
        return np.arange(margin + half_length, record.displacement.size - margin - half_length, step)

    def half_length(self, record: FrictionRecord) -> int:
        """Return half the length of the filter, which sees the neighbours of its samples."""
        return self._filter_sizes(record).half_length + 1

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
    return float(np.median(np.abs(differences))) / NORMAL_MEDIAN / np.sqrt(comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER))
