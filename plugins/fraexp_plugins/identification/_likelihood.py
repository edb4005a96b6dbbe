"""A linearised fit of several records at once: parameters that all share, and those of each record alone."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import COARSE_DIFFERENCE, CONVERGED, MAX_ITERATIONS, ROUNDING, SIGNIFICANCE, Signals

MODEL_ERROR = 0.3
"""Standard deviation of the error of a right model, over noise and rounding: it adds 4 % to a residual. Replays have
some, and thousands of samples show it. Half of it changes no verdict of the fits that `_record_fit` names."""


def greatest_ratio(freedom: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return the root mean square of a residual, over its expectation, that chance hardly exceeds: a χ² test.

    `freedom` are the degrees of freedom, of any shape.
    """
    from scipy.special import chdtri  # slow to import: listing plugins must stay fast

    return np.asarray(np.sqrt((1 + MODEL_ERROR**2) * chdtri(freedom, SIGNIFICANCE) / freedom))


def greatest_chance_gain(added: int, freedom: float) -> float:
    """Return the mean square without further parameters over that with them which chance hardly exceeds: an F test."""
    from scipy.special import fdtri  # slow to import: listing plugins must stay fast

    return float(1 + added / freedom * fdtri(added, freedom, 1 - SIGNIFICANCE))


LOG_NORMAL_PEAK = 0.5 * np.log(2 * np.pi)


class Loss(NamedTuple):
    """The negative logarithm of the likelihood of each sample, with its derivatives by the residual."""

    value: NDArray[np.float64]
    """Shape (n,)."""
    slope: NDArray[np.float64]
    """[1/m], shape (n,)."""
    curvature: NDArray[np.float64]
    """[1/m²], shape (n,)."""


def interval_loss(residual: NDArray[np.float64], resolution: float, std: NDArray[np.float64] | float) -> Loss:
    """Return the loss of samples that were rounded to steps of `resolution` [m] after noise of `std` [m].

    `residual` is the rounded sample less the position [m], shape (n,); `std` is one for all, or of that shape. The
    likelihood of a sample is Φ((r + q/2)/σ) - Φ((r - q/2)/σ): that of Gaussian noise for q = 0, a box for σ = 0. It is
    log-concave.
    """
    if not resolution:
        scaled = residual / std
        return Loss(0.5 * scaled**2, scaled / std, np.broadcast_to(1 / std**2, residual.shape))
    # Both ends on the left tail, where Φ and its logarithm are exact.
    upper = (-np.abs(residual) + resolution / 2) / std
    lower = (-np.abs(residual) - resolution / 2) / std
    log_probability = _log_difference(upper, lower)
    at_upper = np.exp(-0.5 * upper**2 - LOG_NORMAL_PEAK - log_probability)
    at_lower = np.exp(-0.5 * lower**2 - LOG_NORMAL_PEAK - log_probability)
    rise = at_upper - at_lower
    curvature = rise**2 + upper * at_upper - lower * at_lower
    return Loss(-log_probability, np.sign(residual) * rise / std, np.maximum(curvature, ROUNDING) / std**2)


def _log_difference(upper: NDArray[np.float64], lower: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ln(Φ(upper) - Φ(lower)); logarithms of Φ take several times as long, and are needed far out only."""
    from scipy.special import log_ndtr, ndtr  # slow to import: listing plugins must stay fast

    probability = ndtr(upper) - ndtr(lower)
    far = probability < np.finfo(float).tiny
    found = np.log(np.where(far, 1.0, probability))
    if far.any():
        log_upper, log_lower = log_ndtr(upper[far]), log_ndtr(lower[far])
        found[far] = log_upper + np.log1p(-np.exp(np.minimum(log_lower - log_upper, -1e-300)))
    return np.asarray(found)


class LinearRecord(NamedTuple):
    """One record, linearised in its parameters."""

    residual: NDArray[np.float64]
    """Record less the model's position [m], shape (n,)."""
    jacobian: NDArray[np.float64]
    """Derivatives of the position by the shared parameters, then by the record's own ones, shape (n, p + m)."""
    resolution: float
    """Rounding step [m]."""
    std: float
    """Standard deviation of its noise [m]."""


class FitStep(NamedTuple):
    """Changes of the parameters, and what the linearised records tell of them."""

    shared: NDArray[np.float64]
    """Change of the shared parameters, shape (p,)."""
    own: tuple[NDArray[np.float64], ...]
    """Change of each record's own ones, shape (m,) each."""
    gain: float
    """Log-likelihood that the linearised records gain."""
    held: NDArray[np.float64]
    """Information with which the shared parameters are held, shape (p,)."""
    curvature: NDArray[np.float64]
    """Curvature of each record's loss where the step ends, shape (records, p + M, p + M)."""

    @property
    def covariances(self) -> tuple[NDArray[np.float64], ...]:
        """Inverse of the information about shared parameters, then those of one record, shape (p + m, p + m) each."""
        mixed, information = _eliminated(self.curvature, self.shared.size)
        shared = _inverse(information + np.diag(self.held))
        cross = -mixed @ shared
        return self._assembled(shared, cross, self._alone - cross @ mixed.transpose(0, 2, 1))

    def covariances_beside(
        self, shared: NDArray[np.float64], weights: NDArray[np.float64], added: Sequence[int]
    ) -> tuple[NDArray[np.float64], ...]:
        """Return the same where shared parameters are held as an efficient fit to the same records has them.

        `shared` is their covariance, shape (p, p), `weights` the weight of each record there over that here, and
        `added` says how many of its own parameters, the first ones, that fit did not have. What a record tells against
        an efficient estimate is independent of it (J. A. Hausman, Econometrica 46(6), 1978), so that these parameters
        are known better than beside an estimate from other records.
        """
        p, (mixed, _) = len(shared), _eliminated(self.curvature, len(shared))
        common = np.empty_like(mixed)
        for place, (curvature, weight, count) in enumerate(zip(self.curvature, weights, added, strict=True)):
            own, to_shared = curvature[p:, p:], curvature[p:, :p]
            beside = to_shared - own[:, count:] @ _solution(own[count:, count:], to_shared[count:])
            common[place] = weight * _solution(own, beside) @ shared
        cross = common - mixed @ shared
        of_own = self._alone - cross @ mixed.transpose(0, 2, 1) - mixed @ common.transpose(0, 2, 1)
        return self._assembled(shared, cross, of_own)

    @property
    def _alone(self) -> NDArray[np.float64]:
        """Covariance of each record's own parameters beside known shared ones, shape (records, M, M)."""
        p = self.shared.size
        return _inverse(self.curvature[:, p:, p:])

    def _assembled(
        self, shared: NDArray[np.float64], cross: NDArray[np.float64], of_own: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], ...]:
        ends = [self.shared.size + own.size for own in self.own]
        found = [np.block([[shared, a.T], [a, b]]) for a, b in zip(cross, of_own, strict=True)]
        return tuple(each[:end, :end] for each, end in zip(found, ends, strict=True))


def fit_linear(
    records: Sequence[LinearRecord],
    shared_radius: NDArray[np.float64],
    own_radius: Sequence[NDArray[np.float64]],
    held: NDArray[np.float64] | None = None,
) -> FitStep:
    """Return the step that minimises the loss of all records, within about these radii.

    The change of the shared parameters is `held`, if it is given. Newton's method on a convex function. The parameters
    of different records meet in the shared ones alone, so that each record's own ones are eliminated before the shared
    ones are solved for: no general solver knows that.
    """
    problem = _Problem.of(records, shared_radius, own_radius, held is None)
    before = problem.at(np.zeros(shared_radius.size), np.zeros(problem.own_hold.shape))
    point = before if held is None else problem.at(held, before.own)
    for _ in range(MAX_ITERATIONS):
        step, own_steps, slope = problem.newton_step(point)
        for length in 2.0 ** -np.arange(MAX_ITERATIONS):
            tried = problem.at(point.shared + length * step, point.own + length * own_steps)
            if tried.loss <= point.loss:
                break
        point = tried
        if -slope <= CONVERGED:
            break
    own = tuple(values[: radius.size] for values, radius in zip(point.own, own_radius, strict=True))
    return FitStep(point.shared, own, before.loss - point.loss, problem.hold, problem.derivatives(point)[1])


class _Point(NamedTuple):
    """Values of all parameters, and what the records are there."""

    shared: NDArray[np.float64]
    own: NDArray[np.float64]
    """Shape (records, M)."""
    losses: Loss
    """Loss of the samples of all records, with its derivatives by them."""
    loss: float
    """Loss of all records and of what holds the parameters."""


class _Problem(NamedTuple):
    """Linearised records, and what holds their parameters: as many own ones of each, of which some have no effect."""

    residual: NDArray[np.float64]
    """Those of all records, shape (n,)."""
    jacobians: list[NDArray[np.float64]]
    resolution: float
    stds: NDArray[np.float64]
    """Shape (n,)."""
    hold: NDArray[np.float64]
    """Information with which the shared parameters are held, shape (p,)."""
    own_hold: NDArray[np.float64]
    """The same of the own ones, shape (records, M)."""
    is_shared_free: bool

    @classmethod
    def of(
        cls,
        records: Sequence[LinearRecord],
        shared_radius: NDArray[np.float64],
        own_radius: Sequence[NDArray[np.float64]],
        is_shared_free: bool,
    ) -> "_Problem":
        most = max(radius.size for radius in own_radius)
        columns = shared_radius.size + most
        jacobians = [np.pad(r.jacobian, ((0, 0), (0, columns - r.jacobian.shape[1]))) for r in records]
        radii = np.array([np.pad(radius, (0, most - radius.size), constant_values=1.0) for radius in own_radius])
        stds = np.repeat([record.std for record in records], [record.residual.size for record in records])
        residual = np.concatenate([record.residual for record in records])
        return cls(residual, jacobians, records[0].resolution, stds, shared_radius**-2.0, radii**-2, is_shared_free)

    def at(self, shared: NDArray[np.float64], own: NDArray[np.float64]) -> _Point:
        moved = [j @ np.concatenate([shared, values]) for j, values in zip(self.jacobians, own, strict=True)]
        losses = interval_loss(self.residual - np.concatenate(moved), self.resolution, self.stds)
        held = float(np.sum(shared**2 * self.hold) + np.sum(own**2 * self.own_hold))
        return _Point(shared, own, losses, float(losses.value.sum()) + 0.5 * held)

    def derivatives(self, point: _Point) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return gradient, shape (records, p + M), and curvature of each record's loss and of what holds its own."""
        ends = np.cumsum([len(jacobian) for jacobian in self.jacobians])[:-1]
        slopes, curvatures = np.split(point.losses.slope, ends), np.split(point.losses.curvature, ends)
        gradient = -np.array([j.T @ slope for j, slope in zip(self.jacobians, slopes, strict=True)])
        curvature = np.array([(j.T * each) @ j for j, each in zip(self.jacobians, curvatures, strict=True)])
        gradient[:, self.hold.size :] += self.own_hold * point.own
        np.einsum("rii->ri", curvature)[:, self.hold.size :] += self.own_hold
        return gradient, curvature

    def newton_step(self, point: _Point) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return the step of shared and own parameters, and the slope of the loss along it."""
        p, (gradient, curvature) = self.hold.size, self.derivatives(point)
        mixed, information = _eliminated(curvature, p)
        of_shared, of_own = gradient[:, :p].sum(axis=0) + self.hold * point.shared, gradient[:, p:]
        right, step = of_shared - np.einsum("rmp,rm->p", mixed, of_own), np.zeros(p)
        if p and self.is_shared_free:
            step = -_solution(information + np.diag(self.hold), right)
        own_steps = -_solution(curvature[:, p:, p:], (of_own + curvature[:, p:, :p] @ step)[..., None])[..., 0]
        return step, own_steps, float(of_shared @ step + np.sum(of_own * own_steps))


def _eliminated(curvature: NDArray[np.float64], shared: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how own parameters move with shared ones, shape (records, M, p), and the information on those, (p, p)."""
    mixed = _solution(curvature[:, shared:, shared:], curvature[:, shared:, :shared])
    return mixed, (curvature[:, :shared, :shared] - curvature[:, :shared, shared:] @ mixed).sum(axis=0)


def _solution(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.solve(matrix, right), dtype=float)


def _inverse(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.inv(matrix), dtype=float)


MIN_SAMPLES = 64
"""Samples of a period from which its upper half of the spectrum has no harmonics of friction to speak of: the 17th of
a sine has some 1e-3 of the first."""
NOISE_RANGE = (3e-3, 3.0)
"""Noise that is looked for over the residual: rounding makes a residual without noise, and less than its least hardly
changes a likelihood."""


def noise_in_records(signals: Signals, output: str, resolution: float) -> float:
    """Return the standard deviation of the noise [m] besides rounding.

    It is that of the scatter over the periods; of single periods, that of the upper half of their spectrum.
    """
    known = [each for each in (_variance(segment.channels[output]) for segment in signals.segments) if each is not None]
    return float(np.sqrt(max(np.median(known) - resolution**2 / 12, 0.0))) if known else 0.0


def _variance(periods: NDArray[np.float64]) -> float | None:
    """Return the mean variance over the periods, shape (periods, n), or that of white noise in one; None if unknown."""
    if len(periods) > 1:
        return float(np.mean(np.var(periods - periods.mean(axis=1, keepdims=True), axis=0, ddof=1)))
    size = periods.shape[1]
    if size < MIN_SAMPLES:
        return None
    power = np.abs(np.fft.rfft(periods[0])[size // 4 : size // 2]) ** 2 / size
    return float(np.median(power) / np.log(2))  # the median of an exponential distribution over its mean


class NoiseLevel(NamedTuple):
    """An estimate of the noise."""

    value: float
    """Standard deviation of the noise [m]."""
    std: float
    """Standard deviation of the estimate [m]."""
    log_likelihood: float
    """Log-likelihood per sample."""


def likely_noise(records: Sequence[LinearRecord], freedom: float) -> NoiseLevel:
    """Return the noise with which residuals are most likely, given the degrees of freedom that a fit left of them."""
    from scipy.optimize import minimize_scalar  # slow to import: only where the noise is free

    residual = np.concatenate([record.residual for record in records])
    size = float(np.sqrt(np.mean(residual**2)))

    # A density has the standard deviation in its denominator, the probability of an interval has not.
    densities = 0 if records[0].resolution else residual.size

    def loss(log: float) -> float:
        values = interval_loss(residual, records[0].resolution, size * float(np.exp(log))).value
        return float(values.sum()) + densities * log

    found = minimize_scalar(loss, bounds=np.log(NOISE_RANGE), method="bounded")
    log = float(found.x)
    around = [loss(log + step) for step in (-COARSE_DIFFERENCE, 0.0, COARSE_DIFFERENCE)]
    curvature = float(np.diff(around, 2)[0]) / COARSE_DIFFERENCE**2
    value = size * float(np.exp(log)) * float(np.sqrt(residual.size / freedom))
    std = value / float(np.sqrt(curvature)) if curvature > 0 else np.inf
    return NoiseLevel(value, std, -float(found.fun) / residual.size)
