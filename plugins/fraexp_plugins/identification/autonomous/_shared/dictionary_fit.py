"""Friction of a dictionary, 1/P̂ and the dead time, such that P̂ is the same at all amplitudes."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Signals, phasors
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE
from fraexp_plugins.identification.autonomous._shared.autonomous_elements import (
    AutonomousElements,
    ProjectedProblem,
    fit_elements,
)
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import ElementObserver, SpectralLines
from fraexp_plugins.identification.autonomous._shared.force_dictionary import ForceDictionary
from fraexp_plugins.identification.autonomous._shared.force_interval import sum_interval
from fraexp_plugins.identification.autonomous._shared.law_elements import BristleElements, LawElements

REWEIGHTINGS = 2
"""Passes in which a record counts the less, the more the one before has left of it."""
RESIDUAL_SHARE = 1.5
"""Variance of a record over what is left of its square: the response of its line has taken a part of it."""
MAX_DEAD_TIME = 8
"""Largest dead time that is tried [samples]."""


@dataclass(frozen=True)
class DictionaryFit:
    """A friction force for each column, and the inverse plant beside them at each line."""

    lines: SpectralLines
    dictionary: ForceDictionary | LawElements
    elements: AutonomousElements
    dead_time: float
    """Dead time in addition to that of the observer [s]."""
    variance: NDArray[np.float64]
    """Variance by which the last pass has weighted the records [N²], shape (L, M)."""

    @property
    def forces(self) -> NDArray[np.float64]:
        """Force of each column [N], shape (N,)."""
        return self.elements.stiffness * self.dictionary.widths

    @property
    def force_covariance(self) -> NDArray[np.float64]:
        """Covariance of the forces [N²], shape (N, N)."""
        return self.elements.covariance * np.outer(self.dictionary.widths, self.dictionary.widths)

    @property
    def shares(self) -> tuple[float, float, float, float]:
        """Forces of stop operators, bristles, dampers and of what weakens over the Coulomb force."""
        total = max(self.coulomb, 1e-300)
        if isinstance(self.dictionary, LawElements):
            is_bristle = isinstance(self.dictionary, BristleElements)
            return float(not is_bristle), float(is_bristle), 0.0, self.dictionary.static_excess
        first, second, third, fourth = (float(self.forces[part].sum()) / total for part in self.dictionary.parts)
        return first, second, third, fourth

    @cached_property
    def scatter(self) -> NDArray[np.float64]:
        """How far the records of each line differ in P̂, relative and weighted as P̂ is, shape (L,).

        A record in which friction balances nearly all of the thrust shows little of the plant, and counts as little. Of
        one record it is what noise explains.
        """
        lines, known = self.lines, self.lines.known
        weight, count = np.where(known, 1 / np.where(known, self.variance, 1.0), 0.0), known.sum(axis=1)
        left = np.sum(weight * np.abs(residuals(lines, self.elements)) ** 2, axis=1) / np.maximum(count - 1, 1)
        power = np.sum(weight * np.abs(self.elements.inverse[:, None] * lines.motion) ** 2, axis=1) / count
        return np.where(count > 1, np.sqrt(left / power), self.elements.noise_floor)

    @property
    def coulomb(self) -> float:
        """Force in gross sliding [N]."""
        return float(self.forces[self.dictionary.is_coulomb].sum())

    @cached_property
    def coulomb_interval(self) -> tuple[float, float]:
        """Least and greatest force in gross sliding [N] of a dictionary that explains the records as well, by 95 %.

        A covariance does not contain it: forces that weaken in sliding may be in the place of Coulomb force although
        the fit has found none of them.
        """
        problem = ProjectedProblem.of_lines(self.lines, self.variance)
        rise = NORMAL_QUANTILE**2 * max(self.elements.excess, 1.0)
        return sum_interval(problem.matrix / self.dictionary.widths, problem.target, self.dictionary.is_coulomb, rise)

    @property
    def coulomb_error(self) -> float:
        """Distance from the force in gross sliding to the farther end of its interval [N]."""
        low, high = self.coulomb_interval
        return max(high - self.coulomb, self.coulomb - low)

    def virgin_curve(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the force [N] of a first slow displacement x [m] and its standard deviation, shape (n,) each."""
        columns = self.dictionary.virgin_columns(x)
        variance = np.einsum("ij,jk,ik->i", columns, self.force_covariance, columns)
        return columns @ self.forces, np.sqrt(np.maximum(variance, 0.0))


class Weights(NamedTuple):
    """What the records are weighted by."""

    noise: NDArray[np.float64]
    """Variance of the thrust by the scatter of the periods [N²], shape (L, M)."""
    model_error: float
    """Relative error of the thrust that is allowed for besides."""
    peak: float
    """Peak thrust [N]."""


def fit_dictionary(
    lines: SpectralLines, dictionary: ForceDictionary, weights: Weights, dead_time: float
) -> DictionaryFit:
    """Return the fit of the records at all lines, with a dead time [s] in addition to that of the observer."""
    delayed = delayed_lines(lines, dead_time)
    total = _variances(lines, weights)
    elements, variance = fit_elements(delayed, dictionary.widths, total, weights.peak), total
    for _ in range(REWEIGHTINGS):
        variance = total + RESIDUAL_SHARE * np.abs(residuals(delayed, elements)) ** 2
        elements = fit_elements(delayed, dictionary.widths, variance, weights.peak)
    return DictionaryFit(delayed, dictionary, elements, dead_time, variance)


def rough_dead_time(lines: SpectralLines, dictionary: ForceDictionary, weights: Weights, sample_time: float) -> float:
    """Return the dead time [s], of whole samples, with which friction explains most of what amplitudes change."""
    total = _variances(lines, weights)

    def cost(samples: int) -> float:
        delayed = delayed_lines(lines, samples * sample_time)
        left = np.abs(residuals(delayed, fit_elements(delayed, dictionary.widths, total, weights.peak))) ** 2
        # the logarithm lets no record decide alone
        return float(np.sum(np.log1p(left[lines.known] / total[lines.known])))

    return min(range(MAX_DEAD_TIME + 1), key=cost) * sample_time


def _variances(lines: SpectralLines, weights: Weights) -> NDArray[np.float64]:
    return weights.noise + weights.model_error**2 * np.abs(lines.thrust) ** 2


def delayed_lines(lines: SpectralLines, dead_time: float) -> SpectralLines:
    """Return the lines with a thrust that comes later by a dead time [s]; the hold's images come later too."""
    omega, known = 2 * np.pi * lines.frequency, lines.delays
    later = known._replace(input_dead_time=known.input_dead_time + dead_time)
    turn = later.input_path(omega, lines.sample_time) / known.input_path(omega, lines.sample_time)
    return replace(lines, thrust=lines.thrust * turn[:, None], delays=later)


def residuals(lines: SpectralLines, elements: AutonomousElements) -> NDArray[np.complex128]:
    """Return G U - F̂ - Y/P̂ [N], complex, shape (L, M); 0 where there is no record."""
    left = lines.thrust - lines.deflection @ elements.stiffness - elements.inverse[:, None] * lines.motion
    return np.where(lines.known, left, 0.0)


def scatter_noise(
    signals: Signals, lines: SpectralLines, observer: ElementObserver, inverse: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return the variance [N²] of G U - Y/P̂ by the scatter of the periods and by rounding, shape (L, M)."""
    found = np.zeros(lines.thrust.shape)
    begin = 0
    for group in lines.groups:
        end = begin + signals.segments[group[0]].lines.size
        for record, place in enumerate(group):
            segment = signals.segments[place]
            path = observer.input_path(2 * np.pi * segment.frequency, segment.sample_time)
            error = path * phasors(segment, observer.input) - inverse[begin:end] * phasors(segment, observer.output)
            periods = len(error)
            if periods > 1:
                scatter = np.add.reduce(np.abs(error - error.mean(axis=0)) ** 2, axis=0)
                found[begin:end, record] = scatter / (periods * (periods - 1))
            rounding = observer.resolution**2 / 6 / (segment.samples * periods)
            found[begin:end, record] += np.abs(inverse[begin:end]) ** 2 * rounding
        begin = end
    return found
