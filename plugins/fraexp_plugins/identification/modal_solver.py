"""The weighted log-residual least-squares fit of a modal model, with the covariance of its parameters."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fraexp.api import RecordError
from fraexp_plugins.identification.log_response import LogResponse
from fraexp_plugins.identification.modal_model import ModalModel
from fraexp_plugins.identification.modal_starts import Dictionary, starts

TRIED, FOLLOWED, REFINED = 4, 6, 25
"""Dead times and start values that are followed, and evaluations after which only the best of them goes on."""
EVALUATIONS = 400
WORTHWHILE = 0.99
"""Part to which the cost must fall for another exchange of modes to be tried."""
SINGULAR = 1e-7
"""Ratio of the Jacobian's singular values, its columns scaled to 1, below which the data do not tell a combination."""
CLEAR = 4.0
"""Standard deviations that a residue must be from 0."""
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
        it explains by far, the model errs, and C is enlarged to what they show.
        """
        scale = np.linalg.norm(self.jacobian, axis=0)
        _, singular, right = np.linalg.svd(self.jacobian / scale, full_matrices=False)
        inverse = (right.T / singular**2) @ right / np.outer(scale, scale)
        if self.data.covariance is None:
            return inverse * self.excess
        middle = self.data.scatter(self.model.jacobian(self.p, self.data.s))
        return inverse @ middle @ inverse * (self.excess if self.errs else 1.0)

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

        Singular combinations, those at their limits, and residues k0 r_i that noise may have made: of all places where
        a mode is looked for, one always seems to have one.
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
            near[place] |= abs(self.p[place]) < CLEAR * np.sqrt(slope @ self.covariance @ slope)
        return tuple(name for name, untold in zip(names, near, strict=True) if untold)


def cost_of(data: LogResponse, error: np.ndarray) -> float:
    """Return the weighted sum of squared errors of a complex ln(G_m/Ĝ), shape (n,)."""
    return float(np.sum(data.stacked(error) ** 2))


def solve(model: ModalModel, data: LogResponse, before: Solution | None = None) -> Solution:
    """Return the best fit from start values of its own, and from those of a fit with fewer modes."""
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
    p, converged = _descend(model, data, best, EVALUATIONS)
    if not converged:
        raise RecordError(
            f"modal_fit: the fit of {model.modes} modes does not converge in {EVALUATIONS} evaluations: ask for fewer "
            "modes, or choose the band by 'lowest' and 'highest'"
        )
    return Solution(model, data, model.ordered(p))


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
    followed = [_descend(model, data, tried[i], REFINED)[0] for i in np.argsort(costs, kind="stable")[:FOLLOWED]]
    return min(followed, key=lambda p: Solution(model, data, p).cost)


def _descend(model: ModalModel, data: LogResponse, p: np.ndarray, evaluations: int) -> tuple[np.ndarray, bool]:
    """Return where least squares lead from p, and whether they have come to an end."""
    from scipy.optimize import least_squares  # scipy: imported only when something is estimated

    found = least_squares(
        lambda p: data.stacked(data.error(model.log_response(p, data.s))),
        p,
        jac=lambda p: data.stacked(model.jacobian(p, data.s)),
        bounds=model.bounds(),
        x_scale="jac",
        ftol=1e-12,
        xtol=1e-10,
        gtol=1e-12,
        max_nfev=evaluations,
    )
    return found.x, found.status > 0
