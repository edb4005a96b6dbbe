"""Waiting for what must come: the time only bounds a hang, on the slowest machine; no test checks it."""

import time
from collections.abc import Callable
from typing import TypeVar

Answer = TypeVar("Answer")
HANG_TIMEOUT_S = 120.0
POLL_INTERVAL_S = 0.05


def wait_until(condition: Callable[[], Answer]) -> Answer:
    """Return the condition's value as soon as it is true."""
    deadline = time.monotonic() + HANG_TIMEOUT_S
    while not (answer := condition()):
        assert time.monotonic() < deadline, "it does not come"
        time.sleep(POLL_INTERVAL_S)
    return answer
