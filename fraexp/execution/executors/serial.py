"""Jobs one after another in a thread of this process, which needs no start-up time."""

import queue
import threading
from concurrent.futures import Future

from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import Answer, WorkerLostError, Workers
from fraexp.execution.sent_jobs import Job
from fraexp.execution.watched_job import JobCancelled, run_watched_job


class Serial(Workers):
    """One thread. A job that exceeds its time limit is left behind with its own thread."""

    count = 1

    def __init__(self, limits: ResourceLimits) -> None:
        super().__init__()
        self._limits = limits
        self._tasks: queue.SimpleQueue[tuple[int, Job, Future[Answer]] | None] = queue.SimpleQueue()
        self._is_stopped = False
        self._thread = threading.Thread(target=self._run_jobs, daemon=True)  # the process does not wait for it
        self._thread.start()

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        future: Future[Answer] = Future()
        self._tasks.put((number, job, future))
        return future

    def stop(self) -> None:
        self._is_stopped = True
        self._tasks.put(None)

    def close(self) -> None:
        self._tasks.put(None)
        self._thread.join()

    def _run_jobs(self) -> None:
        while (task := self._tasks.get()) is not None and not self._is_stopped:
            self._run_job(*task)

    def _run_job(self, number: int, job: Job, future: "Future[Answer]") -> None:
        def report_progress(done: float) -> None:
            self._check_stopped()
            self._progress.put((number, done))

        def report_compilation(laws: str) -> None:
            self._check_stopped()
            self._compilations.put((number, laws))

        self._progress.put((number, 0.0))
        limits = self._limits
        end = run_watched_job(job, report_progress, lambda _: self._check_stopped(), report_compilation, limits.time)
        if end.is_overdue:
            reason = limits.overdue_message()
            future.set_exception(WorkerLostError(reason, estimator=end.estimator, is_retryable=False))
        elif end.error is None:
            future.set_result(end.answer)
        elif not isinstance(end.error, JobCancelled):  # such as a plugin's sys.exit()
            future.set_exception(end.error)

    def _check_stopped(self) -> None:
        if self._is_stopped:
            raise JobCancelled
