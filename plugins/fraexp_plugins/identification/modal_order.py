"""How many modes a response tells: by an information criterion, or by points that are held out."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from fraexp.api import RecordError
from fraexp_plugins.identification.log_response import LogResponse
from fraexp_plugins.identification.modal_doubts import doubts
from fraexp_plugins.identification.modal_model import ModalModel
from fraexp_plugins.identification.modal_solver import Solution, counted, descend, solve

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


def information(solution: Solution, alike: float = 1.0) -> float:
    """Return the extended Bayesian information criterion: M ln(χ²/M) + p ln M + 2 m ln n of m modes, M residuals.

    The last term is the price of the search: the best of n places always explains some noise. J. Chen and Z. Chen,
    Biometrika 95(3), 2008, doi 10.1093/biomet/asn034. A cost below what noise explains is no gain, and of residuals of
    which `alike` neighbours say the same only as many are counted.
    """
    data, size = solution.data, solution.model.size
    cost, count = max(solution.cost, data.expected), data.count / alike
    price = size * np.log(max(count, math.e)) + 2 * solution.model.modes * np.log(data.frequency.size)
    return float(count * np.log(cost / data.count) + price)


def ladder(model: ModalModel, data: LogResponse, greatest: int) -> Iterator[Solution]:
    """Yield the fits of 0, 1… modes up to `greatest`, each started from the last."""
    before = None
    for modes in range(greatest + 1):
        try:
            before = solve(replace(model, modes=modes), data, before)
        except RecordError:  # the next number of modes may go well
            continue
        yield before


@dataclass(frozen=True)
class Choice:
    """The number of modes that was chosen."""

    solution: Solution | None
    """Its fit, of which the data carry all modes; None if there is none."""
    dropped: str
    """What the data do not carry of fits that leave less, and why; empty if there is none."""


def chosen_by_information(model: ModalModel, data: LogResponse, greatest: int) -> Choice:
    """Return the fit with the least information criterion of those whose modes the data carry."""
    found: list[Solution] = []
    for solution in ladder(model, data, greatest):
        found.append(solution)
        if solution.model.modes >= min(found, key=information).model.modes + PATIENCE:
            break
    if not found:
        return Choice(None, "")
    best = min(found, key=information)
    return _carried(found, lambda one: information(one, best.alike))


def chosen_by_hold_out(model: ModalModel, data: LogResponse, greatest: int) -> Choice:
    """Return the fit with the fewest modes that predicts held-out points as well as the best one, if they carry them.

    As well is within one standard error of the difference (one-standard-error rule: L. Breiman et al., Classification
    and Regression Trees, 1984, section 3.4.3).
    """
    errors: dict[int, np.ndarray] = {}
    found: list[Solution] = []
    for solution in ladder(model, data, greatest):
        modes = solution.model.modes
        error = _held_out(solution, data)
        if error is not None:
            errors[modes] = error
            found.append(solution)
        if modes >= min(errors, key=lambda one: float(np.mean(errors[one])), default=modes) + PATIENCE:
            break
    if not found:
        return Choice(None, "")
    best = min(found, key=lambda one: float(np.mean(errors[one.model.modes])))

    def rank(one: Solution) -> float:
        difference = errors[one.model.modes] - errors[best.model.modes]
        slight = max(float(np.std(difference)) / np.sqrt(difference.size), SLIGHT * data.expected / data.frequency.size)
        lost = float(np.mean(difference))
        return -1.0 / (1 + one.model.modes) if lost <= slight else lost

    return _carried(found, rank)


def _carried(found: list[Solution], rank: Callable[[Solution], float]) -> Choice:
    """Return the first by rank of the fits without doubts, and the fewest doubts of those that went before it."""
    fewest: tuple[str, ...] = ()
    for solution in sorted(found, key=rank):
        against = doubts(solution)
        if not against:
            return Choice(solution, "; ".join(fewest))
        fewest = against if not fewest or len(against) < len(fewest) else fewest
    return Choice(None, "; ".join(fewest))


def _held_out(solution: Solution, data: LogResponse) -> np.ndarray | None:
    """Return the weighted squared error of each point by a fit to the others, shape (n,); None if one fails.

    The fits to the others start where the fit to all has ended.
    """
    model = solution.model
    errors = np.empty(data.frequency.size)
    places = np.arange(data.frequency.size)
    for fold in range(FOLDS):
        out = places[fold::FOLDS]
        p, converged = descend(model, data.at(np.setdiff1d(places, out)), solution.p)
        if not converged:
            return None
        held = data.at(out)
        error = held.error(model.log_response(p, held.s))
        errors[out] = np.sum(held.stacked(error).reshape(held.parts, -1) ** 2, axis=0)
    return errors


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
            f"modal_fit: the response does not tell {counted(model.modes, 'mode')}: the last one improves the fit no "
            f"more than noise does; ask for {fewer.model.modes} or fewer, or leave 'modes' out"
        )
    return solution
