"""A job in a thread of its own, which is left behind if it takes too long or hangs in compiled code.

Python cannot stop such a thread.
"""

import queue
import threading
import time
from math import inf
from typing import NamedTuple

from fraexp.data.results import Result
from fraexp.execution.job import ReportCompilation, ReportEstimator, ReportProgress, run_job
from fraexp.execution.sent_jobs import Failure, Job
from fraexp.kernels.call_watch import hang_listener


class JobCancelled(BaseException):
    """Raised in a running job to stop it; it is not an error of the job."""


class JobEnd(NamedTuple):
    """How a job ended: with an answer, or with what it raised."""

    answer: list[Result | Failure]
    error: BaseException | None = None
    hangs: bool = False
    """Whether its thread goes on in a law that never returns; only the end of the process ends it."""
    is_overdue: bool = False
    """Whether it exceeded its time limit; its thread goes on until it reports the next time."""
    estimator: int | None = None
    """Index of the estimator that exceeded it; None for the experiment."""


def run_watched_job(
    job: Job, progress: ReportProgress, begins: ReportEstimator, compiles: ReportCompilation, limit: float = inf
) -> JobEnd:
    """Return how a job ended: as `run_job` does, or with the same failure of all estimators if a law hangs.

    The experiment with its first estimator, and each further estimator, may take `limit` [s].
    """
    told: queue.SimpleQueue[JobEnd | int] = queue.SimpleQueue()
    given_up = threading.Event()

    def report(done: float) -> None:
        if given_up.is_set():
            raise JobCancelled
        progress(done)

    def begin_estimator(number: int) -> None:
        if given_up.is_set():
            raise JobCancelled
        begins(number)
        told.put(number)

    def run() -> None:
        try:
            with hang_listener(lambda text: told.put(JobEnd([Failure(text, "")] * len(job.estimators), hangs=True))):
                told.put(JobEnd(run_job(job, report, begin_estimator, compiles)))
        except BaseException as error:  # such as a plugin's sys.exit(), or the end of a job that is cancelled
            told.put(JobEnd([], error))

    threading.Thread(target=run, name="fraexp job", daemon=True).start()
    deadline, estimator = time.monotonic() + limit, None
    while True:
        try:
            found = told.get(timeout=None if limit == inf else max(deadline - time.monotonic(), 0.0))
        except queue.Empty:
            given_up.set()
            return JobEnd([], is_overdue=True, estimator=estimator)
        if isinstance(found, JobEnd):
            return found
        estimator = found
        deadline = time.monotonic() + limit if found > 0 else deadline
