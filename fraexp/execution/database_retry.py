"""Calls of the database that are tried again until it is available: a server restarts, another process holds a lock."""

import queue
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import TypeVar

from fraexp.errors import UnavailableError
from fraexp.execution.events import Event, Noticed, Progress
from fraexp.execution.executors.limits import DEFAULT_DATABASE_TIMEOUT_S

FIRST_PAUSE_S = 0.2
"""Time between the first failure and the second attempt; each further pause is twice as long."""
MAX_PAUSE_S = 5.0
"""Maximum time between two attempts."""
WAITING_TEXT = "waiting for the database"
Found = TypeVar("Found")
Pause = Callable[[float], Iterator[Event]]
"""Lets some time [s] pass, and yields what happens meanwhile."""


class Clock:
    """Time as the scheduler measures it; another one simulates it."""

    def now(self) -> float:
        """Return the time [s] since any fixed moment."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for some time [s]."""
        time.sleep(seconds)

    def next_item(self, items: "queue.SimpleQueue[Found]", timeout: float) -> Found:
        """Return the next item of a queue; queue.Empty if there is none within the timeout [s]."""
        return items.get(timeout=timeout)


@dataclass
class DatabaseRetry:
    """Calls the database again, with growing pauses, while it is unavailable."""

    clock: Clock = field(default_factory=Clock)
    timeout: float = DEFAULT_DATABASE_TIMEOUT_S
    """Time after which the run is given up [s]."""

    def call(self, attempt: Callable[[], Found], pause: Pause | None = None) -> Generator[Event, None, Found]:
        """Yield events while the database is unavailable, and return the answer; UnavailableError after the timeout.

        A call whose answer is lost is repeated as well: it must take effect once however often it is made.
        """
        began, seconds = self.clock.now(), FIRST_PAUSE_S
        while True:
            try:
                found = attempt()
            except UnavailableError as error:
                waited = self.clock.now() - began
                if waited + seconds > self.timeout:
                    raise UnavailableError(
                        f"{error} (waited {waited:.0f} s for the database, see --database-timeout)"
                    ) from error
                if seconds == FIRST_PAUSE_S:
                    yield Noticed(f"{WAITING_TEXT}: {error}")
                yield from (pause or self._pause)(seconds)
                seconds = min(2 * seconds, MAX_PAUSE_S)
            else:
                if seconds > FIRST_PAUSE_S:
                    yield Noticed(f"the database is available again, after {self.clock.now() - began:.0f} s")
                return found

    def _pause(self, seconds: float) -> Iterator[Event]:
        yield Progress(0.0, 0.0, None, WAITING_TEXT)
        self.clock.sleep(seconds)
