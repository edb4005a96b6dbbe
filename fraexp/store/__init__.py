"""The database of runs, sweeps and results: one process writes, any number read."""

from fraexp.store.records import RunSummary, StoredState, StoredSweep, Supplied
from fraexp.store.store import Store

__all__ = ["RunSummary", "Store", "StoredState", "StoredSweep", "Supplied"]
