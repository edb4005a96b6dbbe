"""The contract between scheduler and executors: workers that accept jobs and return answers."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Self, TypeVar

from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.execution.sent_jobs import Failure, Job

Item = TypeVar("Item")
Answer = list[Result | Failure]
"""The result or the failure of each estimator of a job, in their order."""


class WorkerLostError(Exception):
    """A worker died, or was killed, during a job; the text is the reason as the user reads it."""

    def __init__(self, reason: str, *, estimator: int | None = None, is_retryable: bool = True) -> None:
        super().__init__(reason)
        self.estimator = estimator
        """Index of the estimator that was running; None during the experiment, or if it is unknown."""
        self.is_retryable = is_retryable
        """Whether a retry may succeed; False if a limit was exceeded."""


class Workers(ABC):
    """Workers that compute jobs; as a context manager, no worker is left running.

    One thread calls all methods. When a worker is lost, only the job that it was computing fails, with a
    WorkerLostError in its future. A FraexpError from any method ends the run: nothing more can be computed.
    """

    count: int
    """Number of jobs that are computed at the same time; it changes when workers come and go, and may be 0."""

    def __init__(self) -> None:
        self._progress: SimpleQueue[tuple[int, float]] = SimpleQueue()
        self._compilations: SimpleQueue[tuple[int, str]] = SimpleQueue()
        self._notes: SimpleQueue[str] = SimpleQueue()
        self._failure: FraexpError | None = None
        """Why nothing more can be computed; None as long as workers go on."""

    @abstractmethod
    def submit(self, number: int, job: Job) -> "Future[Answer]":
        """Send a job to the next free worker; `number` identifies it in `reports` and `compilations`."""

    def reports(self) -> Iterator[tuple[int, float]]:
        """Yield the number of each job that has reported since the last call, and the fraction done; called often."""
        if self._failure:
            raise self._failure
        yield from _drain(self._progress)

    def compilations(self) -> Iterator[tuple[int, str]]:
        """Yield the number of each job that has begun to compile since the last call, and its laws; none at the end."""
        yield from _drain(self._compilations)

    def notes(self) -> Iterator[str]:
        """Yield messages for the user about the workers, such as one that is not used; called often."""
        yield from _drain(self._notes)

    def status(self) -> str:
        """Return what delays the run, such as ``no workers for 20 s``; empty if nothing does; called often."""
        return ""

    @abstractmethod
    def stop(self) -> None:
        """Stop all jobs immediately."""

    @abstractmethod
    def close(self) -> None:
        """End the workers, which have no job left."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        if exception[0] is None:
            self.close()
        else:
            self.stop()


def _drain(items: "SimpleQueue[Item]") -> Iterator[Item]:
    while not items.empty():
        yield items.get()
