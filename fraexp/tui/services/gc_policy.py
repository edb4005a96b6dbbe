"""When garbage is collected: full rounds look at all there is, which takes tenths of a second that keys would wait."""

import gc
import time

QUIET = 1.0
"""Seconds without a key after which nobody is typing."""
FIRST, NEVER = 20_000, 1_000_000
"""New objects, and rounds over those, after which a round is made."""


def put_off() -> None:
    """Leave full rounds to `Collector`; they cost the start a quarter of a second, too."""
    gc.set_threshold(FIRST, 10, NEVER)


class Collector:
    """Full rounds while nobody types."""

    def __init__(self) -> None:
        self._typed = 0.0

    def typed(self) -> None:
        """Take notice of a key."""
        self._typed = time.monotonic()

    def look(self) -> None:
        """Make a round, if nobody is typing."""
        if time.monotonic() - self._typed > QUIET:
            gc.collect()
