"""How the steps of a replay, and what it leaves of its transient, falsify what is fitted to it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.whole_record._shared.record_fit import LinearisedFit, RecordFit, State
from fraexp_plugins.identification.whole_record._shared.replayed_record import Trial, positions_of

STEPS_FACTOR = 4
"""Factor on the steps of the finer replay."""
REMAINING_SMOOTH, REMAINING_WITH_EVENTS = 2.0 / (STEPS_FACTOR**2 - 1), 1.0 / (STEPS_FACTOR - 1)
"""Error of the finer replay over its difference to the coarser one: twice that of second order, and, for laws with
events, which are not replayed in lanes, that of first order."""


class ReplayError(NamedTuple):
    """Changes by a finer replay, and how much of an error it leaves."""

    shared_change: NDArray[np.float64]
    """Those of the shared parameters, shape (p,)."""
    inverse_change: tuple[NDArray[np.complex128], ...]
    """Those of 1/P̂ of each record [N/m], shape (lines,) each."""
    remaining: float
    """Error that the finer replay may have, over the changes; NaN if it diverges, with changes of 0."""


def replay_error(
    fit: RecordFit, state: State, linear: LinearisedFit, shared: NDArray[np.float64] | None = None
) -> ReplayError:
    """Return how a finer replay changes parameters and 1/P̂: by one Newton step towards its greatest likelihood.

    `shared` is the change of the prior of the shared parameters, to which the same replay leads.
    """
    finer = fit.with_more_steps(STEPS_FACTOR)
    model = finer.free.applied_to(finer.start, state.shared)
    trials = [Trial(record, model.replay, own) for record, own in zip(fit.records, state.own, strict=True)]
    positions = positions_of(trials)
    if not all(np.isfinite(position).all() for position in positions):
        return ReplayError(np.zeros(state.shared.size), tuple(np.zeros_like(each) for each in linear.inverse), np.nan)
    pairs = zip(linear.records, fit.records, state.own, positions, strict=True)
    moved = [each._replace(residual=record.residual(own, position)) for each, record, own, position in pairs]
    after = fit.newton_step(moved, np.zeros(state.shared.size) if shared is None else shared)
    inverse = []
    for place, (record, own, position) in enumerate(zip(fit.records, state.own, positions, strict=True)):
        parameters = np.concatenate([after.shared, after.own[place]])
        direct = record.inverse_response(model, own, position) - linear.inverse[place]
        inverse.append(direct + linear.inverse_slopes[place] @ parameters)
    is_smooth = all(friction.is_vectorisable for friction in model.replay.frictions.values())
    return ReplayError(after.shared, tuple(inverse), REMAINING_SMOOTH if is_smooth else REMAINING_WITH_EVENTS)
