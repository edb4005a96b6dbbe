"""The work that goes to a Dask cluster: jobs on their way, in batches whose size follows from what jobs take."""

import asyncio
import math
import pickle
import queue
import time
from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, field

from fraexp.execution.executors.dask_check import together
from fraexp.execution.executors.dask_remote import Done, Need
from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import Answer, WorkerLostError
from fraexp.execution.job import Job

BATCH = 0.5
"""Seconds of work that are sent at a time, about: so much more than a message takes, and little to be lost."""
LEAVES = 5
"""Workers that may take their leave while they compute a job, until it is taken for the reason."""
GATHER = 0.01
"""Seconds to wait for the other short jobs of a batch, which come one by one."""


@dataclass(eq=False)
class ClusterTask:
    """A job on its way."""

    number: int
    job: Job
    need: Need
    future: "Future[Answer]" = field(default_factory=Future)
    single: bool = False
    """Whether it is sent alone, since a worker was lost with a batch that it was in."""
    left: int = 0
    """Workers that took their leave with it."""


@dataclass(eq=False)
class Batch:
    """Tasks that are sent together."""

    tasks: list[ClusterTask]
    began: float | None = None
    """When the worker said that it begins."""

    def sent(self, process: str) -> bytes:
        """Return what is sent to a process."""
        need = together([task.need for task in self.tasks])
        return pickle.dumps((process, [task.job for task in self.tasks], need), pickle.HIGHEST_PROTOCOL)

    def spared(self) -> bool:
        """Take note that a worker took its leave with it, and say whether it may just have been so."""
        for task in self.tasks:
            task.left += 1
        return all(task.left <= LEAVES for task in self.tasks)

    def overdue(self, limits: ResourceLimits) -> bool:
        """Say whether it takes longer than allowed."""
        most = limits.time * max(len(task.job.estimators) for task in self.tasks)
        return self.began is not None and time.monotonic() - self.began > most


class ClusterWork:
    """What is to be computed, and what becomes of it. But for the queue of reports, used in one event loop."""

    def __init__(self) -> None:
        self.reports: queue.SimpleQueue[tuple[int, float]] = queue.SimpleQueue()
        self.open = 0
        """Tasks that have no answer yet."""
        self._waiting: deque[ClusterTask] = deque()
        self._arrived = asyncio.Event()
        self._each = math.inf
        """Seconds that a job takes, about; infinite until one is known."""

    def add(self, task: ClusterTask) -> None:
        """Take up a task."""
        self.open += 1
        self._waiting.append(task)
        self._arrived.set()

    async def take(self, sharers: int) -> Batch:
        """Return the next tasks, as soon as there are some: a fair share of what waits, unless they are too long."""
        while True:
            while not self._waiting:
                self._arrived.clear()
                await self._arrived.wait()
            if self._each < BATCH:
                await asyncio.sleep(GATHER)
            if self._waiting:
                return self._batch(sharers)

    def _batch(self, sharers: int) -> Batch:
        fair = math.ceil(len(self._waiting) / max(sharers, 1))
        size = max(min(int(BATCH / max(self._each, 1e-6)), fair), 1)
        tasks = [self._waiting.popleft()]
        while self._waiting and len(tasks) < size and not (tasks[0].single or self._waiting[0].single):
            tasks.append(self._waiting.popleft())
        return Batch(tasks)

    def hear(self, batch: Batch, place: int, done: float) -> None:
        """Take note of what a worker says about a batch."""
        if batch.began is None:
            batch.began = time.monotonic()
        self.reports.put((batch.tasks[place].number, done))

    def answer(self, batch: Batch, done: Done) -> None:
        """Hand out what came back; what did not is sent again."""
        count = len(done.answers)
        if count:
            each = done.seconds / count
            self._each = each if math.isinf(self._each) else self._each + 0.3 * (each - self._each)
        for task, answer in zip(batch.tasks, done.answers, strict=False):
            self._settle(task, answer)
        self.give_back(Batch(batch.tasks[count:]))

    def give_back(self, batch: Batch) -> None:
        """Have tasks sent again that nobody is to blame for."""
        self._waiting.extendleft(reversed(batch.tasks))
        self._arrived.set()

    def lose(self, batch: Batch, why: WorkerLostError) -> None:
        """Take note that a worker was lost with a batch: a single task is told of it, others are tried one by one."""
        if len(batch.tasks) == 1:
            self._settle(batch.tasks[0], why)
            return
        for task in batch.tasks:
            task.single = True
        self.give_back(batch)

    def _settle(self, task: ClusterTask, answer: Answer | WorkerLostError) -> None:
        self.open -= 1
        if isinstance(answer, WorkerLostError):
            task.future.set_exception(answer)
        else:
            task.future.set_result(answer)
