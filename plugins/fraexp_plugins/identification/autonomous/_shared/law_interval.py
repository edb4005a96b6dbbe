"""How far the records determine the sizes and shape of a friction law, and its Coulomb force beside what they hide."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.autonomous._shared.force_interval import sum_interval
from fraexp_plugins.identification.autonomous._shared.law_elements import (
    MIN_STATIC_EXCESS,
    LawElements,
    RollingElements,
    WeakeningElements,
)
from fraexp_plugins.identification.autonomous._shared.law_records import LawRecords

ALTERNATIVE_VELOCITIES, ALTERNATIVE_RATES_S, ALTERNATIVE_EXCESS = (0.1, 0.4, 1.0), (12.0, 60.0), 0.05
"""Stribeck velocities over the largest velocity, rates of attraction over the Coulomb force, and static over Coulomb
force less 1, of a Stribeck effect beside a law, by which its Coulomb force is judged."""
INTERVAL_STDS = 3.0
"""Standard deviations of an interval: the elements that weaken are not the law's own, and errors of a law are not
independent."""
INCOMPLETE_RATIO = 2.0
"""Factor on the change of the Coulomb force where a Stribeck effect beside a law explains more of the records."""
LUMPS, RIDGE = 6, 1e-10
"""Number of elements that weaken beside a law, and ridge of normal equations."""
MIN_EXCESS = 1.0
"""Least mean square of the residuals that a covariance is computed with."""
SHAPE_DIFFERENCE = 1e-3
"""Difference of a logarithm for derivatives."""


class LawUncertainty(NamedTuple):
    """What the records leave open of a law."""

    covariance: NDArray[np.float64]
    """Covariance of the shape and then of the sizes, shape (S + N, S + N)."""
    interval: tuple[float, float]
    """Least and greatest Coulomb force [N]."""
    is_complete: bool
    """Whether a Stribeck effect beside the law explains no more of the records."""


def law_uncertainty(elements: LawElements, dead_time: float, records: LawRecords) -> LawUncertainty:
    """Return how far the records determine a law with this dead time [s].

    The interval is the profile likelihood of the Coulomb force. Beside the law's own sizes and shape a Stribeck effect
    that the law lacks is free too, at several velocities and lags: it can only weaken friction in sliding. Its scale is
    what the law leaves of the records, rather than what is allowed for.
    """
    deflection = records.deflection(elements)
    sizes, residual, problem = records.solve(deflection, dead_time)
    square = float(np.sum(residual**2)) / records.equations
    shapes = _shape_columns(elements, deflection, sizes, dead_time, records)
    weakening = _weakening_columns(elements, sizes, dead_time, records)
    kept = np.flatnonzero(sizes > 0)
    places = np.concatenate([np.arange(shapes.shape[1]), elements.shape.size + kept])
    covariance = np.zeros((elements.shape.size + sizes.size,) * 2)
    jacobian = np.concatenate([shapes, problem.matrix[:, kept]], axis=1)
    covariance[np.ix_(places, places)] = max(square, MIN_EXCESS) * _inverse_normal(jacobian)
    matrix = np.concatenate([problem.matrix, weakening, shapes, -shapes], axis=1)
    chosen = np.arange(matrix.shape[1]) < sizes.size
    chosen[: sizes.size] &= elements.is_coulomb
    low, high = sum_interval(matrix, problem.target, chosen, INTERVAL_STDS**2 * square)
    found = float(sizes[elements.is_coulomb].sum())
    is_complete = low <= found <= high
    if not is_complete:  # what the few elements show of the effect is a part of it
        low, high = found + INCOMPLETE_RATIO * (low - found), found + INCOMPLETE_RATIO * (high - found)
    return LawUncertainty(covariance, (min(low, found), max(high, found)), is_complete)


def _shape_columns(
    elements: LawElements,
    deflection: NDArray[np.complex128],
    sizes: NDArray[np.float64],
    dead_time: float,
    records: LawRecords,
) -> NDArray[np.float64]:
    """Return the derivative of the weighted forces by the shape, shape (equations, S); a linear law has none."""
    columns = [np.empty((2 * (records.lines.known.size + records.free_lines.size), 0))]
    for place in range(0 if isinstance(elements, RollingElements) else elements.shape.size):
        moved = elements.shape + SHAPE_DIFFERENCE * (np.arange(elements.shape.size) == place)
        change = (records.deflection(replace(elements, shape=moved)) - deflection) @ sizes / SHAPE_DIFFERENCE
        columns.append(records.solve(change[..., None], dead_time).problem.matrix)
    return np.concatenate(columns, axis=1)


def _weakening_columns(
    elements: LawElements, sizes: NDArray[np.float64], dead_time: float, records: LawRecords
) -> NDArray[np.float64]:
    """Return how the weighted forces change with Stribeck effects that a law lacks, a column for each.

    It is that of a few elements along the law's virgin curve (generalized Maxwell slip), per unit of excess.
    """
    velocity = float((2 * np.pi * records.lines.frequency[:, None] * np.abs(records.lines.motion)).max())
    thresholds, forces = _lumped(elements, sizes)
    columns = []
    for part in ALTERNATIVE_VELOCITIES:
        for rate in ALTERNATIVE_RATES_S:
            few = [
                WeakeningElements(np.log([excess, part * velocity, rate]), thresholds)
                for excess in (ALTERNATIVE_EXCESS, MIN_STATIC_EXCESS * ALTERNATIVE_EXCESS)
            ]
            changed, plain = (records.deflection(each) @ forces for each in few)
            change = (changed - plain) / ALTERNATIVE_EXCESS
            columns.append(records.solve(change[..., None], dead_time).problem.matrix)
    return np.concatenate(columns, axis=1)


def _lumped(elements: LawElements, sizes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return thresholds [m] and forces [N] of a few elements with the law's virgin curve."""
    x, coulomb = np.geomspace(1e-9, 1e-1, 400), float(sizes[elements.is_coulomb].sum())
    force = np.maximum.accumulate(elements.virgin_columns(x) @ sizes)
    levels = (np.arange(LUMPS) + 0.5) / LUMPS * force[-1]
    return np.interp(levels, force + 1e-12 * force[-1] * np.arange(x.size), x), np.full(LUMPS, coulomb / LUMPS)


def _inverse_normal(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of AᵀA, with a small ridge where it has none."""
    scale = np.linalg.norm(matrix, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    scaled = matrix / scale
    return np.asarray(np.linalg.inv(scaled.T @ scaled + RIDGE * np.eye(scale.size)) / np.outer(scale, scale))
