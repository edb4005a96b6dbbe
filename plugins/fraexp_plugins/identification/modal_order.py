"""How many modes a response tells: by an information criterion, or by points that are held out."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fraexp.api import RecordError
from fraexp_plugins.identification.log_response import LogResponse
from fraexp_plugins.identification.modal_model import ModalModel
from fraexp_plugins.identification.modal_solver import Solution, solve

PATIENCE = 2
"""Further modes that are tried after one that did not help: two that are close together may help but as a pair."""
FOLDS = 5
"""Parts of the points that are held out in turn."""
SLIGHT = 0.01
"""Part of what noise explains that is no gain."""


def greatest_order(data: LogResponse, model: ModalModel) -> int:
    """Return the number of modes up to which the points are more than the parameters; -1 if there are too few for any.

    A mode needs two points of its own at least, and two residuals must be left.
    """
    rest = replace(model, modes=0).size
    return max(min((data.frequency.size - 3) // 2, (data.count - 2 - rest) // 3), -1)


def information(solution: Solution) -> float:
    """Return the extended Bayesian information criterion: M ln(χ²/M) + p ln M + 2 m ln n of m modes, M residuals.

    The last term is the price of the search: the best of n places always explains some noise. J. Chen and Z. Chen,
    Biometrika 95(3), 2008, doi 10.1093/biomet/asn034. A cost below what noise explains is no gain.
    """
    data, size = solution.data, solution.model.size
    cost = max(solution.cost, data.expected)
    price = size * np.log(data.count) + 2 * solution.model.modes * np.log(data.frequency.size)
    return float(data.count * np.log(cost / data.count) + price)


def ladder(model: ModalModel, data: LogResponse, greatest: int) -> Iterator[Solution]:
    """Yield the fits of 0, 1… modes up to `greatest` of which all parameters are told, each started from the last."""
    before = None
    for modes in range(greatest + 1):
        try:
            before = solve(replace(model, modes=modes), data, before)
        except RecordError:  # the next number of modes may go well
            continue
        if not before.untold:
            yield before


def chosen_by_information(model: ModalModel, data: LogResponse, greatest: int) -> Solution | None:
    """Return the fit with the least information criterion; None if none is told."""
    best = None
    for solution in ladder(model, data, greatest):
        if best is None or information(solution) < information(best):
            best = solution
        elif solution.model.modes >= best.model.modes + PATIENCE:
            break
    return best


def chosen_by_hold_out(model: ModalModel, data: LogResponse, greatest: int) -> Solution | None:
    """Return the fit with the fewest modes that predicts held-out points as well as the best one; None if none is told.

    As well is within one standard error of the difference (one-standard-error rule: L. Breiman et al., Classification
    and Regression Trees, 1984, section 3.4.3).
    """
    errors: dict[int, np.ndarray] = {}
    for modes in range(greatest + 1):
        error = _held_out(replace(model, modes=modes), data)
        if error is not None:
            errors[modes] = error
        best = min(errors, key=lambda one: float(np.mean(errors[one])), default=modes)
        if modes >= best + PATIENCE:
            break
    for modes in sorted(errors):
        difference = errors[modes] - errors[best]
        scatter = float(np.std(difference)) / np.sqrt(difference.size)
        if np.mean(difference) <= max(scatter, SLIGHT * data.expected / data.frequency.size):
            return _last(ladder(model, data, modes), modes)
    return None


def _held_out(model: ModalModel, data: LogResponse) -> np.ndarray | None:
    """Return the weighted squared error of each point by a fit to the others, shape (n,); None if one fails."""
    errors = np.empty(data.frequency.size)
    places = np.arange(data.frequency.size)
    for fold in range(FOLDS):
        out = places[fold::FOLDS]
        try:
            found = solve(model, data.at(np.setdiff1d(places, out)))
        except RecordError:
            return None
        held = data.at(out)
        error = held.error(model.log_response(found.p, held.s))
        errors[out] = np.sum(held.stacked(error).reshape(held.parts, -1) ** 2, axis=0)
    return errors


def _last(solutions: Iterator[Solution], modes: int) -> Solution | None:
    return next((solution for solution in solutions if solution.model.modes == modes), None)


def of_order(model: ModalModel, data: LogResponse) -> Solution:
    """Return the fit of model.modes modes; RecordError if the data tell fewer."""
    if model.modes == 0:
        return solve(model, data)
    try:
        fewer = solve(replace(model, modes=model.modes - 1), data)
    except RecordError:  # what counts is whether this number goes well
        return solve(model, data)
    solution = solve(model, data, fewer)
    if information(fewer) <= information(solution):
        raise RecordError(
            f"modal_fit: the response does not tell {model.modes} modes: the last one improves the fit no more than "
            f"noise does; ask for {fewer.model.modes} or fewer, or leave 'modes' out"
        )
    return solution
