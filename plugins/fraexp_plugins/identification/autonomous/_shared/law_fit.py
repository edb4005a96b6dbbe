"""The inverse plant beside the friction law that explains the records."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.autonomous._shared.autonomous_elements import (
    AutonomousElements,
    ProjectedProblem,
    relative_scatter,
)
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import SpectralLines
from fraexp_plugins.identification.autonomous._shared.dictionary_fit import DictionaryFit, delayed_lines
from fraexp_plugins.identification.autonomous._shared.law_choice import LawChoice


@dataclass(frozen=True)
class LawDictionaryFit(DictionaryFit):
    """The forces of one law, and 1/P̂ beside them at each line."""

    choice: LawChoice

    @property
    def coulomb_interval(self) -> tuple[float, float]:
        """Least and greatest force in gross sliding [N] of the laws that explain the records as well, by 95 %."""
        return self.choice.interval


def fit_law(
    choice: LawChoice, lines: SpectralLines, variance: NDArray[np.float64], dead_time: float
) -> LawDictionaryFit:
    """Return the fit of the chosen law with a dead time [s].

    `lines` have the law's deflections at the excited lines of all records, and `variance` their errors [N²], each of
    shape (L, M). The sizes of the forces follow from the odd harmonics too.
    """
    law, sizes = choice.best, choice.sizes(dead_time)
    delayed, shape = delayed_lines(lines, dead_time), choice.best.elements.shape.size
    problem = ProjectedProblem.of_lines(delayed, variance)
    excess = max(float(np.sum((problem.matrix @ sizes - problem.target) ** 2)) / max(lines.equations, 1), 1.0)
    effective = delayed.thrust - delayed.deflection @ sizes
    relative = np.where(lines.known, variance / np.maximum(np.abs(effective) ** 2, 1e-300), 0.0)
    elements = AutonomousElements(
        np.ones(sizes.size),
        sizes,
        choice.covariance[shape:, shape:],
        problem.offset + problem.slopes @ sizes,
        problem.slopes,
        excess / problem.power,
        excess,
        relative_scatter(delayed, effective),
        np.asarray(np.sqrt(relative.sum(axis=1) / lines.known.sum(axis=1))),
    )
    return LawDictionaryFit(replace(delayed), law.elements, elements, dead_time, variance, choice)


def rough_inverse(lines: SpectralLines) -> NDArray[np.complex128]:
    """Return U/Y of the record with the largest motion at each line [N/m], complex, shape (L,): friction included."""
    largest = np.argmax(np.where(lines.known, np.abs(lines.motion), 0.0), axis=1)
    rows = np.arange(largest.size)
    return np.asarray(lines.thrust[rows, largest] / lines.motion[rows, largest])
