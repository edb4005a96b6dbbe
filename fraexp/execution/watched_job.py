"""A job in a thread of its own, which is left behind if a friction law hangs in compiled code.

Such code cannot be interrupted.
"""

import queue
import threading
from typing import NamedTuple

from fraexp.data.results import Result
from fraexp.execution.job import Failure, Job, ReportCompilation, ReportEstimator, ReportProgress, run_job
from fraexp.kernels.call_watch import hang_listener


class JobEnd(NamedTuple):
    """How a job ended: with an answer, or with what it raised."""

    answer: list[Result | Failure]
    error: BaseException | None = None
    hangs: bool = False
    """Whether its thread goes on in a law that never returns; only the end of the process ends it."""


def run_watched_job(job: Job, progress: ReportProgress, begins: ReportEstimator, compiles: ReportCompilation) -> JobEnd:
    """Return how a job ended: as `run_job` does, or with the same failure of all estimators if a law hangs."""
    ends: queue.SimpleQueue[JobEnd] = queue.SimpleQueue()

    def run() -> None:
        try:
            with hang_listener(lambda text: ends.put(JobEnd([Failure(text, "")] * len(job.estimators), hangs=True))):
                ends.put(JobEnd(run_job(job, progress, begins, compiles)))
        except BaseException as error:  # such as a plugin's sys.exit(), or the end of a job that is cancelled
            ends.put(JobEnd([], error))

    threading.Thread(target=run, name="fraexp job", daemon=True).start()
    return ends.get()
