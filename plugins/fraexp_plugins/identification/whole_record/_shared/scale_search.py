"""Scales of friction at which a fit begins: those with which the observer's response is that of a free body with modes.

With a wrong friction model the response has what no plant has: a body that seems held at low frequencies, or driven. A
rational function that is k/s² at low frequencies cannot follow that, and its error tells pairs of scales apart in no
time. Only where it is small is a fit to whole records sure to begin in the right basin.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from fraexp.api import Segment, phasors
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification.whole_record._shared.free_parameters import DISPLACEMENT_SCALE, FORCE_SCALE

RANGE, POINTS = 3.0, 29
"""Largest scale of the grid, the least one being its reciprocal, and the points between them."""
ORDERS = (2, 4, 6)
"""Degrees of numerator and denominator: two for each mode."""
ORDER_COST = 0.15
"""Mean logarithm of the error by which two more degrees must be better."""
ITERATIONS = 4
"""Times that the linear fit is repeated with the denominator of the one before as its weight."""
LEAST_ERROR = 1e-3
"""Relative error that counts as none."""
DISTINCT = 0.02
"""Difference of two logarithms from which they are two starts."""
REFINED = 6
"""Points of the grid from which a search refines the scales."""


class ScaleSearch:
    """The observer's response over scales of friction.

    The force is proportional to one scale. Along the other its phasors are interpolated between those of a grid.
    """

    def __init__(self, segments: Sequence[Segment], observer: EffectiveInput, free: Sequence[str]) -> None:
        self.frequency = np.concatenate([segment.frequency for segment in segments])
        self.has_force, self.has_displacement = FORCE_SCALE in free, DISPLACEMENT_SCALE in free
        output = [phasors(segment, observer.output).mean(axis=0) for segment in segments]
        linear = [each.mean(axis=0) for each in observer.linear_phasors(segments)]
        self.output, self.linear = np.concatenate(output), np.concatenate(linear)
        self.grid = np.linspace(-np.log(RANGE), np.log(RANGE), POINTS)
        scales = np.exp(self.grid) if self.has_displacement else np.ones(1)
        forces = [self._forces(segments, observer, float(scale)) for scale in scales]
        self.force_over_scale = CubicSpline(self.grid, forces) if self.has_displacement else lambda _: forces[0]

    def _forces(self, segments: Sequence[Segment], observer: EffectiveInput, scale: float) -> NDArray[np.complex128]:
        moved = observer.model_copy(update={DISPLACEMENT_SCALE: scale, FORCE_SCALE: 1.0})
        pairs = zip(moved.linear_phasors(segments), moved.effective_phasors(segments), strict=True)
        return np.concatenate([(linear - effective).mean(axis=0) for linear, effective in pairs])

    def starts(self) -> list[NDArray[np.float64]]:
        """Return the logarithms of both scales that give the most plausible responses, the best first."""
        forces = self.grid if self.has_force else np.zeros(1)
        displacements = self.grid if self.has_displacement else np.zeros(1)
        costs = [(self.cost(np.array(point)), point) for point in itertools.product(forces, displacements)]
        best = [np.array(point) for _, point in sorted(costs)[:REFINED]]
        is_free = np.array([self.has_force, self.has_displacement])
        refined = sorted((self._search_from(point, is_free) for point in best), key=lambda each: each[0])
        found: list[NDArray[np.float64]] = []
        for _, point in refined:
            if all(np.abs(point - other).max() > DISTINCT for other in found):
                found.append(point)
        return found

    def _search_from(self, point: NDArray[np.float64], is_free: NDArray[np.bool_]) -> tuple[float, NDArray[np.float64]]:
        def cost(values: NDArray[np.float64]) -> float:
            moved = point.copy()
            moved[is_free] = values
            return self.cost(moved)

        step = float(self.grid[1] - self.grid[0]) / 2
        corners = np.vstack([point[is_free], point[is_free] + step * np.eye(int(is_free.sum()))])
        options = {"maxfev": 120, "xatol": 1e-4, "fatol": 1e-3, "initial_simplex": corners}
        found = minimize(cost, point[is_free], method="Nelder-Mead", options=options)
        moved = point.copy()
        moved[is_free] = found.x
        return float(found.fun), moved

    def cost(self, logs: NDArray[np.float64]) -> float:
        """Return the mean logarithm of the error of a rational function, for logarithms of both scales."""
        effective = self.linear - np.exp(logs[0]) * self.force_over_scale(logs[1])
        with np.errstate(all="ignore"):
            response = self.output / effective
        costs = [_rational_error(self.frequency, response, order) + ORDER_COST * order / 2 for order in ORDERS]
        return min(costs)


def _rational_error(frequency: NDArray[np.float64], response: NDArray[np.complex128], order: int) -> float:
    """Return the mean logarithm of the relative error of s²P = N(s)/D(s), of this order each.

    Iteratively reweighted linear least squares (C. K. Sanathanan and J. Koerner, IEEE Trans. Automatic Control 8(1),
    1963).
    """
    s = 1j * frequency / frequency.max()
    known = s**2 * response
    if frequency.size <= order or not np.isfinite(known).all():
        return np.inf
    powers = s[:, None] ** np.arange(order + 1)
    weight = 1 / np.abs(known)
    for _ in range(ITERATIONS):
        columns = np.hstack([powers, -known[:, None] * powers[:, 1:]]) * weight[:, None]
        right = known * weight
        values, *_ = np.linalg.lstsq(
            np.vstack([columns.real, columns.imag]), np.concatenate([right.real, right.imag]), rcond=None
        )
        numerator, denominator = powers @ values[: order + 1], 1 + powers[:, 1:] @ values[order + 1 :]
        weight = 1 / np.abs(known * denominator)
    error = np.abs(numerator / denominator / known - 1)
    return float(np.mean(np.log(np.hypot(error, LEAST_ERROR))))
