"""What an observer shows of plant and friction before a fit: the plant's response, and plausible scales of friction."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, RecordError, Segment, Signals, phasors
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.realisations import Part, circular_covariance, combine_parts
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification.plant.modal_fit import ModalFit
from fraexp_plugins.identification.whole_record._free_parameters import DISPLACEMENT_SCALE, FORCE_SCALE
from fraexp_plugins.plants.modal import Modal

PLANT_MODEL_ERROR = 1e-3
"""Relative error of the plant model that a fit allows for."""
MAX_FRICTION_RATIO, MIN_POINTS = 3.0, 8
"""Friction over effective input up to which a response is taken for the plant's, if that leaves as many points."""
MAX_RESPONSE_ERROR = 0.5
"""Relative error by friction up to which it is otherwise."""


@dataclass(frozen=True)
class ObservedStart:
    """What the observer finds with one friction model."""

    effective: tuple[NDArray[np.complex128], ...]
    """Effective input of each segment [N], mean over periods, shape (lines,) each."""
    friction: tuple[NDArray[np.complex128], ...]
    """Friction force likewise [N]."""

    @classmethod
    def of(cls, observer: EffectiveInput, signals: Signals) -> "ObservedStart":
        """Return what an observer finds along signals."""
        effective = tuple(each.mean(axis=0) for each in observer.effective_phasors(signals.segments))
        friction = tuple(each.mean(axis=0) for each in observer.friction_phasors(signals.segments))
        return cls(effective, friction)

    @property
    def friction_ratios(self) -> NDArray[np.float64]:
        """Friction force over effective input at all lines, shape (n,)."""
        return np.abs(np.concatenate(self.friction)) / np.maximum(np.abs(np.concatenate(self.effective)), 1e-300)

    def plant(
        self,
        signals: Signals,
        observer: EffectiveInput,
        modes: int | None,
        friction_error: float,
        has_dead_time: bool = False,
    ) -> tuple[Modal, float]:
        """Return the modal plant in the observer's response, if friction may be wrong by this share, and a dead time.

        Where the response supports no modes it is a rigid body. The dead time [s] is 0 unless it may have one.
        """
        found = self._response(signals, observer)
        error = friction_error * self.friction_ratios
        covariance = circular_covariance(np.abs(found.response) ** 2 * (error**2 + PLANT_MODEL_ERROR**2))
        settled = found.settled & (self.friction_ratios < MAX_FRICTION_RATIO)
        if settled.sum() < MIN_POINTS:
            settled = found.settled & (error < MAX_RESPONSE_ERROR)
        if settled.sum() < 2:
            settled = found.settled
        return plant_in(replace(found, covariance=covariance, settled=settled), modes, has_dead_time)

    def _response(self, signals: Signals, observer: EffectiveInput) -> FrequencyResponse:
        """Return y'/û_e, each segment for itself: their amplitudes may differ."""
        parts = []
        for segment, effective in zip(signals.segments, self.effective, strict=True):
            output = phasors(segment, observer.output).mean(axis=0)
            unknown = np.full((output.size, 2, 2), np.nan)
            amplitudes = np.abs(effective), np.abs(output)
            parts.append(Part((segment,), segment.frequency, output / effective, unknown, np.inf, *amplitudes))
        units = signals.unit(observer.input), signals.unit(observer.output)
        found = combine_parts(signals, parts, names=(EFFECTIVE_INPUT, observer.output), units=units)
        assert found.response is not None
        return found.response


def plant_in(response: FrequencyResponse, modes: int | None, has_dead_time: bool) -> tuple[Modal, float]:
    """Return the modal plant in a response with a band, and its dead time [s]; where it supports none, a rigid body."""
    dead_time = None if has_dead_time else 0.0
    modal = ModalFit(method=Conventional(), modes=modes, dead_time=dead_time, model_error=PLANT_MODEL_ERROR)
    try:
        with np.errstate(all="ignore"):  # of a wrong friction model
            (fit,) = modal.fit_response(response).fits
    except RecordError:
        gains = np.abs(response.response) * (2 * np.pi * response.frequency) ** 2
        return Modal(rigid_body_gain=float(np.median(gains[response.settled]))), 0.0
    spec = {key: value for key, value in fit.component.items() if key not in ("name", "version")}
    return Modal.parse(spec, "plant"), float(fit.values[fit.parameters.index("dead_time")])


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
    count = min(max(int(MAX_LINES / lines), 1), len(ordered))
    return [ordered[place] for place in sorted({round(place) for place in np.linspace(0, len(ordered) - 1, count)})]


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
