"""Least squares of rows: constrained, compressed, beside an unknown force along the stroke, and their covariance."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ROUNDING
from fraexp_plugins.identification._shared.least_squares import solve_non_negative
from fraexp_plugins.identification.friction._friction_rows import FrictionRecord, Rows

LAG_WINDOW = 5.0
"""Lags, in correlation times, over which a residual's autocorrelation is summed (A. D. Sokal, 1997)."""


class CompressedRows:
    """The rows of some cycles, compressed by orthogonal transformations: small, with the same condition number."""

    def __init__(self, rows: Sequence[Rows], free: int, cycles: NDArray[np.int64]) -> None:
        self.free = free
        parts, self.count = [], 0
        for each in rows:
            chosen = np.isin(each.cycle, cycles)
            self.count += int(chosen.sum())
            parts.append(np.linalg.qr(np.column_stack([each.columns[chosen], each.force[chosen]]), mode="r"))
        self.triangle = np.asarray(np.linalg.qr(np.concatenate(parts), mode="r"))
        self.size = self.triangle.shape[1] - 1

    def solve(self, used: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the coefficients, shape (p,), of least squared error: those not `used` are 0, those not free ≥ 0."""
        found, free = np.zeros(self.size), int(np.sum(used[: self.free]))
        found[used] = solve_non_negative(self.triangle[:, :-1][:, used], self.triangle[:, -1], free)
        return found

    def mean_square(self, coefficients: NDArray[np.float64]) -> float:
        """Return the mean squared error [N²] of these coefficients."""
        error = self.triangle[:, :-1] @ coefficients - self.triangle[:, -1]
        return float(np.add.reduce(error**2)) / max(self.count, 1)


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


WAVES = 64
"""Waves of the force along the stroke, the shortest one a sixty-fourth of it."""
PERIOD_RATIO = 1.25
"""Length of the longest wave over the stroke: the force at its ends need not be the same."""
UPDATES, MIN_CHANGE = 60, 1e-3
"""Greatest number of updates of the variances, and the relative change that ends them."""


class Regression(NamedTuple):
    """The solution of a regression beside an unknown force along the stroke."""

    values: NDArray[np.float64]
    """Coefficients of the columns, shape (p,)."""
    inverse: NDArray[np.float64]
    """Their covariance over the variance of a row, shape (p, p)."""
    force: NDArray[np.float64]
    """The unknown force in each row [N], shape (rows,)."""
    waves: float
    """Number of waves that the rows determine."""


@dataclass(frozen=True)
class Waves:
    """Sines and cosines along the stroke: alike in both directions of the motion, and with its sign."""

    first: float
    """Least position [m]."""
    length: float
    """Length of the longest wave [m]."""

    @classmethod
    def along(cls, records: Sequence[FrictionRecord]) -> "Waves":
        """Return the waves for the stroke of all records."""
        positions = np.concatenate([record.displacement for record in records])
        return cls(float(positions.min()), PERIOD_RATIO * float(np.ptp(positions)))

    def columns(self, record: FrictionRecord) -> Iterator[NDArray[np.float64]]:
        """Yield the waves along a record one by one, each of shape (n,): all of a long record are too much at once."""
        phase = 2 * np.pi * (record.displacement - self.first) / self.length
        for sign in (np.ones_like(phase), np.sign(record.velocity())):
            for function in (np.cos, np.sin):
                for number in range(1, WAVES + 1):
                    yield sign * function(number * phase)

    @staticmethod
    def octaves() -> NDArray[np.int64]:
        """Return the number of the octave of each column, shape (4 WAVES,): each has a variance of its own."""
        octave = np.floor(np.log2(np.arange(1, WAVES + 1))).astype(np.int64)
        both = np.concatenate([octave, octave])
        return np.concatenate([both, both + 1 + int(octave.max())])


def regress(
    columns: NDArray[np.float64], waves: NDArray[np.float64], force: NDArray[np.float64], independent: float
) -> Regression:
    """Return the coefficients of the columns by generalised least squares beside random waves.

    Each octave of waves has a variance, which is that of the greatest likelihood of the rows (type II: D. J. C. MacKay,
    Neural Computation 4(3), 1992, doi:10.1162/neco.1992.4.3.415; M. E. Tipping, J. Machine Learning Research 1, 2001).
    What the motion does not separate from the terms, such as a force along a stroke that is always accelerated alike,
    stays in their covariance. `independent` is the part of the rows that is independent of each other.
    """
    octaves = Waves.octaves()
    scale = np.sqrt(np.add.reduce(columns**2, axis=0) / len(columns))
    table = np.sqrt(independent) * np.column_stack([waves, columns / scale, force])
    triangle = np.asarray(np.linalg.qr(table, mode="r"))
    count = independent * len(force)
    ratio = np.full(octaves.max() + 1, 1.0 / octaves.size)
    for _ in range(UPDATES):
        solution = _solve(triangle, ratio[octaves], columns.shape[1], count)
        updated = _updated(solution, ratio, octaves)
        change = np.max(np.abs(np.log(updated / ratio)))
        ratio = updated
        if change < MIN_CHANGE:
            break
    # all of an octave may be in one of its waves: of the waves that the motion hardly separates from the terms the
    # variance decides, so it is that of such a wave
    ratio = ratio * np.bincount(octaves)
    solution = _solve(triangle, ratio[octaves], columns.shape[1], count)
    return Regression(
        solution.terms / scale,
        independent * solution.inverse / np.outer(scale, scale),
        waves @ solution.amplitudes,
        float(np.sum(1 - solution.spread)),
    )


class _Solution(NamedTuple):
    terms: NDArray[np.float64]
    inverse: NDArray[np.float64]
    """Covariance of the terms over the variance of a row, shape (p, p)."""
    amplitudes: NDArray[np.float64]
    """Amplitudes of the waves [N], shape (q,)."""
    spread: NDArray[np.float64]
    """Their variances after the rows are known, over their variances before, shape (q,)."""
    variance: float
    """Of a row [N²]."""


def _solve(triangle: NDArray[np.float64], ratio: NDArray[np.float64], terms: int, count: float) -> _Solution:
    """Return the solution for waves whose variances are `ratio` times that of a row.

    The waves count as rows of their own, which say that their amplitudes are 0 with a standard deviation of 1.
    """
    size = ratio.size
    scaled = triangle.copy()
    scaled[:, :size] *= np.sqrt(ratio)
    prior = np.eye(size, scaled.shape[1])
    root = np.asarray(np.linalg.qr(np.concatenate([scaled, prior]), mode="r"))
    variance = max(float(root[-1, -1] ** 2) / max(count - terms, 1.0), np.finfo(float).tiny)
    inverse = np.linalg.inv(root[:-1, :-1])
    values = inverse @ root[:-1, -1]
    block = inverse[size:]
    return _Solution(
        values[size:],
        block @ block.T,
        np.sqrt(ratio) * values[:size],
        np.add.reduce(inverse[:size] ** 2, axis=1),
        variance,
    )


def _updated(solution: _Solution, ratio: NDArray[np.float64], octaves: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the next variances of the octaves over that of a row: energy of their waves over how many are known."""
    energy = np.bincount(octaves, solution.amplitudes**2) / solution.variance
    known = np.bincount(octaves, 1 - solution.spread)
    return np.maximum(energy / np.maximum(known, ROUNDING), ROUNDING)


def least_squares(columns: NDArray[np.float64], force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients of the columns, shape (p,)."""
    scale = np.sqrt(np.add.reduce(columns**2, axis=0) / len(columns))
    return np.asarray(np.linalg.lstsq(columns / scale, force, ROUNDING)[0] / scale)
