"""Scales of friction at which a fit begins: those with which the observer's response is that of a free body with modes.

With a wrong friction model the response has what no plant has: a body that seems held at low frequencies, or driven. A
rational function that is k/s² at low frequencies cannot follow that, and its error tells pairs of scales apart in no
time. Only where it is small is a fit to whole records sure to begin in the right basin.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Segment, phasors
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification.whole_record._shared.free_parameters import DISPLACEMENT_SCALE, FORCE_SCALE
from fraexp_plugins.identification.whole_record._shared.observed_start import spread_places

RANGE, POINTS, OBSERVED_POINTS = 3.0, 29, 15
"""Largest scale of the grid, the least one being its reciprocal, its points, and those at which an observer is run."""
ORDERS = (2, 4, 6)
"""Degrees of numerator and denominator: two for each mode."""
ORDER_COST = 0.1
"""Mean logarithm of the error by which two more degrees must be better."""
ITERATIONS = 4
"""Times that the linear fit is repeated with the denominator of the one before as its weight."""
LEAST_ERROR = 1e-3
"""Error over û_e, and over the force that it is a difference of, that counts as none."""
DISTINCT = 0.02
"""Difference of two logarithms from which they are two starts."""
REFINED, FINER_POINTS, FINER_RATIO, FINER_GRIDS = 6, 5, 0.4, 7
"""Points of the grid around which finer grids refine the scales, points of such a grid along a scale, width of one over
that of the one before, and their number."""
RANK_TOLERANCE = 1e-14
"""Diagonal of a triangle, over its greatest number, below which a column counts as one of those before."""
MAX_LINES = 40
"""Lines, spread over all, that are compared."""


class ScaleSearch:
    """The observer's response over scales of friction.

    The force is proportional to one scale. Along the other its phasors are interpolated between those of a grid.
    """

    def __init__(
        self, segments: Sequence[Segment], observer: EffectiveInput, free: Sequence[str], force_range: float = RANGE
    ) -> None:
        segments = _spread_segments(segments)
        self.frequency = np.concatenate([segment.frequency for segment in segments])
        self.has_force, self.has_displacement = FORCE_SCALE in free, DISPLACEMENT_SCALE in free
        from scipy.interpolate import CubicSpline  # slow to import: listing plugins must stay fast

        output = [phasors(segment, observer.output).mean(axis=0) for segment in segments]
        linear = [each.mean(axis=0) for each in observer.linear_phasors(segments)]
        self.output, self.linear = np.concatenate(output), np.concatenate(linear)
        self.grid = np.linspace(-np.log(RANGE), np.log(RANGE), POINTS)
        points = round(POINTS * np.log(force_range) / np.log(RANGE))
        self.force_grid = np.linspace(-np.log(force_range), np.log(force_range), points)
        observed = np.linspace(self.grid[0], self.grid[-1], OBSERVED_POINTS) if self.has_displacement else np.zeros(1)
        forces = [self._forces(segments, observer, float(np.exp(log))) for log in observed]
        self.force_over_scale = CubicSpline(observed, forces) if self.has_displacement else lambda _: forces[0]

    def _forces(self, segments: Sequence[Segment], observer: EffectiveInput, scale: float) -> NDArray[np.complex128]:
        moved = observer.model_copy(update={DISPLACEMENT_SCALE: scale, FORCE_SCALE: 1.0})
        effective = np.concatenate([each.mean(axis=0) for each in moved.effective_phasors(segments)])
        return np.asarray(self.linear - effective)

    def starts(self) -> list[NDArray[np.float64]]:
        """Return the logarithms of both scales that give the most plausible responses, the best first."""
        forces = self.force_grid if self.has_force else np.zeros(1)
        displacements = self.grid if self.has_displacement else np.zeros(1)
        points = _pairs(forces, displacements)
        best = points[np.argsort(self.costs(points), kind="stable")[:REFINED]]
        costs, refined = self._refine(best)
        found: list[NDArray[np.float64]] = []
        for point in refined[np.argsort(costs, kind="stable")]:
            if all(np.abs(point - other).max() > DISTINCT for other in found):
                found.append(point)
        return found

    def _refine(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the least costs on ever finer grids around points, shape (points,), and where they are."""
        width = float(self.grid[1] - self.grid[0])
        side = np.linspace(-1.0, 1.0, FINER_POINTS)
        offsets = _pairs(side if self.has_force else np.zeros(1), side if self.has_displacement else np.zeros(1))
        for _ in range(FINER_GRIDS):
            tried = points[:, None, :] + width * offsets
            costs = self.costs(tried.reshape(-1, 2)).reshape(len(points), -1)
            best = np.argmin(costs, axis=1)
            points, width = tried[np.arange(len(points)), best], FINER_RATIO * width
        return costs.min(axis=1), points

    def costs(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean logarithm of the error of a rational function, for logarithms of both scales, (n, 2)."""
        effective = self.linear - np.exp(logs[:, :1]) * self.force_over_scale(logs[:, 1])
        fits = [_rational_errors(self.frequency, self.output, effective, np.abs(self.linear), n) for n in ORDERS]
        return np.asarray(np.min([cost + ORDER_COST * n / 2 for cost, n in zip(fits, ORDERS, strict=True)], axis=0))


def _spread_segments(segments: Sequence[Segment]) -> list[Segment]:
    """Return segments spread over the frequencies, with about as many lines as are compared."""
    ordered = sorted(segments, key=lambda segment: float(segment.frequency[0]))
    lines = sum(segment.lines.size for segment in segments) / len(segments)
    return [ordered[place] for place in spread_places(len(ordered), max(int(MAX_LINES / lines), 1))]


def _pairs(forces: NDArray[np.float64], displacements: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return all pairs of two values, shape (n, 2)."""
    return np.stack(np.meshgrid(forces, displacements, indexing="ij"), axis=-1).reshape(-1, 2)


def _rational_errors(
    frequency: NDArray[np.float64],
    output: NDArray[np.complex128],
    effective: NDArray[np.complex128],
    force: NDArray[np.float64],
    order: int,
) -> NDArray[np.float64]:
    """Return the mean logarithm of the error of û_e over a force, where s²y/û_e = N(s)/D(s), of this order each.

    `effective` has a row for each û_e, shape (n, lines). Rounding and a wrong friction model falsify û_e by a share of
    the force [N], shape (lines,), not of itself. Iteratively reweighted linear least squares (C. K. Sanathanan and
    J. Koerner, IEEE Trans. Automatic Control 8(1), 1963).
    """
    if frequency.size <= order:
        return np.full(len(effective), np.inf)
    s = 1j * frequency / frequency.max()
    known, powers = s**2 * output / effective, s[:, None] ** np.arange(order + 1)
    allowed = np.hypot(LEAST_ERROR * np.abs(effective), LEAST_ERROR * force)
    weight = relative = np.abs(effective) / (allowed * np.abs(known))
    columns = np.concatenate(
        [np.broadcast_to(powers, (*known.shape, order + 1)), -known[..., None] * powers[:, 1:], known[..., None]],
        axis=2,
    )
    for _ in range(ITERATIONS):
        values = _least_squares(columns * weight[..., None])
        numerator, denominator = values[:, : order + 1] @ powers.T, 1 + values[:, order + 1 :] @ powers[:, 1:].T
        weight = relative / np.abs(denominator)
    error = np.abs((numerator / denominator / known - 1) * effective) / force
    return np.asarray(np.mean(np.log(np.hypot(error, LEAST_ERROR)), axis=1))


def _least_squares(columns: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return real x of least |A x - b|² for each [A, b], shape (n, lines, k + 1): shape (n, k)."""
    triangle = np.asarray(np.linalg.qr(np.concatenate([columns.real, columns.imag], axis=1), mode="r"))
    matrix = triangle[:, :-1, :-1]
    least = RANK_TOLERANCE * np.abs(triangle).max(axis=(1, 2))[:, None]
    diagonal = np.einsum("nii->ni", matrix)
    np.einsum("nii->ni", matrix)[...] = np.where(np.abs(diagonal) < least, least, diagonal)
    return np.asarray(np.linalg.solve(matrix, triangle[:, :-1, -1:]), dtype=float)[..., 0]
