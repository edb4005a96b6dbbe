"""The start of a record that its end does not lead to: where noise goes round a loop, no period repeats another.

A replay is periodic, and goes from the end of a record to its start. The machine came there along a period with other
noise. Its state there, some noise off, acts on the whole record, as an axis that slides keeps an offset; parameters
that have to explain it are wrong by several times their intervals. Pulses of force before the end take the replay to
any other state at the start.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Replay, ReplayModel, replay
from fraexp_plugins.identification.whole_record._shared.replayed_record import START_STATES, ReplayedRecord

PULSE_SHARE = 2e-3
"""A pulse over the greatest control input: small, as its response counts as linear."""
MIN_SAMPLES_PER_PULSE = 10
"""Samples of a record for each pulse, below which it tells too little of its start."""
MIN_SINGULAR_RATIO = 1e-9
"""Least over greatest singular value of responses that are not the same."""
MIN_MOVED_SAMPLES = 10
"""Samples over which a term spreads: what moves fewer are pulses that the dead time brings to the first samples, each
by next to nothing, and several terms of the same few samples cannot be told apart."""


def start_terms(
    records: Sequence[ReplayedRecord], model: ReplayModel, own: Sequence[NDArray[np.float64]]
) -> list[NDArray[np.float64] | None]:
    """Return the positions that other starts of each record cause, shape (terms, n) each; None if it tells too little.

    `own` are the own parameters of each record, shape (m,). The terms are orthogonal where samples count. A record of
    many cycles whose first ones are left out has forgotten its start, and what is left of it would be any number.
    """
    delay = model.input_path[0] + model.output_path[0]
    pulses, coarse = START_STATES + int(np.ceil(delay / model.sample_time)), model.with_coarse_steps()
    long = [
        record.position.size >= MIN_SAMPLES_PER_PULSE * pulses and not record.settled_samples.start
        for record in records
    ]
    runs: list[Replay] = []
    for record, each, is_long in zip(records, own, long, strict=True):
        run = record.replay(coarse, each)
        size = PULSE_SHARE * float(np.abs(run.control_input).max())
        for pulse in size * np.eye(pulses, run.control_input.size, run.control_input.size - pulses) if is_long else ():
            runs += [run._replace(control_input=run.control_input + sign * pulse) for sign in (1, -1)]
    moved = iter([each.position for each in replay(runs)])
    return [_orthogonal([next(moved) - next(moved) for _ in range(pulses)]) if is_long else None for is_long in long]


def _orthogonal(moved: Sequence[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """Return combinations of responses, shape (n,) each, orthogonal and of root mean square 1 before the pulses act.

    There are none if a replay diverges.
    """
    responses = np.array(moved)
    responses = responses - responses[:, :-START_STATES].mean(axis=1, keepdims=True)  # every record has an offset
    counted = responses[:, :-START_STATES]
    if not np.isfinite(responses).all() or not counted.any():
        return None
    turn, sizes, _ = np.linalg.svd(counted, full_matrices=False)
    is_told = sizes > MIN_SINGULAR_RATIO * sizes[0]
    terms = np.sqrt(counted.shape[1]) / sizes[is_told, None] * (turn.T[is_told] @ responses)
    squares = terms[:, :-START_STATES] ** 2
    return np.asarray(terms[squares.sum(axis=1) ** 2 >= MIN_MOVED_SAMPLES * (squares**2).sum(axis=1)])
