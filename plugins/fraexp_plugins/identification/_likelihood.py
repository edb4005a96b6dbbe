"""A linearised fit of several records at once: parameters that all share, and those of each record alone."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import CONVERGED, MAX_ITERATIONS, ROUNDING, SIGNIFICANCE, Signals

MODEL_ERROR = 0.3
"""Standard deviation of the error of a right model, over noise and rounding: it adds 4 % to a residual. Replays have
some, and thousands of samples show it. Half of it changes no verdict of the fits that `_record_fit` names."""


def greatest_ratio(freedom: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return the root mean square of a residual, over its expectation, that chance hardly exceeds: a χ² test.

    `freedom` are the degrees of freedom, of any shape.
    """
    from scipy.special import chdtri  # slow to import: listing plugins must stay fast

    return np.asarray(np.sqrt((1 + MODEL_ERROR**2) * chdtri(freedom, SIGNIFICANCE) / freedom))


def greatest_variance_ratio(terms: float, freedom: float) -> float:
    """Return the ratio of variances that chance hardly exceeds: an F test with these degrees of freedom."""
    from scipy.special import fdtri  # slow to import: listing plugins must stay fast

    return float(fdtri(terms, freedom, 1 - SIGNIFICANCE))


FAR_OUT = -30.0
"""Standard deviations at which Φ is too small a number: logarithms of it are taken there, which take longer."""
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

    found, far = np.log(np.maximum(ndtr(upper) - ndtr(lower), 1e-300)), upper <= FAR_OUT
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
    problem: "_Problem"
    """Linearised records, and what holds their parameters."""
    point: "_Point"
    """Where it ends."""

    @property
    def covariances(self) -> tuple[NDArray[np.float64], ...]:
        """Inverse of the information about shared parameters, then those of one record, shape (p + m, p + m) each."""
        p, information = self.shared.size, np.diag(self.problem.shared_radius**-2.0)
        for block, mixed in self._blocks:
            information = information + block.hessian[:p, :p] - block.hessian[:p, p:] @ mixed
        shared, found = np.linalg.inv(information), []
        for block, mixed in self._blocks:
            of_own = np.linalg.inv(block.hessian[p:, p:]) + mixed @ shared @ mixed.T
            found.append(np.block([[shared, -shared @ mixed.T], [-mixed @ shared, of_own]]))
        return tuple(found)

    def covariances_beside(
        self, shared: NDArray[np.float64], weights: NDArray[np.float64], added: Sequence[int]
    ) -> tuple[NDArray[np.float64], ...]:
        """Return the same where shared parameters are held as an efficient fit to the same records has them.

        `shared` is their covariance, shape (p, p), `weights` the weight of each record there over that here, and
        `added` says how many of its own parameters, the first ones, that fit did not have. What a record tells against
        an efficient estimate is independent of it (J. A. Hausman, Econometrica 46(6), 1978), so that these parameters
        are known better than beside an estimate from other records.
        """
        p, found = len(shared), []
        for (block, mixed), weight, count in zip(self._blocks, weights, added, strict=True):
            own, to_shared = block.hessian[p:, p:], block.hessian[p:, :p]
            beside = to_shared - own[:, count:] @ _solution(own[count:, count:], to_shared[count:])
            common = weight * _solution(own, beside) @ shared
            cross = common - mixed @ shared
            of_own = np.linalg.inv(own) - cross @ mixed.T - mixed @ common.T
            found.append(np.block([[shared, cross.T], [cross, of_own]]))
        return tuple(found)

    @property
    def _blocks(self) -> list[tuple["_Blocks", NDArray[np.float64]]]:
        """Blocks of the records, and how their own parameters move with the shared ones, shape (m, p) each."""
        p, blocks = self.shared.size, self.problem.blocks(self.point)
        return [(block, _solution(block.hessian[p:, p:], block.hessian[p:, :p])) for block in blocks]


class _Blocks(NamedTuple):
    """Gradient and curvature of one record's loss."""

    gradient: NDArray[np.float64]
    hessian: NDArray[np.float64]


def fit_linear(
    records: Sequence[LinearRecord],
    shared_radius: NDArray[np.float64],
    own_radius: Sequence[NDArray[np.float64]],
    held: NDArray[np.float64] | None = None,
) -> FitStep:
    """Return the step that minimises the loss of all records, within about these radii.

    The change of the shared parameters is `held`, if it is given. Newton's method on a convex function. The parameters
    of different records meet in the shared ones alone, so that each record's own ones are eliminated before the shared
    ones are solved for.
    """
    problem, still = _Problem(records, shared_radius, own_radius, held is None), np.zeros(shared_radius.size)
    before = problem.evaluate(still, [np.zeros(radius.size) for radius in own_radius])
    point = before if held is None else problem.evaluate(held, before.own)
    for _ in range(MAX_ITERATIONS):
        step, own_steps, slope = problem.newton_step(point)
        for length in 2.0 ** -np.arange(MAX_ITERATIONS):
            own = [a + length * b for a, b in zip(point.own, own_steps, strict=True)]
            tried = problem.evaluate(point.shared + length * step, own)
            if tried.loss <= point.loss:
                break
        point = tried
        if -slope <= CONVERGED:
            break
    return FitStep(point.shared, tuple(point.own), before.loss - point.loss, problem, point)


def _solution(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.solve(matrix, right), dtype=float)


class _Point(NamedTuple):
    """Values of all parameters, and what the records are there."""

    shared: NDArray[np.float64]
    own: Sequence[NDArray[np.float64]]
    losses: Sequence[Loss]
    """Loss of the samples of each record, with its derivatives by them."""
    loss: float
    """Loss of all records and of what holds the parameters."""


class _Problem(NamedTuple):
    """Linearised records, and what holds their parameters."""

    records: Sequence[LinearRecord]
    shared_radius: NDArray[np.float64]
    own_radius: Sequence[NDArray[np.float64]]
    is_shared_free: bool

    def evaluate(self, shared: NDArray[np.float64], own: Sequence[NDArray[np.float64]]) -> _Point:
        pairs = list(zip(self.records, own, strict=True))
        residuals = [r.residual - r.jacobian @ np.concatenate([shared, values]) for r, values in pairs]
        sizes = [residual.size for residual in residuals]
        stds = np.repeat([record.std for record in self.records], sizes)
        every = interval_loss(np.concatenate(residuals), self.records[0].resolution, stds)  # at once, as each is short
        parts = zip(*(np.split(each, np.cumsum(sizes)[:-1]) for each in every), strict=True)
        ratios = [values / radius for values, radius in zip(own, self.own_radius, strict=True)]
        held = sum(float(np.sum(each**2)) for each in (shared / self.shared_radius, *ratios))
        return _Point(shared, own, [Loss(*each) for each in parts], float(every.value.sum()) + 0.5 * held)

    def blocks(self, point: _Point) -> list[_Blocks]:
        parts, p = zip(self.records, point.losses, point.own, self.own_radius, strict=True), point.shared.size
        return [_blocks(p, record, loss, own, radius) for record, loss, own, radius in parts]

    def newton_step(self, point: _Point) -> tuple[NDArray[np.float64], list[NDArray[np.float64]], float]:
        """Return the step of shared and own parameters, and the slope of the loss along it."""
        p, blocks, held = point.shared.size, self.blocks(point), self.shared_radius**-2.0
        hessian: NDArray[np.float64] = np.diag(held)
        gradient = shared_gradient = held * point.shared
        for block in blocks:
            mixed = _solution(block.hessian[p:, p:], block.hessian[p:, :p])
            hessian = hessian + block.hessian[:p, :p] - block.hessian[:p, p:] @ mixed
            gradient = gradient + block.gradient[:p] - mixed.T @ block.gradient[p:]
            shared_gradient = shared_gradient + block.gradient[:p]
        step = -_solution(hessian, gradient) if p and self.is_shared_free else np.zeros(p)
        slope, own_steps = float(shared_gradient @ step), []
        for block in blocks:
            right = block.gradient[p:] + block.hessian[p:, :p] @ step
            own_steps.append(-_solution(block.hessian[p:, p:], right))
            slope += float(block.gradient[p:] @ own_steps[-1])
        return step, own_steps, slope


def _blocks(
    shared: int, record: LinearRecord, loss: Loss, own: NDArray[np.float64], radius: NDArray[np.float64]
) -> _Blocks:
    weights, across = np.concatenate([np.zeros(shared), radius**-2.0]), record.jacobian.T
    gradient = -(across @ loss.slope) + weights * np.concatenate([np.zeros(shared), own])
    return _Blocks(gradient, (across * loss.curvature) @ record.jacobian + np.diag(weights))


MIN_SAMPLES = 64
"""Samples of a period from which its upper half of the spectrum has no harmonics of friction to speak of: the 17th of
a sine has some 1e-3 of the first."""
NOISE_RANGE = (3e-3, 3.0)
"""Noise that is looked for over the residual: rounding makes a residual without noise, and less than its least hardly
changes a likelihood."""
LOG_DIFFERENCE = 0.05
"""Half width of the second difference by the logarithm of the noise: a few times a standard deviation of some 1e-2."""


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
    curvature = (loss(log + LOG_DIFFERENCE) - 2 * loss(log) + loss(log - LOG_DIFFERENCE)) / LOG_DIFFERENCE**2
    value = size * float(np.exp(log)) * float(np.sqrt(residual.size / freedom))
    std = value / float(np.sqrt(curvature)) if curvature > 0 else np.inf
    return NoiseLevel(value, std, -float(found.fun) / residual.size)
