"""How often a screen that shows a run may be drawn again: the run needs the processors."""

import time

MAX_REST_S = 60.0
"""Longest rest."""
MAX_FIRST_REST_S = 10.0
"""Longest rest after the first turn, which also imports what it needs."""


class RefreshBudget:
    """Bounds the processor time of repeated work to a share of the time, by a rest after each turn."""

    def __init__(self, share: float) -> None:
        self._share = share
        self._began: float | None = None
        self._rest_until = 0.0
        self._longest_rest = MAX_FIRST_REST_S

    @property
    def is_resting(self) -> bool:
        """Whether another turn would take more than the share."""
        return time.monotonic() < self._rest_until

    def begin(self) -> None:
        """Note that a turn begins."""
        self._began = time.process_time()

    def end(self) -> None:
        """Note that a turn is done, with all that it made the process do."""
        if self._began is not None:
            rest = (time.process_time() - self._began) / self._share
            self._rest_until = time.monotonic() + min(rest, self._longest_rest)
            self._began, self._longest_rest = None, MAX_REST_S
