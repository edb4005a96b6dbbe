"""The weighted log-residual least-squares fit of a modal model, with the covariance of its parameters."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fraexp.api import RecordError
from fraexp_plugins.identification.log_response import LogResponse
from fraexp_plugins.identification.marquardt import IterationStep, minimised
from fraexp_plugins.identification.modal_model import ModalModel
from fraexp_plugins.identification.modal_starts import Dictionary, starts
from fraexp_plugins.identification.whiteness import neighbours

TRIED, FOLLOWED, REFINED = 4, 6, 25
"""Dead times and start values that are followed, and evaluations after which only the best of them goes on."""
EVALUATIONS = 400
BINS = 150
"""Parts of the band of which two points each take part in the search."""
WORTHWHILE = 0.99
"""Part to which the cost must fall for another exchange of modes to be tried."""
NOT_WHITE = 1e-3
"""Probability below which residuals do not pass for white."""
ROUNDING = 1e-9
"""Share of a point in its own fitted value, less than 1 by this at least."""
SINGULAR = 1e-7
"""Ratio of the Jacobian's singular values, its columns scaled to 1, below which the data do not tell a combination."""
CLEAR = 4.0
"""Standard deviations that a residue, or the gain, must be from 0."""
MARKED = 0.03
"""Part of the response that is left from which it is more than the noise of a record that is fit for a model."""
EXCESS = 4.0
"""Standard deviations by which the cost may exceed what noise explains before it counts as an error of the model."""


@dataclass(frozen=True)
class Solution:
    """A least-squares fit: the vector p of a model, and what it leaves."""

    model: ModalModel
    data: LogResponse
    p: np.ndarray

    @cached_property
    def error(self) -> np.ndarray:
        """ln(G_m/Ĝ), complex, shape (n,)."""
        return self.data.error(self.model.log_response(self.p, self.data.s))

    @cached_property
    def cost(self) -> float:
        """Weighted sum of squared errors Σ w|e|²."""
        return cost_of(self.data, self.error)

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Weighted derivative of the residuals by p, shape (count, size)."""
        return self.data.stacked(self.model.jacobian(self.p, self.data.s))

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of p, shape (size, size): A⁻¹ B A⁻¹ with A = JᵀWJ and B = JᵀW C W J.

        Where the covariance C of the response is unknown it is that of the residuals; where the residuals exceed what
        it explains by far, the model errs, and C is enlarged to what they show. Residuals that are alike at neighbours
        count as fewer ones.
        """
        if self.data.covariance is None:
            return self._inverse * self.excess * self.alike
        middle = self.data.scatter(self.model.jacobian(self.p, self.data.s))
        return self._inverse @ middle @ self._inverse * (self.excess if self.errs else 1.0) * self.alike

    @property
    def stated(self) -> np.ndarray:
        """Covariance of p that is stated, shape (size, size): with what the parameters may hide of the model's error.

        That is no noise and does not average out: as much of it may have gone into the parameters as is left, so that
        the residuals count as one for each parameter.
        """
        share = self.data.count / self.model.size
        if self.marked:
            return self.covariance * max(share / self.alike, 1.0)
        if not self.errs:
            return self.covariance
        return self.covariance + self._inverse * (self.excess - 1) * self.data.expected / self.model.size

    @property
    def left(self) -> float:
        """Root mean square of ln(G_m/Ĝ), of its real part alone if the magnitude alone is fitted."""
        error = np.stack([self.error.real, self.error.imag][: self.data.parts])
        return float(np.sqrt(np.mean(np.sum(error**2, axis=0))))

    @property
    def marked(self) -> bool:
        """Whether so much is left that it is hardly noise, where nothing tells how much of it is."""
        return self.data.covariance is None and self.left > MARKED

    @cached_property
    def jackknife(self) -> np.ndarray:
        """Covariance of p by leaving out one point after the other, to first order, shape (size, size).

        Unlike `covariance` it knows where the residuals are large, and what rests on a few points alone:
        J. G. MacKinnon and H. White, J. Econometrics 29(3), 1985, doi 10.1016/0304-4076(85)90158-7.
        """
        parts, points = self.data.parts, self.data.frequency.size
        rows = self.jacobian.reshape(parts, points, -1).swapaxes(0, 1)
        errors = self.data.stacked(self.error).reshape(parts, points).T
        own = rows @ self._inverse @ rows.swapaxes(1, 2)  # what a point has of its own fitted value
        left_out = np.linalg.solve((1 + ROUNDING) * np.eye(parts) - own, errors[:, :, None])
        moves = (rows.swapaxes(1, 2) @ left_out)[:, :, 0] @ self._inverse
        return np.asarray(moves.T @ moves)

    @cached_property
    def _inverse(self) -> np.ndarray:
        """A⁻¹, shape (size, size)."""
        scale = np.linalg.norm(self.jacobian, axis=0)
        _, singular, right = np.linalg.svd(self.jacobian / scale, full_matrices=False)
        return np.asarray((right.T / singular**2) @ right / np.outer(scale, scale))

    @cached_property
    def alike(self) -> float:
        """How many residuals count as one: (1 + ρ)/(1 - ρ) with their correlation ρ at neighbours, where it is clear.

        G. V. Bayley and J. M. Hammersley, J. R. Statistical Society Supplement 8(2), 1946, doi 10.2307/2983560.
        """
        correlation, probability = neighbours(self.data.stacked(self.error), self.data.parts)
        return (1 + correlation) / (1 - correlation) if correlation > 0 and probability < NOT_WHITE else 1.0

    @property
    def excess(self) -> float:
        """Cost over what the stated covariance lets expect; over the degrees of freedom where none is stated."""
        left = self.data.count - self.model.size
        return self.cost / max(self.data.expected * left / self.data.count, 1e-300)

    @property
    def errs(self) -> bool:
        """Whether the cost is more than noise explains."""
        return self.data.covariance is not None and self.excess > 1 + EXCESS * np.sqrt(2 / self.data.count)

    @property
    def untold(self) -> tuple[str, ...]:
        """Names of the parameters that the data do not tell.

        Singular combinations, those at their limits, and residues k0 r_i that white noise may have made: of all places
        where a mode is looked for, one always seems to have one.
        """
        names = self.model.names()
        scale = np.linalg.norm(self.jacobian, axis=0)
        if not scale.all():
            return tuple(name for name, size in zip(names, scale, strict=True) if size == 0)
        _, singular, right = np.linalg.svd(self.jacobian / scale, full_matrices=False)
        if singular[-1] < SINGULAR * singular[0]:
            return tuple(name for name, share in zip(names, np.abs(right[-1]), strict=True) if share > 0.1)
        low, high = self.model.bounds()
        near = (self.p < low + 1e-3) | (self.p > high - 1e-3)
        for place in range(3, self.model.damping_place, 3):
            slope = np.zeros(self.p.size)
            slope[0], slope[place] = self.p[place], 1.0  # of k0 r, over k0
            near[place] |= abs(self.p[place]) < CLEAR * np.sqrt(slope @ self.covariance @ slope / self.alike)
        return tuple(name for name, untold in zip(names, near, strict=True) if untold)


def cost_of(data: LogResponse, error: np.ndarray) -> float:
    """Return the weighted sum of squared errors of a complex ln(G_m/Ĝ), shape (n,)."""
    return float(np.sum(data.stacked(error) ** 2))


def solve(model: ModalModel, data: LogResponse, before: Solution | None = None) -> Solution:
    """Return the best fit from start values of its own, and from those of a fit with fewer modes."""
    p, converged = descend(model, data, _searched(model, data.thinned(BINS), before))
    if not converged:
        raise RecordError(
            f"modal_fit: the fit of {counted(model.modes, 'mode')} does not converge in {EVALUATIONS} evaluations: ask "
            "for fewer modes, or choose the band by 'lowest' and 'highest'"
        )
    return Solution(model, data, model.ordered(p))


def _searched(model: ModalModel, data: LogResponse, before: Solution | None) -> np.ndarray:
    """Return the best p that a search finds."""
    dictionary = Dictionary(data)
    firsts = sorted(starts(model, dictionary, np.empty((0, 2))), key=lambda p: Solution(model, data, p).cost)
    ends = {(model.rate(p), model.delay(p)): p for p in reversed(firsts)}  # the best one for each of these
    tried = sorted(ends.values(), key=lambda p: Solution(model, data, p).cost)[:TRIED]
    if before is not None:
        tried += _extended(model, dictionary, before.model.poles(before.p), before.p, before.model)
    best = _best(model, data, tried)
    for _ in range(model.modes):
        other = _best(model, data, _exchanged(model, dictionary, model.ordered(best)))
        if Solution(model, data, other).cost > WORTHWHILE * Solution(model, data, best).cost:
            break
        best = other
    return best


def counted(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}" + "s" * (number != 1)


def _exchanged(model: ModalModel, dictionary: Dictionary, p: np.ndarray) -> list[np.ndarray]:
    """Return start values in which a mode is taken away and looked for again, or two neighbours are parted anew.

    Two modes that overlap have a false minimum: a double pole with large residues of opposite sign.
    """
    poles, modes = model.poles(p), p[1 : model.damping_place].reshape(-1, 3)
    without = [np.delete(poles, i, axis=0) for i in range(model.modes)]
    found = [one for others in without for one in _extended(model, dictionary, others, p, model)]
    for i in range(model.modes - 1):
        damping, (first, second) = float(np.max(poles[i : i + 2, 1])), modes[i : i + 2]
        middle = np.array([(first[0] + second[0]) / 2, np.log(damping / 2), (first[2] + second[2]) / 2])
        apart = np.array([damping / 2, 0.0, 0.0])
        parted = np.vstack([modes[:i], middle - apart, middle + apart, modes[i + 2 :]])
        found.append(np.concatenate([p[:1], parted.ravel(), p[model.damping_place :]]))
    return found


def _extended(
    model: ModalModel, dictionary: Dictionary, poles: np.ndarray, p: np.ndarray, found: ModalModel
) -> list[np.ndarray]:
    """Return start values with these poles and one more, and with the rest of what was found."""
    return list(starts(model, dictionary, poles, (np.array([max(found.rate(p), 0.0)]), np.array([found.delay(p)]))))


def _best(model: ModalModel, data: LogResponse, tried: list[np.ndarray]) -> np.ndarray:
    """Return where the best of some start values lead."""
    low, high = model.bounds()
    tried = [np.clip(p, low + 1e-2, high - 1e-2) for p in tried]
    if not tried:
        raise RecordError(
            "modal_fit: no start value has a positive gain k0: the response must be position over force, with its "
            "sign; turn the sign of a channel, or choose a narrower band"
        )
    costs = [Solution(model, data, p).cost for p in tried]
    followed = [descend(model, data, tried[i], REFINED)[0] for i in np.argsort(costs, kind="stable")[:FOLLOWED]]
    return min(followed, key=lambda p: Solution(model, data, p).cost)


def descend(
    model: ModalModel, data: LogResponse, p: np.ndarray, evaluations: int = EVALUATIONS
) -> tuple[np.ndarray, bool]:
    """Return where least squares lead from p, and whether they have come to an end."""
    low, high = model.bounds()

    def step_of(p: np.ndarray) -> IterationStep[np.ndarray]:
        error = data.stacked(data.error(model.log_response(p, data.s)))
        return IterationStep(p, -error, data.stacked(model.jacobian(p, data.s)))

    found, count = minimised(step_of, lambda p, step: np.clip(p + step, low, high), p, evaluations)
    return found, count < evaluations
