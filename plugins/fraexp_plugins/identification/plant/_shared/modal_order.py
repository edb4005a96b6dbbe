"""The number of modes in a response: by an information criterion, or by held-out points."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError
from fraexp_plugins.identification.plant._shared.log_response import LogResponse
from fraexp_plugins.identification.plant._shared.modal_doubts import unsupported_parts
from fraexp_plugins.identification.plant._shared.modal_model import ModalModel
from fraexp_plugins.identification.plant._shared.modal_solver import Solution, count_text, descend, solve

EXTRA_MODES = 2
"""Modes that are tried after one that did not help: two modes close together may help only as a pair."""
FOLDS = 5
"""Parts of the points that are held out in turn."""
NEGLIGIBLE_GAIN = 0.01
"""Gain that counts as none, relative to the error that noise explains."""


def mode_limit(data: LogResponse, model: ModalModel) -> int:
    """Return the largest number of modes that the points can determine; -1 if they are too few for a rigid body.

    A mode needs two points of its own, and two residuals must remain.
    """
    rest = replace(model, modes=0).size
    return max(min((data.frequency.size - 3) // 2, (data.count - 2 - rest) // 3), -1)


def information_criterion(solution: Solution, correlation_factor: float = 1.0) -> float:
    """Return the extended Bayesian information criterion: M ln(χ²/M) + p ln M + 2 m ln n of m modes, M residuals.

    The last term is the price of the search: the best of n places always explains some noise. J. Chen and Z. Chen,
    Biometrika 95(3), 2008, doi 10.1093/biomet/asn034. A cost below the expectation by noise is no gain.
    `correlation_factor` is the number of correlated residuals that count as one.
    """
    data, size = solution.data, solution.model.size
    cost, count = max(solution.cost, data.expected), data.count / correlation_factor
    price = size * np.log(max(count, math.e)) + 2 * solution.model.modes * np.log(data.frequency.size)
    return float(count * np.log(cost / data.count) + price)


def nested_fits(model: ModalModel, data: LogResponse, max_order: int) -> Iterator[Solution]:
    """Yield the fits of 0, 1… modes up to `max_order`, each started from the last."""
    before = None
    for modes in range(max_order + 1):
        try:
            before = solve(replace(model, modes=modes), data, before)
        except RecordError:  # the fit with one mode more may succeed
            continue
        yield before


@dataclass(frozen=True)
class OrderChoice:
    """The chosen number of modes."""

    solution: Solution | None
    """The fit, all of whose modes the data support; None if there is none."""
    dropped: str
    """What the data do not support in fits with smaller residuals, and why; empty if there is nothing."""


def chosen_by_information(model: ModalModel, data: LogResponse, max_order: int) -> OrderChoice:
    """Return the fit with the smallest information criterion among those whose modes the data support."""
    found: list[Solution] = []
    for solution in nested_fits(model, data, max_order):
        found.append(solution)
        if solution.model.modes >= min(found, key=information_criterion).model.modes + EXTRA_MODES:
            break
    if not found:
        return OrderChoice(None, "")
    best = min(found, key=information_criterion)
    return _first_supported(found, lambda one: information_criterion(one, best.correlation_factor))


def chosen_by_hold_out(model: ModalModel, data: LogResponse, max_order: int) -> OrderChoice:
    """Return the fit with the fewest modes that predicts held-out points as well as the best.

    As well is within one standard error of the difference (one-standard-error rule: L. Breiman et al., Classification
    and Regression Trees, 1984, section 3.4.3).
    """
    errors: dict[int, NDArray[np.float64]] = {}
    found: list[Solution] = []
    for solution in nested_fits(model, data, max_order):
        modes = solution.model.modes
        error = _held_out_errors(solution, data)
        if error is not None:
            errors[modes] = error
            found.append(solution)
        if modes >= min(errors, key=lambda one: float(np.mean(errors[one])), default=modes) + EXTRA_MODES:
            break
    if not found:
        return OrderChoice(None, "")
    best = min(found, key=lambda one: float(np.mean(errors[one.model.modes])))

    def rank(one: Solution) -> float:
        difference = errors[one.model.modes] - errors[best.model.modes]
        negligible = max(
            float(np.std(difference)) / np.sqrt(difference.size), NEGLIGIBLE_GAIN * data.expected / data.frequency.size
        )
        loss = float(np.mean(difference))
        return -1.0 / (1 + one.model.modes) if loss <= negligible else loss

    return _first_supported(found, rank)


def _first_supported(found: list[Solution], rank: Callable[[Solution], float]) -> OrderChoice:
    """Return the first fit by rank without unsupported parts, and the shortest list of those in the fits before it."""
    fewest: tuple[str, ...] = ()
    for solution in sorted(found, key=rank):
        unsupported = unsupported_parts(solution)
        if not unsupported:
            return OrderChoice(solution, "; ".join(fewest))
        fewest = unsupported if not fewest or len(unsupported) < len(fewest) else fewest
    return OrderChoice(None, "; ".join(fewest))


def _held_out_errors(solution: Solution, data: LogResponse) -> NDArray[np.float64] | None:
    """Return the weighted squared error of each point in a fit to the others, shape (n,); None if a fit fails.

    The fits to the others start where the fit to all points ended.
    """
    model = solution.model
    errors = np.empty(data.frequency.size)
    places = np.arange(data.frequency.size)
    for fold in range(FOLDS):
        out = places[fold::FOLDS]
        descent = descend(model, data.subset(np.setdiff1d(places, out)), solution.p)
        if not descent.converged:
            return None
        held = data.subset(out)
        error = held.error(model.log_response(descent.p, held.s))
        errors[out] = np.sum(held.weighted_parts(error).reshape(held.parts, -1) ** 2, axis=0)
    return errors


def fit_of_order(model: ModalModel, data: LogResponse) -> Solution:
    """Return the fit of model.modes modes; RecordError if the data determine fewer."""
    if model.modes == 0:
        return solve(model, data)
    try:
        fewer = solve(replace(model, modes=model.modes - 1), data)
    except RecordError:  # only this number of modes has to succeed
        return solve(model, data)
    solution = solve(model, data, fewer)
    if information_criterion(fewer) <= information_criterion(solution):
        raise RecordError(
            f"modal_fit: the response supports fewer than {count_text(model.modes, 'mode')}: the last one improves the "
            f"fit no more than noise; set modes to {fewer.model.modes} or less, or leave it out"
        )
    return solution
