"""The weighted log-residual least-squares fit of a modal model, with the covariance of its parameters."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError
from fraexp_plugins.identification._shared.levenberg_marquardt import IterationStep, minimise
from fraexp_plugins.identification.plant._shared.log_response import LogResponse
from fraexp_plugins.identification.plant._shared.modal_model import ModalModel
from fraexp_plugins.identification.plant._shared.modal_starts import ModeDictionary, start_vectors
from fraexp_plugins.identification.plant._shared.whiteness import neighbour_correlation

MAX_TRIAL_DELAYS, MAX_TRIAL_STARTS, TRIAL_EVALUATIONS = 4, 6, 25
"""Dead times and start values from which trial fits begin, and evaluations of each; only the best one goes on."""
MAX_EVALUATIONS = 400
SEARCH_BINS = 150
"""Parts of the frequency range, of which two points each take part in the search."""
EXCHANGE_COST_RATIO = 0.99
"""Relative cost to which an exchange of modes must lead for another one to be tried."""
WHITENESS_PROBABILITY = 1e-3
"""Probability below which residuals do not count as white."""
LEVERAGE_MARGIN = 1e-9
"""Margin below 1 of the leverage of a point, its part in its own fitted value."""
MIN_SINGULAR_RATIO = 1e-7
"""Ratio of the scaled Jacobian's singular values below which a combination of parameters is not identifiable."""
MIN_GAIN_STDS = 4.0
"""Standard deviations from 0 that a modal gain ratio, or the rigid-body gain, needs."""
MAX_NOISE_RESIDUAL = 0.03
"""Relative residual above which it cannot be the noise of a record that is suitable for a plant fit."""
MAX_EXCESS_STDS = 4.0
"""Standard deviations by which the cost may exceed its expectation by noise before it is an error of the model."""


@dataclass(frozen=True)
class Solution:
    """A least-squares fit: the vector p of a model, and its residuals."""

    model: ModalModel
    data: LogResponse
    p: NDArray[np.float64]

    @cached_property
    def error(self) -> NDArray[np.complex128]:
        """ln(G_m/Ĝ), complex, shape (n,)."""
        return self.data.error(self.model.log_response(self.p, self.data.s))

    @cached_property
    def cost(self) -> float:
        """Weighted sum of squared errors Σ w|e|²."""
        return weighted_cost(self.data, self.error)

    @cached_property
    def jacobian(self) -> NDArray[np.float64]:
        """Weighted derivative of the residuals by p, shape (count, size)."""
        return self.data.weighted_parts(self.model.jacobian(self.p, self.data.s))

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of p, shape (size, size): A⁻¹ B A⁻¹ with A = JᵀWJ and B = JᵀW C W J.

        If the covariance C of the response is unknown, the residuals give it. If the residuals exceed by far what C
        explains, the model is wrong, and C is scaled up to them. Residuals that are correlated with their neighbours
        count as fewer.
        """
        if self.data.covariance is None:
            return self._inverse * self.excess * self.correlation_factor
        middle = self.data.scatter(self.model.jacobian(self.p, self.data.s))
        return (
            self._inverse
            @ middle
            @ self._inverse
            * (self.excess if self.has_model_error else 1.0)
            * self.correlation_factor
        )

    @property
    def reported_covariance(self) -> NDArray[np.float64]:
        """Covariance of p with the part of the model's error that may hide in the parameters, shape (size, size).

        An error of the model is not noise and does not average out: as much of it may be in the parameters as in the
        residuals, so that the residuals count as one for each parameter.
        """
        per_parameter = self.data.count / self.model.size
        if self.exceeds_noise:
            return self.covariance * max(per_parameter / self.correlation_factor, 1.0)
        if not self.has_model_error:
            return self.covariance
        return self.covariance + self._inverse * (self.excess - 1) * self.data.expected / self.model.size

    @property
    def residual(self) -> float:
        """Root mean square of ln(G_m/Ĝ), of its real part if only the magnitude is fitted."""
        error = np.stack([self.error.real, self.error.imag][: self.data.parts])
        return float(np.sqrt(np.mean(np.sum(error**2, axis=0))))

    @property
    def unexplained(self) -> float:
        """The part of the residual that known noise does not explain."""
        noise = 0.0
        if self.data.covariance is not None:
            parts = np.diagonal(self.data.covariance, axis1=1, axis2=2)[:, : self.data.parts]
            noise = float(np.mean(np.sum(parts, axis=1)))
        return float(np.sqrt(max(self.residual**2 - noise, 0.0)))

    @property
    def exceeds_noise(self) -> bool:
        """Whether the residual is too large for noise, if the covariance of the response is unknown."""
        return self.data.covariance is None and self.residual > MAX_NOISE_RESIDUAL

    @cached_property
    def jackknife(self) -> NDArray[np.float64]:
        """Covariance of p by leaving out one point after the other, to first order, shape (size, size).

        Unlike `covariance` it depends on where the residuals are large, and on parameters that a few points determine:
        J. G. MacKinnon and H. White, J. Econometrics 29(3), 1985, doi 10.1016/0304-4076(85)90158-7.
        """
        parts, points = self.data.parts, self.data.frequency.size
        rows = self.jacobian.reshape(parts, points, -1).swapaxes(0, 1)
        errors = self.data.weighted_parts(self.error).reshape(parts, points).T
        leverage = rows @ self._inverse @ rows.swapaxes(1, 2)  # the leverage of a point
        left_out = np.linalg.solve((1 + LEVERAGE_MARGIN) * np.eye(parts) - leverage, errors[:, :, None])
        moves = (rows.swapaxes(1, 2) @ left_out)[:, :, 0] @ self._inverse
        return np.asarray(moves.T @ moves)

    @cached_property
    def _inverse(self) -> NDArray[np.float64]:
        """A⁻¹, shape (size, size)."""
        scale = np.linalg.norm(self.jacobian, axis=0)
        _, singular, right = np.linalg.svd(self.jacobian / scale, full_matrices=False)
        return np.asarray((right.T / singular**2) @ right / np.outer(scale, scale))

    @cached_property
    def correlation_factor(self) -> float:
        """Number of residuals that count as one: (1 + ρ)/(1 - ρ) with the correlation ρ of neighbours, if significant.

        G. V. Bayley and J. M. Hammersley, J. R. Statistical Society Supplement 8(2), 1946, doi 10.2307/2983560.
        """
        correlation, probability = neighbour_correlation(self.data.weighted_parts(self.error), self.data.parts)
        return (1 + correlation) / (1 - correlation) if correlation > 0 and probability < WHITENESS_PROBABILITY else 1.0

    @property
    def excess(self) -> float:
        """Cost over its expectation by the known covariance; over the degrees of freedom if that is unknown."""
        freedom = self.data.count - self.model.size
        return self.cost / max(self.data.expected * freedom / self.data.count, 1e-300)

    @property
    def has_model_error(self) -> bool:
        """Whether the cost is higher than noise explains."""
        return self.data.covariance is not None and self.excess > 1 + MAX_EXCESS_STDS * np.sqrt(2 / self.data.count)

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Names of the parameters that are not identifiable from the data.

        These are singular combinations, parameters at their limits, and modal gains k0 r_i that white noise may cause:
        noise always looks like a mode at one of all the frequencies that are tried.
        """
        names = self.model.names()
        scale = np.linalg.norm(self.jacobian, axis=0)
        if not scale.all():
            return tuple(name for name, size in zip(names, scale, strict=True) if size == 0)
        _, singular, right = np.linalg.svd(self.jacobian / scale, full_matrices=False)
        if singular[-1] < MIN_SINGULAR_RATIO * singular[0]:
            return tuple(name for name, part in zip(names, np.abs(right[-1]), strict=True) if part > 0.1)
        low, high = self.model.bounds()
        near = (self.p < low + 1e-3) | (self.p > high - 1e-3)
        for place in range(3, self.model.damping_place, 3):
            slope = np.zeros(self.p.size)
            slope[0], slope[place] = self.p[place], 1.0  # of k0 r, over k0
            near[place] |= abs(self.p[place]) < MIN_GAIN_STDS * np.sqrt(
                slope @ self.covariance @ slope / self.correlation_factor
            )
        return tuple(name for name, is_near in zip(names, near, strict=True) if is_near)


def weighted_cost(data: LogResponse, error: NDArray[np.complex128]) -> float:
    """Return the weighted sum of squared errors of a complex ln(G_m/Ĝ), shape (n,)."""
    return float(np.sum(data.weighted_parts(error) ** 2))


def solve(model: ModalModel, data: LogResponse, before: Solution | None = None) -> Solution:
    """Return the best fit from its own start values and from those of a fit with fewer modes."""
    descent = descend(model, data, _search(model, data.search_points(SEARCH_BINS), before))
    if not descent.converged:
        raise RecordError(
            f"modal_fit: the fit of {count_text(model.modes, 'mode')} does not converge in {MAX_EVALUATIONS} "
            "evaluations; use fewer modes, or another frequency range (min_frequency, max_frequency)"
        )
    return Solution(model, data, model.sort_modes(descent.p))


def _search(model: ModalModel, data: LogResponse, before: Solution | None) -> NDArray[np.float64]:
    """Return the best p of a search."""
    dictionary = ModeDictionary(data)
    firsts = sorted(start_vectors(model, dictionary, np.empty((0, 2))), key=lambda p: Solution(model, data, p).cost)
    ends = {(model.rate(p), model.delay(p)): p for p in reversed(firsts)}  # the best one for each of these
    tried = sorted(ends.values(), key=lambda p: Solution(model, data, p).cost)[:MAX_TRIAL_DELAYS]
    if before is not None:
        tried += _extended_starts(model, dictionary, before.model.poles(before.p), before.p, before.model)
    best = _best(model, data, tried)
    for _ in range(model.modes):
        other = _best(model, data, _exchange_starts(model, dictionary, model.sort_modes(best)))
        if Solution(model, data, other).cost > EXCHANGE_COST_RATIO * Solution(model, data, best).cost:
            break
        best = other
    return best


def count_text(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}" + "s" * (number != 1)


def _exchange_starts(
    model: ModalModel, dictionary: ModeDictionary, p: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return start values in which one mode is searched for again, or two neighbours are split anew.

    Two modes that overlap have a local minimum: a double pole with large modal gains of opposite sign.
    """
    poles, modes = model.poles(p), p[1 : model.damping_place].reshape(-1, 3)
    without = [np.delete(poles, i, axis=0) for i in range(model.modes)]
    found = [one for others in without for one in _extended_starts(model, dictionary, others, p, model)]
    for i in range(model.modes - 1):
        damping, (first, second) = float(np.max(poles[i : i + 2, 1])), modes[i : i + 2]
        middle = np.array([(first[0] + second[0]) / 2, np.log(damping / 2), (first[2] + second[2]) / 2])
        offset = np.array([damping / 2, 0.0, 0.0])
        split = np.vstack([modes[:i], middle - offset, middle + offset, modes[i + 2 :]])
        found.append(np.concatenate([p[:1], split.ravel(), p[model.damping_place :]]))
    return found


def _extended_starts(
    model: ModalModel, dictionary: ModeDictionary, poles: NDArray[np.float64], p: NDArray[np.float64], found: ModalModel
) -> list[NDArray[np.float64]]:
    """Return start values with these poles and one more, and with rate and delay of a fit."""
    return list(
        start_vectors(model, dictionary, poles, (np.array([max(found.rate(p), 0.0)]), np.array([found.delay(p)])))
    )


def _best(model: ModalModel, data: LogResponse, tried: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the best p to which some start values lead."""
    low, high = model.bounds()
    tried = [np.clip(p, low + 1e-2, high - 1e-2) for p in tried]
    if not tried:
        raise RecordError(
            "modal_fit: no start value has a positive rigid-body gain; expected position over force: change the sign "
            "of a channel, or choose a narrower frequency range"
        )
    costs = [Solution(model, data, p).cost for p in tried]
    followed = [
        descend(model, data, tried[i], TRIAL_EVALUATIONS).p for i in np.argsort(costs, kind="stable")[:MAX_TRIAL_STARTS]
    ]
    return min(followed, key=lambda p: Solution(model, data, p).cost)


class Descent(NamedTuple):
    """Where least squares lead."""

    p: NDArray[np.float64]
    converged: bool


def descend(
    model: ModalModel, data: LogResponse, p: NDArray[np.float64], evaluations: int = MAX_EVALUATIONS
) -> Descent:
    """Return where least squares lead from p."""
    low, high = model.bounds()

    def step_of(p: NDArray[np.float64]) -> IterationStep[NDArray[np.float64]]:
        error = data.weighted_parts(data.error(model.log_response(p, data.s)))
        return IterationStep(p, -error, lambda: data.weighted_parts(model.jacobian(p, data.s)))

    minimum = minimise(step_of, lambda p, step: np.clip(p + step, low, high), p, evaluations)
    return Descent(minimum.place, minimum.iterations < evaluations)
