"""Jobs one after another in a thread of this process, which needs no start-up time."""

import queue
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future

from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import Answer, WorkerLostError, Workers
from fraexp.execution.job import Job
from fraexp.execution.watched_job import run_watched_job


class JobCancelled(BaseException):
    """Raised in a running job to stop it; it is not an error of the job."""


class _SerialTask:
    """A submitted job."""

    def __init__(self, number: int, job: Job) -> None:
        self.number, self.job = number, job
        self.future: Future[Answer] = Future()
        self.estimator: int | None = None
        self.since = 0.0
        """Time at which the experiment, or a further estimator, began [s]."""
        self.given_up = False


class Serial(Workers):
    """One thread. A job that exceeds its time limit is abandoned with its thread: Python cannot stop a thread."""

    count = 1

    def __init__(self, limits: ResourceLimits) -> None:
        self._limits = limits
        self._tasks: queue.SimpleQueue[_SerialTask | None] = queue.SimpleQueue()
        self._progress: queue.SimpleQueue[tuple[int, float]] = queue.SimpleQueue()
        self._compilations: queue.SimpleQueue[tuple[int, str]] = queue.SimpleQueue()
        self._current: _SerialTask | None = None
        self._stopped = False
        self._lock = threading.Lock()
        """Held while a job is given up or answered."""
        self._thread = self._start_thread()

    def _start_thread(self) -> threading.Thread:
        thread = threading.Thread(target=self._run_jobs, daemon=True)  # the process does not wait for it at its end
        thread.start()
        return thread

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        task = _SerialTask(number, job)
        self._tasks.put(task)
        return task.future

    def reports(self) -> Iterator[tuple[int, float]]:
        self._give_up_overdue()
        while not self._progress.empty():
            yield self._progress.get()

    def compilations(self) -> Iterator[tuple[int, str]]:
        while not self._compilations.empty():
            yield self._compilations.get()

    def _give_up_overdue(self) -> None:
        task = self._current
        if task is None or time.monotonic() - task.since <= self._limits.time:
            return
        with self._lock:
            if task.future.done():
                return
            task.given_up = True
            self._current = None
            task.future.set_exception(
                WorkerLostError(self._limits.overdue_message(), estimator=task.estimator, is_retryable=False)
            )
        self._thread = self._start_thread()

    def stop(self) -> None:
        self._stopped = True
        self._tasks.put(None)

    def close(self) -> None:
        self._tasks.put(None)
        self._thread.join()

    def _run_jobs(self) -> None:
        while (task := self._tasks.get()) is not None and not self._stopped:
            task.since = time.monotonic()
            self._current = task
            self._progress.put((task.number, 0.0))
            try:
                self._run_job(task)
            except JobCancelled:
                return

    def _run_job(self, task: _SerialTask) -> None:
        def report_progress(done: float) -> None:
            self._check_cancelled(task)
            self._progress.put((task.number, done))

        def report_estimator(estimator: int) -> None:
            self._check_cancelled(task)
            task.estimator = estimator
            if estimator > 0:
                task.since = time.monotonic()

        def report_compilation(laws: str) -> None:
            self._check_cancelled(task)
            self._compilations.put((task.number, laws))

        end = run_watched_job(task.job, report_progress, report_estimator, report_compilation)
        if isinstance(end.error, JobCancelled):
            raise end.error
        with self._lock:
            self._check_cancelled(task)
            if end.error is None:
                task.future.set_result(end.answer)
            else:  # such as a plugin's sys.exit()
                task.future.set_exception(end.error)

    def _check_cancelled(self, task: _SerialTask) -> None:
        if self._stopped or task.given_up:
            raise JobCancelled
