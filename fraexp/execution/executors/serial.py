"""Jobs one after another in a thread of this process: nothing has to be started, and a watcher sees it live."""

import queue
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future

from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import Answer, WorkerLostError, Workers
from fraexp.execution.job import Job, perform


class JobCancelled(BaseException):
    """Raised in a running job to end it: not an error of the job."""


class _Task:
    """A job on its way."""

    def __init__(self, number: int, job: Job) -> None:
        self.number, self.job = number, job
        self.future: Future[Answer] = Future()
        self.estimator: int | None = None
        self.since = 0.0
        """When the experiment, or a further estimator, began."""
        self.given_up = False


class Serial(Workers):
    """One thread. A job that goes on beyond its time is left to itself; Python cannot end it, only stop listening."""

    count = 1

    def __init__(self, limits: ResourceLimits) -> None:
        self._limits = limits
        self._tasks: queue.SimpleQueue[_Task | None] = queue.SimpleQueue()
        self._told: queue.SimpleQueue[tuple[int, float]] = queue.SimpleQueue()
        self._compiles: queue.SimpleQueue[tuple[int, str]] = queue.SimpleQueue()
        self._current: _Task | None = None
        self._stopped = False
        self._lock = threading.Lock()
        """Held where a job is given up, or answered."""
        self._thread = self._started()

    def _started(self) -> threading.Thread:
        thread = threading.Thread(target=self._work, daemon=True)  # the process need not wait for it
        thread.start()
        return thread

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        task = _Task(number, job)
        self._tasks.put(task)
        return task.future

    def reports(self) -> Iterator[tuple[int, float]]:
        self._end_overdue()
        while not self._told.empty():
            yield self._told.get()

    def compiles(self) -> Iterator[tuple[int, str]]:
        while not self._compiles.empty():
            yield self._compiles.get()

    def _end_overdue(self) -> None:
        task = self._current
        if task is None or time.monotonic() - task.since <= self._limits.time:
            return
        with self._lock:
            if task.future.done():
                return
            task.given_up = True
            self._current = None
            task.future.set_exception(WorkerLostError(self._limits.overdue(), estimator=task.estimator, again=False))
        self._thread = self._started()

    def stop(self) -> None:
        self._stopped = True
        self._tasks.put(None)

    def close(self) -> None:
        self._tasks.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (task := self._tasks.get()) is not None and not self._stopped:
            task.since = time.monotonic()
            self._current = task
            self._told.put((task.number, 0.0))
            try:
                self._answer(task)
            except JobCancelled:
                return

    def _answer(self, task: _Task) -> None:
        def progress(done: float) -> None:
            self._go_on(task)
            self._told.put((task.number, done))

        def begins(estimator: int) -> None:
            self._go_on(task)
            task.estimator = estimator
            if estimator > 0:
                task.since = time.monotonic()

        def compiles(laws: str) -> None:
            self._go_on(task)
            self._compiles.put((task.number, laws))

        try:
            answer, error = perform(task.job, progress, begins, compiles), None
        except JobCancelled:
            raise
        except BaseException as raised:  # such as a plugin's sys.exit()
            answer, error = [], raised
        with self._lock:
            self._go_on(task)
            if error is None:
                task.future.set_result(answer)
            else:
                task.future.set_exception(error)

    def _go_on(self, task: _Task) -> None:
        if self._stopped or task.given_up:
            raise JobCancelled
