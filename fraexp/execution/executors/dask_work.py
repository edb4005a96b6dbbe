"""The work for a Dask cluster: submitted jobs, in batches whose size follows from the duration of jobs."""

import asyncio
import math
import pickle
import queue
import time
from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, field

from fraexp.execution.executors.dask_check import merge_requirements
from fraexp.execution.executors.dask_remote import BatchAnswer, Requirements
from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import Answer, WorkerLostError
from fraexp.execution.job import Job

BATCH_DURATION_S = 0.5
"""Approximate work that is sent at a time: far more than a message takes, and little to lose."""
MAX_DEPARTURES = 5
"""Workers that may leave the cluster during a job before the job counts as the reason."""
GATHER_DELAY_S = 0.01
"""Time to wait for further short jobs of a batch, which are submitted one by one."""
MAX_COPIES = 3
"""Maximum number of places at which a job waits or is computed: it may itself be what silences its workers."""


@dataclass(eq=False)
class ClusterTask:
    """A submitted job."""

    number: int
    job: Job
    requirements: Requirements
    future: "Future[Answer]" = field(default_factory=Future)
    is_alone: bool = False
    """Whether it is sent alone, because a worker was lost with a batch that contained it."""
    departures: int = 0
    """Number of workers that left the cluster while they computed it."""
    copies: int = 1
    """Number of places at which it waits or is computed: the queue and batches."""


@dataclass(eq=False)
class Batch:
    """Tasks that are sent together."""

    tasks: list[ClusterTask]
    sent: float = field(default_factory=time.monotonic)
    """Time at which it was taken to be sent [s]."""
    is_sent_again: bool = False
    """Whether its tasks were queued again, because its worker is silent."""
    began: float | None = None
    """Time at which the worker reported the start [s]; None before."""

    @property
    def is_settled(self) -> bool:
        """Whether all its tasks have an answer, from wherever."""
        return all(task.future.done() for task in self.tasks)

    def payload(self, process: str) -> bytes:
        """Return the pickled message that sends the batch to a process."""
        requirements = merge_requirements([task.requirements for task in self.tasks])
        return pickle.dumps((process, [task.job for task in self.tasks], requirements), pickle.HIGHEST_PROTOCOL)

    def note_departure(self) -> bool:
        """Note that a worker left the cluster during the batch, and return whether that may be a coincidence."""
        for task in self.tasks:
            task.departures += 1
        return all(task.departures <= MAX_DEPARTURES for task in self.tasks)

    def is_overdue(self, limits: ResourceLimits) -> bool:
        """Return whether the batch has exceeded the time limit."""
        limit = limits.time * max(len(task.job.estimators) for task in self.tasks)
        return self.began is not None and time.monotonic() - self.began > limit


class ClusterWork:
    """Tasks that wait, and their answers; the first answer of a task counts.

    Used in one event loop, except for the queues of reports.
    """

    def __init__(self) -> None:
        self.reports: queue.SimpleQueue[tuple[int, float]] = queue.SimpleQueue()
        self.compilations: queue.SimpleQueue[tuple[int, str]] = queue.SimpleQueue()
        self.open = 0
        """Number of tasks without an answer."""
        self._waiting: deque[ClusterTask] = deque()
        self._arrived = asyncio.Event()
        self._job_seconds = math.inf
        """Approximate duration of a job [s]; infinite until it is known."""

    def add(self, task: ClusterTask) -> None:
        """Add a task."""
        self.open += 1
        self._waiting.append(task)
        self._arrived.set()

    async def take(self, sharers: int) -> Batch:
        """Wait for tasks and return the next batch: a fair share of the waiting tasks, limited by their duration."""
        while True:
            while not self._has_waiting():
                self._arrived.clear()
                await self._arrived.wait()
            if self._job_seconds < BATCH_DURATION_S:
                await asyncio.sleep(GATHER_DELAY_S)
            if self._has_waiting():
                return self._batch(sharers)

    def _has_waiting(self) -> bool:
        """Return whether a task waits; copies that have been answered elsewhere are dropped."""
        if any(task.future.done() for task in self._waiting):
            self._waiting = deque(task for task in self._waiting if not task.future.done())
        return bool(self._waiting)

    def _batch(self, sharers: int) -> Batch:
        fair = math.ceil(len(self._waiting) / max(sharers, 1))
        size = max(min(int(BATCH_DURATION_S / max(self._job_seconds, 1e-6)), fair), 1)
        tasks = [self._waiting.popleft()]
        while self._waiting and len(tasks) < size and not (tasks[0].is_alone or self._waiting[0].is_alone):
            tasks.append(self._waiting.popleft())
        return Batch(tasks)

    def note_progress(self, batch: Batch, place: int, done: float | None, compiling: str) -> None:
        """Note what a worker reports: progress of a job, or the laws that it begins to compile; none when it ends."""
        if batch.began is None:
            batch.began = time.monotonic()
        if done is None:
            self.compilations.put((batch.tasks[place].number, compiling))
        else:
            self.reports.put((batch.tasks[place].number, done))

    def answer(self, batch: Batch, done: BatchAnswer) -> None:
        """Resolve the tasks that have an answer, and queue the others again."""
        count = len(done.answers)
        if count:
            each = done.seconds / count
            self._job_seconds = (
                each if math.isinf(self._job_seconds) else self._job_seconds + 0.3 * (each - self._job_seconds)
            )
        for task, answer in zip(batch.tasks, done.answers, strict=False):
            self._settle(task, answer)
        self.give_back(Batch(batch.tasks[count:]))

    def send_again(self, batch: Batch) -> None:
        """Queue the tasks of a batch for other workers, while its own worker keeps it: the first answer counts."""
        if batch.is_sent_again:
            return
        batch.is_sent_again = True
        again = [task for task in batch.tasks if not task.future.done() and task.copies < MAX_COPIES]
        for task in again:
            task.copies += 1
        self._queue_first(again)

    def give_back(self, batch: Batch) -> None:
        """Queue tasks again that are not to blame."""
        self._queue_first(self._drop_copies(batch))

    def lose(self, batch: Batch, why: WorkerLostError) -> None:
        """Note that a worker was lost: a single task fails with the reason, several are tried one by one.

        A task that waits or is computed elsewhere, too, is neither: that decides.
        """
        left = self._drop_copies(batch)
        if len(batch.tasks) == 1:
            for task in left:
                self._settle(task, why)
            return
        for task in left:
            task.is_alone = True
        self._queue_first(left)

    def _drop_copies(self, batch: Batch) -> list[ClusterTask]:
        """Return the tasks of a batch, which has ended, that are neither answered nor anywhere else."""
        for task in batch.tasks:
            task.copies -= 1
        left = [task for task in batch.tasks if task.copies <= 0 and not task.future.done()]
        for task in left:
            task.copies = 1
        return left

    def _queue_first(self, tasks: list[ClusterTask]) -> None:
        self._waiting.extendleft(reversed(tasks))
        self._arrived.set()

    def _settle(self, task: ClusterTask, answer: Answer | WorkerLostError) -> None:
        if task.future.done():
            return
        self.open -= 1
        if isinstance(answer, WorkerLostError):
            task.future.set_exception(answer)
        else:
            task.future.set_result(answer)
