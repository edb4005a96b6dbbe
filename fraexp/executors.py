"""Where jobs run: in this process, or in a pool of processes; both are `concurrent.futures` executors."""

import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from typing import Any

from fraexp.errors import StudyError, did_you_mean
from fraexp.perform import Failure, Job, perform
from fraexp.results import Result

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 for workers: their number is the parallelism, and sums keep their order."""

MOST_WORKERS = 512
SPAWN = multiprocessing.get_context("spawn")
"""A fork would inherit the database's connection."""
Answer = list[Result | Failure]


class Cancelled(BaseException):
    """Raised in a running job to end it: not an error of the job."""


class Workers:
    """An executor with the progress that its jobs report; a context manager that leaves nothing running."""

    def __init__(self, name: str, jobs: int) -> None:
        self.count = min(workers_of(name), max(jobs, 1))
        self._threaded = name == "serial"
        self._stopped = False
        if self._threaded:
            self._reports: Any = queue.SimpleQueue()
        else:
            for variable in ONE_THREAD:
                os.environ.setdefault(variable, "1")
            self._reports = SPAWN.SimpleQueue()
        self._pool = self._fresh()

    def _fresh(self) -> Executor:
        if self._threaded:
            return ThreadPoolExecutor(1)
        return ProcessPoolExecutor(self.count, SPAWN, _start, (self._reports,))

    def renew(self) -> None:
        """Replace a pool that is of no use any more because one of its processes died."""
        self._pool.shutdown(wait=False)
        self._pool = self._fresh()

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        """Start a job when a worker is free; its progress is reported under `number`."""
        if isinstance(self._pool, ThreadPoolExecutor):
            return self._pool.submit(perform, job, lambda done: self._here(number, done))
        return self._pool.submit(_there, number, job)

    def reports(self) -> Iterator[tuple[int, float]]:
        """Yield the number and the fraction done of jobs that have reported since the last call."""
        while not self._reports.empty():
            yield self._reports.get()

    def stop(self) -> None:
        """Give up what is running and pending, at once."""
        self._stopped = True
        processes = list((getattr(self._pool, "_processes", None) or {}).values())
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()

    def __enter__(self) -> "Workers":
        return self

    def __exit__(self, *exception: object) -> None:
        if exception[0] is None:
            self._pool.shutdown()
        else:
            self.stop()

    def _here(self, number: int, done: float) -> None:
        if self._stopped:
            raise Cancelled
        self._reports.put((number, done))


def workers_of(name: str) -> int:
    """Return how many jobs an executor such as ``serial`` or ``processes:4`` runs at once; StudyError for others."""
    kind, _, number = name.partition(":")
    if kind == "serial" and not number:
        return 1
    if kind != "processes":
        raise StudyError(f"there is no executor '{name}'{did_you_mean(kind, ('serial', 'processes'))}")
    if number and (not number.isdecimal() or not 1 <= int(number) <= MOST_WORKERS):
        raise StudyError(f"executor '{name}': expected a number from 1 to {MOST_WORKERS}, such as processes:4")
    return int(number) if number else usable_cores()


def usable_cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_worker: dict[str, Any] = {}
"""In a worker process: where it reports progress. Filled once, when the process starts."""


def _start(reports: Any) -> None:
    _worker["reports"] = reports
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the scheduler, which then ends its workers
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when its scheduler is gone, however that died."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _there(number: int, job: Job) -> Answer:
    return perform(job, lambda done: _worker["reports"].put((number, done)))
