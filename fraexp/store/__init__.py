"""The database of runs, sweeps and results: one process writes, any number read."""

from fraexp.store.backends.engine import masked_url, url_without_password
from fraexp.store.liveness import Process
from fraexp.store.queries.filters import parse_filter
from fraexp.store.store import Store
from fraexp.store.stored_records import (
    MAX_RUNNING_SHOWN,
    ComponentOrigin,
    Conflict,
    Deletion,
    Likeness,
    ListingPage,
    MergeSummary,
    RunProgress,
    RunSummary,
    StoredState,
    StoredSweep,
    leave_out_damaged,
    mark_damaged,
)

__all__ = [
    "MAX_RUNNING_SHOWN",
    "ComponentOrigin",
    "Conflict",
    "Deletion",
    "Likeness",
    "ListingPage",
    "MergeSummary",
    "Process",
    "RunProgress",
    "RunSummary",
    "Store",
    "StoredState",
    "StoredSweep",
    "leave_out_damaged",
    "mark_damaged",
    "masked_url",
    "parse_filter",
    "url_without_password",
]
