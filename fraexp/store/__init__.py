"""The database of runs, sweeps and results: one process writes, any number read."""

from fraexp.store.backends.engine import shown
from fraexp.store.liveness import Process
from fraexp.store.store import Store
from fraexp.store.stored_records import (
    MOST_TOLD,
    Conflict,
    Listed,
    ListingPage,
    Merged,
    RunProgress,
    RunSummary,
    StoredState,
    StoredSweep,
    Supplied,
)

__all__ = [
    "MOST_TOLD",
    "Conflict",
    "Listed",
    "ListingPage",
    "Merged",
    "Process",
    "RunProgress",
    "RunSummary",
    "Store",
    "StoredState",
    "StoredSweep",
    "Supplied",
    "shown",
]
