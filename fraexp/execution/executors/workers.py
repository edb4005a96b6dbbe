"""What an executor is to the scheduler: workers that take jobs and answer."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from concurrent.futures import Future
from typing import Self

from fraexp.data.results import Result
from fraexp.execution.job import Failure, Job

Answer = list[Result | Failure]
"""What came out of a job: a result or a failure per estimator, in their order."""


class WorkerLostError(Exception):
    """A worker died, or was ended, in the middle of a job; the text is the reason, for people."""

    def __init__(self, reason: str, *, estimator: int | None = None, again: bool = True) -> None:
        super().__init__(reason)
        self.estimator = estimator
        """Which of the job's estimators was at work; None in the experiment, or if it is not known."""
        self.again = again
        """Whether trying again may help: not where a limit was reached."""


class Workers(ABC):
    """Workers that compute jobs; a context manager that leaves nothing running.

    Everything is called by one thread. A lost worker costs the one job that it was computing, whose future then has a
    WorkerLostError; all others go on. A FraexpError from any method ends the run: nothing can be computed any more.
    """

    count: int
    """How many jobs are computed at once. It may change while workers come and go."""

    @abstractmethod
    def submit(self, number: int, job: Job) -> "Future[Answer]":
        """Start a job as soon as a worker is free; its progress is reported under `number`."""

    @abstractmethod
    def reports(self) -> Iterator[tuple[int, float]]:
        """Yield the number and the fraction done of jobs that have told it since the last call; called often."""

    def compiles(self) -> Iterator[tuple[int, str]]:
        """Yield the number of each job that began to compile since the last call, and its laws; called often."""
        yield from ()

    def notes(self) -> Iterator[str]:
        """Yield what people should know of the workers, such as one that is left out; called often."""
        yield from ()

    @abstractmethod
    def stop(self) -> None:
        """Give up what is running and pending, at once."""

    @abstractmethod
    def close(self) -> None:
        """End the workers, which have nothing to do any more."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        if exception[0] is None:
            self.close()
        else:
            self.stop()
