"""The time of garbage collection: a full collection takes tenths of a second, for which keys would wait."""

import gc
import time

TYPING_PAUSE_S = 1.0
"""Seconds without a key after which the user is not typing."""
ALLOCATION_THRESHOLD, FULL_ROUND_THRESHOLD = 20_000, 1_000_000
"""Allocations until a collection of new objects, and collections until a full one."""


def postpone_full_collections() -> None:
    """Leave full collections to `GarbageCollector`; at the start they would take a quarter of a second."""
    gc.set_threshold(ALLOCATION_THRESHOLD, 10, FULL_ROUND_THRESHOLD)


class GarbageCollector:
    """Full garbage collections while the user is not typing."""

    def __init__(self) -> None:
        self._last_key = 0.0

    def note_key(self) -> None:
        """Note the time of a key."""
        self._last_key = time.monotonic()

    def collect_if_idle(self) -> None:
        """Collect garbage, unless the user is typing."""
        if time.monotonic() - self._last_key > TYPING_PAUSE_S:
            gc.collect()
