"""What friction makes likely of the terms of a motion that noise and rounding hide, over all segments of a record."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.estimators._shared.measured_terms import MeasuredTerms
from fraexp_plugins.estimators._shared.plant_above_modes import Harmonics, PlantAboveModes, fit_above_modes
from fraexp_plugins.estimators._shared.weak_terms import LikelyTerms, clear_terms, estimate_motion

ROUNDS = 2
"""Times that the friction force is found: along the clear terms, and along what it makes likely."""

ForceTerms = Callable[[Sequence[NDArray[np.complex128]]], list[NDArray[np.complex128]]]
"""Returns the terms of the friction force [N] along a motion of such terms in each segment, as in the position."""


def likely_motions(
    measured: Sequence[MeasuredTerms], force_terms: ForceTerms, guess: PlantAboveModes
) -> tuple[PlantAboveModes, list[LikelyTerms]]:
    """Return the plant above its modes, and what it makes likely of all terms in each segment."""
    plant, likely = guess, [LikelyTerms.unknown(each.terms.size) for each in measured]
    motions = [np.where(clear_terms(each.terms, each.scatter), each.terms, 0) for each in measured]
    for _ in range(ROUNDS):
        forces = force_terms(motions)
        plant = fit_above_modes([_harmonics(*pair) for pair in zip(measured, forces, strict=True)], guess)
        likely = [
            plant.likely_terms(each.omega, _causing_force(each, force))
            for each, force in zip(measured, forces, strict=True)
        ]
        motions = [
            estimate_motion(each.terms, each.scatter, own).terms for each, own in zip(measured, likely, strict=True)
        ]
    return plant, likely


def _causing_force(measured: MeasuredTerms, force: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the terms of the force [N] that alone cause the motion: 0 where something is excited, and at rest."""
    caused = force.copy()
    caused[measured.lines] = 0
    caused[0] = 0
    return caused


def _harmonics(measured: MeasuredTerms, force: NDArray[np.complex128]) -> Harmonics:
    caused = _causing_force(measured, force)
    used = caused != 0
    is_clear = clear_terms(measured.terms, measured.scatter)[used]
    scatter = np.full(is_clear.size, measured.scatter)
    return Harmonics(measured.omega[used], measured.terms[used], caused[used], scatter, is_clear)
