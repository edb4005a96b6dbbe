"""How far the steps of a replay, and what it leaves of its transient, may falsify what is fitted to it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.whole_record._shared.record_fit import LinearisedFit, RecordFit, State
from fraexp_plugins.identification.whole_record._shared.replayed_record import Trial, positions_of

STEPS_FACTOR = 2
"""Factor on the steps of the finer replay."""
LARGEST_ERROR_RATIO = 2.0
"""Error of the coarser replay over the difference to the finer one, of a law with events: it falls with the step."""


class ReplayError(NamedTuple):
    """Changes that a finer replay would cause."""

    shared: NDArray[np.float64]
    """Those of the shared parameters, shape (p,)."""
    inverse: tuple[NDArray[np.float64], ...]
    """Magnitude of those of 1/P̂, relative, shape (lines,) each."""


def replay_error(
    fit: RecordFit, state: State, linear: LinearisedFit, shared: NDArray[np.float64] | None = None
) -> ReplayError:
    """Return how far parameters and 1/P̂ may be off: by one Newton step towards a finer replay.

    `shared` is the error of the prior of the shared parameters, which the same replay caused.
    """
    finer = fit.with_more_steps(STEPS_FACTOR)
    model = finer.free.applied_to(finer.start, state.shared)
    trials = [Trial(record, model.replay, own) for record, own in zip(fit.records, state.own, strict=True)]
    positions = positions_of(trials)
    pairs = zip(linear.records, fit.records, state.own, positions, strict=True)
    moved = [each._replace(residual=record.residual(own, position)) for each, record, own, position in pairs]
    after = fit.newton_step(moved, np.zeros(state.shared.size) if shared is None else shared)
    inverse = []
    for place, (record, own, position) in enumerate(zip(fit.records, state.own, positions, strict=True)):
        parameters = np.concatenate([after.shared, after.own[place]])
        direct = record.inverse_response(model, own, position) - linear.inverse[place]
        error = direct + linear.inverse_slopes[place] @ parameters
        inverse.append(LARGEST_ERROR_RATIO * np.abs(error / linear.inverse[place]))
    return ReplayError(LARGEST_ERROR_RATIO * after.shared, tuple(inverse))
