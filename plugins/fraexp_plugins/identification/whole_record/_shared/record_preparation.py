"""What a record needs beside the motion of the model: the pull towards it, a start of its own, and a drift."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Replayed, ReplayModel
from fraexp_plugins.identification.whole_record._shared.record_start import start_terms
from fraexp_plugins.identification.whole_record._shared.replayed_record import ReplayedRecord, Trial, replays_of

MAX_WEAK_RATIO = 1.1
"""What is left of a record with a weak pull over what a strong one leaves, above which the model drifts."""


def prepared_records(
    records: Sequence[ReplayedRecord], model: ReplayModel, own: Sequence[NDArray[np.float64]]
) -> list[ReplayedRecord]:
    """Return records with what they need where a model has been found, with the own parameters of each, shape (m,).

    A strong pull takes noise of the record into the model, of which the likelihood knows nothing: the bands of some
    frequencies are then too narrow by a quarter. The pull is weak where the model settles with it and does not drift.
    """
    weak = [replace(record, is_weakly_pulled=True) for record in records]
    of_strong, of_weak = (
        replays_of([Trial(record, model, values) for record, values in zip(pulled, own, strict=True)])
        for pulled in (records, weak)
    )
    pulled = [
        (b, y.position) if _is_held(a, x, y) else (a, x.position)
        for a, b, x, y in zip(records, weak, of_strong, of_weak, strict=True)
    ]
    starts = start_terms([record for record, _ in pulled], model, own)
    pairs = zip(pulled, starts, strict=True)
    return [replace(record, starts=start).with_needed_drift(position) for (record, position), start in pairs]


def _is_held(record: ReplayedRecord, strong: Replayed, weak: Replayed) -> bool:
    """Return whether a weak pull leaves hardly more of a record than a strong one, and the model settles as well."""
    allowed = MAX_WEAK_RATIO**2 * record.scatter_about(strong.position)
    return weak.is_settled >= strong.is_settled and record.scatter_about(weak.position) <= allowed < np.inf
