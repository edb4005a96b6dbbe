"""The regression of friction: its rows, constrained least squares, and the covariance of the coefficients."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError
from fraexp_plugins.identification.friction._friction_record import FrictionRecord

FILTER_HALF_LENGTH_STDS = 4.0
"""Half length of the low-pass filter in its standard deviations."""
HAT_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6
"""Effect of a force that is linear between samples on the second difference of the position."""
SIGNED_TERMS = ("offset", "asymmetry")
"""Coefficients of either sign; all others are not negative."""
MIN_SINGULAR_VALUE = 1e-6
"""Singular value, relative to the largest, below which columns are linearly dependent."""
NORMAL_MEDIAN, DIFFERENCE_ORDER = 0.6745, 8
"""Median of |x| of a normal distribution of variance 1, and order of the differences that show noise."""
LAG_WINDOW = 5.0
"""Lags, in correlation times, over which a residual's autocorrelation is summed (A. D. Sokal, 1997)."""


@dataclass(frozen=True)
class Observation:
    """The observation of friction: directly, or as the part of the thrust that does not accelerate the mass.

    The second difference of the position of a mass M obeys M (y₊ - 2y + y₋)/Ts² = the mean of thrust less friction
    over two samples, weighted by a triangle: exactly, for a held thrust and a friction that is linear between samples.
    The same filter acts on both sides, so that the noise of a differentiated encoder signal does not enter.
    """

    inertia: bool
    """Whether the force is a thrust that moves a mass."""
    delay: float = 0.0
    """Delay of the held thrust relative to the position's samples [s]."""
    max_frequency: float = 5.0
    """Frequency up to which both are compared [Hz]."""

    def force(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the left-hand side of the regression [N], shape (rows, 1)."""
        if not self.inertia:
            return record.force[:, None]
        delay = self.delay / record.sample_time
        whole = int(np.floor(delay + 1e-9))
        part = max(delay - whole, 0.0)
        weights = ((1 - part) ** 2 / 2, 0.5 + part - part**2, part**2 / 2)
        shifted = [weight * np.roll(record.force, whole + step) for step, weight in enumerate(weights)]
        return self._filter(record, np.sum(shifted, axis=0)[:, None])

    def friction(self, record: FrictionRecord, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the regression's columns, shape (rows, p), of friction forces, shape (n, p)."""
        if not self.inertia:
            return columns
        before, after = np.roll(columns, 1, axis=0), np.roll(columns, -1, axis=0)
        return self._filter(record, HAT_WEIGHTS[0] * before + HAT_WEIGHTS[1] * columns + HAT_WEIGHTS[2] * after)

    def acceleration(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the column of the mass [m/s²], shape (rows, 1)."""
        if record.acceleration is not None:
            return self.friction(record, record.acceleration[:, None])
        y = record.displacement
        second = (np.roll(y, -1) - 2 * y + np.roll(y, 1)) / record.sample_time**2
        return self._filter(record, second[:, None])

    def noise(self, record: FrictionRecord, mass: float) -> float:
        """Return the standard deviation of a row's force [N] by white noise of the channels."""
        if not self.inertia:
            return white_noise(record.force)
        taps, step = self._taps(record), np.array([1.0, -2.0, 1.0]) / record.sample_time**2
        by_force = white_noise(record.force) * np.linalg.norm(taps)
        if record.acceleration is not None:
            return float(np.hypot(by_force, mass * white_noise(record.acceleration) * np.linalg.norm(taps)))
        return float(
            np.hypot(by_force, mass * white_noise(record.displacement) * np.linalg.norm(np.convolve(taps, step)))
        )

    def _taps(self, record: FrictionRecord) -> NDArray[np.float64]:
        """Return the taps of the Gaussian low-pass, -3 dB at `max_frequency`."""
        half_length = self._filter_sizes(record).half_length
        taps = np.exp(-((np.arange(-half_length, half_length + 1) / self._filter_std(record)) ** 2) / 2)
        return np.asarray(taps / taps.sum())

    def rows(self, record: FrictionRecord, known_from: int) -> NDArray[np.int64]:
        """Return the samples of the rows in which the elements are known, shape (rows,)."""
        samples = np.arange(record.displacement.size)
        if not self.inertia:
            return samples[known_from:]
        half_length, step, margin = self._filter_sizes(record)
        inner = samples[margin + half_length : samples.size - margin - half_length : step]
        return inner[inner >= known_from + half_length]

    def _filter_std(self, record: FrictionRecord) -> float:
        """Return the standard deviation of the low-pass in samples."""
        return np.sqrt(np.log(2)) / (2 * np.pi * self.max_frequency) / record.sample_time

    def _filter_sizes(self, record: FrictionRecord) -> "_FilterSizes":
        """Return the sizes of the low-pass."""
        std = self._filter_std(record)
        delay = int(np.ceil(abs(self.delay) / record.sample_time))
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

    def known_rows(self, record: FrictionRecord, filtered: NDArray[np.float64], known_from: int) -> NDArray[np.float64]:
        """Return the rows in which the elements are known."""
        count = self.rows(record, known_from).size
        return filtered[len(filtered) - count :]


class _FilterSizes(NamedTuple):
    """Sizes of the low-pass in samples."""

    half_length: int
    step: int
    """Distance of the rows."""
    margin: int
    """Samples at the ends of a record that have no neighbours, or no delayed thrust."""


@dataclass(frozen=True)
class RegressionRows:
    """Rows of a regression: columns, left-hand side, and their place in the record."""

    names: tuple[str, ...]
    """Name of each column: those of SIGNED_TERMS first."""
    columns: NDArray[np.float64]
    """Shape (rows, p)."""
    force: NDArray[np.float64]
    """Shape (rows,) [N]."""
    velocity: NDArray[np.float64]
    """Shape (rows,) [m/s]."""
    duration: float
    """Time that a row represents [s]."""
    cycle: NDArray[np.int64]
    """Shape (rows,) of int."""

    @property
    def free(self) -> int:
        """Number of columns whose coefficient may have either sign."""
        return sum(name in SIGNED_TERMS for name in self.names)


def regression_rows(
    record: FrictionRecord,
    observation: Observation,
    terms: Sequence[str],
    elements: NDArray[np.float64],
    known_from: int,
) -> RegressionRows:
    """Return the rows of a record: the terms' columns, then those of the elements, shape (n, N)."""
    velocity = record.velocity()
    plain = {"offset": np.ones_like(velocity), "asymmetry": np.abs(velocity), "viscous": velocity}
    parts = [
        observation.acceleration(record) if term == "mass" else observation.friction(record, plain[term][:, None])
        for term in terms
    ]
    parts.append(observation.friction(record, elements))
    samples = observation.rows(record, known_from)
    step = int(samples[1] - samples[0]) if samples.size > 1 else 1
    return RegressionRows(
        names=(*terms, *(f"element {number}" for number in range(elements.shape[1]))),
        columns=observation.known_rows(record, np.concatenate(parts, axis=1), known_from),
        force=observation.known_rows(record, observation.force(record), known_from)[:, 0],
        velocity=velocity[samples],
        duration=step * record.sample_time,
        cycle=record.cycle[samples],
    )


class CompressedRows:
    """The rows of some cycles, compressed by orthogonal transformations: small, with the same condition number."""

    def __init__(self, rows: Sequence[RegressionRows], cycles: NDArray[np.int64]) -> None:
        self.free = rows[0].free
        parts, self.count = [], 0
        for each in rows:
            chosen = np.isin(each.cycle, cycles)
            self.count += int(chosen.sum())
            parts.append(np.linalg.qr(np.column_stack([each.columns[chosen], each.force[chosen]]), mode="r"))
        self.triangle = np.asarray(np.linalg.qr(np.concatenate(parts), mode="r"))

    def solve(self, used: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the coefficients, shape (p,), of least squared error: those not `used` are 0, those not free ≥ 0.

        Coefficients of either sign come first, so the rows below theirs do not depend on them. C. L. Lawson and
        R. J. Hanson, Solving Least Squares Problems, 1974, ch. 23.
        """
        from scipy.optimize import nnls

        places = np.flatnonzero(used)
        free = int(np.sum(places < self.free))
        scale = np.sqrt(np.add.reduce(self.triangle[:, places] ** 2, axis=0))
        scale[scale == 0] = 1.0
        both = np.column_stack([self.triangle[:, places] / scale, self.triangle[:, -1]])
        small = np.asarray(np.linalg.qr(both, mode="r"))
        try:
            positive, _ = nnls(small[free:, free:-1], small[free:, -1], maxiter=100 * (places.size + 1))
        except RuntimeError:
            raise RecordError(
                "the non-negative least squares did not converge; use fewer thresholds, or a wider range of them"
            ) from None
        either = np.linalg.solve(small[:free, :free], small[:free, -1] - small[:free, free:-1] @ positive)
        found = np.zeros(self.triangle.shape[1] - 1)
        found[places] = np.concatenate([either, positive]) / scale
        return found

    def mean_square(self, coefficients: NDArray[np.float64]) -> float:
        """Return the mean squared error [N²] of these coefficients."""
        error = self.triangle[:, :-1] @ coefficients - self.triangle[:, -1]
        return float(np.add.reduce(error**2)) / max(self.count, 1)

    def inverse(self, used: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return (AᵀA)⁻¹ of the `used` columns, zero elsewhere, shape (p, p)."""
        places = np.flatnonzero(used)
        scale = np.sqrt(np.add.reduce(self.triangle[:, places] ** 2, axis=0))
        scale[scale == 0] = 1.0
        root = pseudo_inverse(self.triangle[:, places] / scale) / scale[:, None]
        full = np.zeros((len(used), len(used)))
        full[np.ix_(places, places)] = root @ root.T
        return full


def pseudo_inverse(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a root of (AᵀA)⁻¹, shape (p, p), without directions in which columns are linearly dependent."""
    return np.asarray(np.linalg.pinv(np.asarray(np.linalg.qr(columns, mode="r")), rcond=MIN_SINGULAR_VALUE))


def long_run_variance(residuals: Sequence[NDArray[np.float64]], parameters: float) -> float:
    """Return the variance of the residuals [N²] times their correlation time in samples, for slowly varying columns."""
    count = sum(each.size for each in residuals)
    squared = sum(float(np.add.reduce(each**2)) for each in residuals)
    if not squared:
        return 0.0
    size = 2 * max(each.size for each in residuals)
    total = np.zeros(size // 2)
    for each in residuals:
        correlation = np.fft.irfft(np.abs(np.fft.rfft(each, size)) ** 2, size)[: each.size]
        total[: each.size] += correlation
    time = 2 * np.cumsum(total / squared) - 1
    enough = np.flatnonzero(np.arange(time.size) >= LAG_WINDOW * time)
    return squared / max(count - parameters, 1) * max(float(time[enough[0]]) if enough.size else 1.0, 1.0)


def misfit_variance(count: int, parameters: int, error: float) -> float:
    """Return the variance [N²] of `count` rows whose root mean square `error` [N] is an error of the model.

    Such an error does not average out: as much of it may be in the parameters as in the residuals, so that the rows
    count as one for each parameter.
    """
    return error**2 * count / max(parameters, 1)


def white_noise(values: NDArray[np.float64]) -> float:
    """Return an upper bound of the standard deviation of white noise on a smooth signal, by high-order differences."""
    differences = np.diff(values, DIFFERENCE_ORDER)
    if not differences.size:
        return 0.0
    return float(np.median(np.abs(differences))) / NORMAL_MEDIAN / np.sqrt(comb(2 * DIFFERENCE_ORDER, DIFFERENCE_ORDER))
