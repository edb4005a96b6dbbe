"""The rows of records in which a machine slides, and their least squares, beside an unknown force along the stroke."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Fit
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.identification.friction._friction_record import FrictionRecord
from fraexp_plugins.identification.friction._friction_regression import pseudo_inverse

WAVES = 64
"""Waves of the force along the stroke, the shortest one a sixty-fourth of it."""
PERIOD_RATIO = 1.25
"""Length of the longest wave over the stroke: the force at its ends need not be the same."""
UPDATES, MIN_CHANGE = 60, 1e-3
"""Greatest number of updates of the variances, and the relative change that ends them."""
MIN_VARIANCE_RATIO = 1e-10
"""Least variance of a wave over that of a row, below which the force has no such wave."""


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
    return np.maximum(energy / np.maximum(known, MIN_VARIANCE_RATIO), MIN_VARIANCE_RATIO)


MIN_ROWS = 40
"""Rows needed in each direction."""
START_FRACTIONS = 0.0, 1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4
"""Parts of a record between which its start may end; the rest of it is fitted."""
MIN_START_RATIO, MIN_NEXT_RATIO = 4.0, 2.0
"""Residual in a part over that in the rest, root mean squares, from which the start is disturbed, and a next part."""
MIN_START_ERROR = 1e-3
"""Residual in the start over the thrust, root mean squares, up to which it may be rounding."""
MIN_START_ROWS = 5
"""Rows of a start of which the residual tells something."""


@dataclass(frozen=True)
class SlidingRows:
    """The rows of a record in which the machine slides."""

    columns: NDArray[np.float64]
    """Shape (rows, p)."""
    force: NDArray[np.float64]
    """Shape (rows,) [N]."""
    velocity: NDArray[np.float64]
    """Shape (rows,) [m/s]."""
    time: NDArray[np.float64]
    """Time from the record's begin to the first sample that a row contains [s], shape (rows,)."""
    row: NDArray[np.int64]
    """Number of the row among all rows of the record, shape (rows,)."""

    def select(self, chosen: NDArray[np.bool_]) -> "SlidingRows":
        """Return some of the rows."""
        return replace(self, **{each.name: getattr(self, each.name)[chosen] for each in fields(self)})


class DisturbedStart(NamedTuple):
    """The beginning of the records that is left out."""

    duration: float
    """Its duration [s]."""
    remark: str


def least_squares(
    columns: NDArray[np.float64], force: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the coefficients of the columns, shape (p,), and (AᵀA)⁻¹, shape (p, p)."""
    scale = np.sqrt(np.add.reduce(columns**2, axis=0) / len(columns))
    root = pseudo_inverse(columns / scale)
    return root @ (root.T @ ((columns / scale).T @ force)) / scale, (root @ root.T) / np.outer(scale, scale)


def rows_after(found: Sequence[SlidingRows], time: float) -> list[SlidingRows]:
    """Return the rows that contain no sample before a time [s]."""
    return [each.select(each.time >= time) for each in found]


def disturbed_start(assumptions: Sequence[Sequence[SlidingRows]], duration: float) -> DisturbedStart:
    """Return the beginning of the records that the model of the rest does not explain; 0 s if it explains all.

    After a jump of the reference, a transient of the drive or of a mode, the beginning differs from the rest. The rows
    come once for each of several assumptions on the thrust, of which the one counts that fits better. One part more is
    left out than differs clearly, because such a transient decays.
    """
    limits = duration * np.array(START_FRACTIONS)
    rest, ratios = min((_start_ratios(rows, limits) for rows in assumptions), key=lambda found: found[0])
    if not np.isfinite(rest) or max(ratios) < MIN_START_RATIO:
        return DisturbedStart(0.0, "")
    last = int(np.flatnonzero(np.array(ratios) > MIN_NEXT_RATIO)[-1])
    end = float(limits[min(last + 2, limits.size - 1)])
    return DisturbedStart(
        end,
        f"the first {end:.3g} s are left out, because their error is up to {max(ratios):.2g} times that of the rest, "
        "as after a jump of the reference; to choose that time yourself set skip_time in [record] (--skip-time)",
    )


def _start_ratios(found: Sequence[SlidingRows], limits: NDArray[np.float64]) -> tuple[float, list[float]]:
    """Return the root mean square residual [N] after the last limit [s], and those between the limits over it."""
    rest = rows_after(found, float(limits[-1]))
    columns, force = np.concatenate([f.columns for f in rest]), np.concatenate([f.force for f in rest])
    if min(np.sum(columns[:, 1] > 0), np.sum(columns[:, 1] < 0)) < MIN_ROWS:
        return np.inf, [0.0]
    values, _ = least_squares(columns, force)
    error = _root_mean_square(force - columns @ values)
    time = np.concatenate([f.time for f in found])
    residual = np.concatenate([f.force - f.columns @ values for f in found])
    parts = [residual[(time >= low) & (time < high)] for low, high in itertools.pairwise(limits)]
    sizes = [_root_mean_square(part) if part.size >= MIN_START_ROWS else 0.0 for part in parts]
    least = MIN_START_ERROR * _root_mean_square(force)
    return error, [size / error if size > least and error else 0.0 for size in sizes]


def _root_mean_square(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.add.reduce(values**2) / values.size))


def coulomb_fit(values: NDArray[np.float64], covariance: NDArray[np.float64]) -> Fit:
    """Return Coulomb friction with the second value, a force [N], and the third, a coefficient [N s/m]."""
    model = Coulomb(coulomb_force=float(values[1]), viscous_coefficient=max(float(values[2]), 0.0))
    names, units = ("coulomb_force", "viscous_coefficient"), ("N", "N s/m")
    return Fit("friction", model.spec(), names, units, values[1:3], covariance[1:3, 1:3])
