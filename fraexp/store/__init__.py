"""The database of runs, sweeps and results: one process writes, any number read."""

from fraexp.store.engine import shown
from fraexp.store.liveness import Process
from fraexp.store.records import (
    MOST_TOLD,
    Conflict,
    Listed,
    Merged,
    Page,
    RunProgress,
    RunSummary,
    StoredState,
    StoredSweep,
    Supplied,
)
from fraexp.store.store import Store

__all__ = [
    "MOST_TOLD",
    "Conflict",
    "Listed",
    "Merged",
    "Page",
    "Process",
    "RunProgress",
    "RunSummary",
    "Store",
    "StoredState",
    "StoredSweep",
    "Supplied",
    "shown",
]
