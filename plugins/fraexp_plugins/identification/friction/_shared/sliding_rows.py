"""The rows of records in which a machine slides, their least squares, and a start of the records that disagrees."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.friction._shared.friction_regression import pseudo_inverse

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
