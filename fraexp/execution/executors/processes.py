"""Jobs in processes of their own, each with its pipes: when one dies it is known which job it was at."""

import itertools
import multiprocessing
import os
import pickle
import queue
import signal
import threading
import time
import warnings
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from fraexp.errors import StudyError
from fraexp.execution.executors.limits import ResourceLimits, size_text
from fraexp.execution.executors.worker import At, Ready, work
from fraexp.execution.executors.workers import Answer, WorkerLostError, Workers
from fraexp.execution.job import Job

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Set to 1 for workers: their number is the parallelism, and sums keep their order."""
SPAWN = multiprocessing.get_context("spawn")
"""A fork would inherit the database's connection."""
IN_PIPE = 8
"""Jobs that wait in a worker's pipe, at most: short ones must not wait for the next."""
BYTES_IN_PIPE = 12_000
"""Bytes of them, at most: a pipe that is never full never blocks."""
SHORT = 0.02
"""Seconds of a job that is short."""
STILLBORN = 3
"""Workers in a row that die before they are ready, at most."""
PATIENCE = 2.0
"""Seconds for workers to end by themselves."""
# Python's tracker of shared memory, of which there is none here, is started again without a word where it was killed.
warnings.filterwarnings("ignore", "resource_tracker: process died unexpectedly")


@dataclass(eq=False)
class _Task:
    """A job on its way."""

    number: int
    sent: bytes
    future: "Future[Answer]" = field(default_factory=Future)


@dataclass(eq=False)
class _Worker:
    """A process with its pipes, and the tasks that were sent to it: the first is at work."""

    process: BaseProcess
    jobs: Connection
    told: Connection
    ready: bool = False
    tasks: deque[_Task] = field(default_factory=deque)
    since: float = 0.0
    """When the first task, or its present estimator, began."""
    began: float = 0.0
    estimator: int | None = None
    overdue: bool = False

    def begin(self) -> None:
        """Note that the first task begins now."""
        self.since = self.began = time.monotonic()
        self.estimator = None


class Processes(Workers):
    """A fixed number of processes; one that dies is replaced. A thread sends them jobs and hears what they say."""

    def __init__(self, count: int, limits: ResourceLimits) -> None:
        self.count = count
        self._limits = limits
        self._workers: list[_Worker] = []
        self._waiting: deque[_Task] = deque()
        self._told: queue.SimpleQueue[tuple[int, float]] = queue.SimpleQueue()
        self._compiles: queue.SimpleQueue[tuple[int, str]] = queue.SimpleQueue()
        self._heard, self._wake = SPAWN.Pipe(duplex=False)
        self._lock = threading.Lock()
        """Held where workers are added or all of them ended, and where the thread is woken."""
        self._woken = self._stopped = self._closing = False
        self._stillborn = 0
        self._seconds = 1.0
        """What a job takes, about."""
        self._broken = ""
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        task = _Task(number, pickle.dumps(job, pickle.HIGHEST_PROTOCOL))
        self._waiting.append(task)
        self._call()
        return task.future

    def reports(self) -> Iterator[tuple[int, float]]:
        if self._broken:
            raise StudyError(self._broken)
        while not self._told.empty():
            yield self._told.get()

    def compiles(self) -> Iterator[tuple[int, str]]:
        while not self._compiles.empty():
            yield self._compiles.get()

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            for worker in self._workers:
                worker.process.kill()
        self._call()
        self._thread.join(PATIENCE)

    def close(self) -> None:
        self._closing = True
        self._call()
        self._thread.join()

    def _call(self) -> None:
        with self._lock:
            if not self._woken:
                self._woken = True
                self._wake.send_bytes(b"!")

    def _serve(self) -> None:
        """Send and hear until there is nothing more to come; this is the thread."""
        try:
            while not (self._stopped or self._broken or (self._closing and self._idle())):
                self._hear(wait(self._ears(), self._time_left()))
                self._end_overdue()
                self._fill()
        except Exception as error:  # it must not be waited for in vain
            self._broken = f"the worker processes cannot be served: {type(error).__name__}: {error}"
        self._dismiss()

    def _idle(self) -> bool:
        return not (self._waiting or any(worker.tasks for worker in self._workers))

    def _ears(self) -> list[Any]:
        both = itertools.chain.from_iterable((worker.told, worker.process.sentinel) for worker in self._workers)
        return [self._heard, *both]

    def _time_left(self) -> float | None:
        """Return the time until the first worker reaches the limit."""
        times = [worker.since for worker in self._workers if worker.tasks and worker.ready]
        if not times or self._limits.time == float("inf"):
            return None
        return max(min(times) + self._limits.time - time.monotonic(), 0.0) + 0.01

    def _hear(self, found: Iterable[Any]) -> None:
        spoken = set(found)
        if self._heard in spoken:
            with self._lock:
                self._heard.recv_bytes()
                self._woken = False
        for worker in list(self._workers):
            gone = worker.process.sentinel in spoken
            if worker.told in spoken or gone:
                try:
                    while worker.told.poll():  # also what was said before dying
                        self._take(worker, worker.told.recv())
                except (EOFError, OSError, pickle.UnpicklingError):
                    gone = True
                if gone:
                    self._bury(worker)

    def _take(self, worker: _Worker, said: Any) -> None:
        if isinstance(said, Ready):
            worker.ready = True
            self._stillborn = 0
        elif isinstance(said, At) and said.compiles:
            self._compiles.put((worker.tasks[0].number, said.compiles))
        elif isinstance(said, At):
            self._told.put((worker.tasks[0].number, said.done))
            if said.estimator is not None:
                worker.estimator = said.estimator
                worker.since = time.monotonic() if said.estimator else worker.since
        else:
            task = worker.tasks.popleft()
            self._seconds += 0.2 * (time.monotonic() - worker.began - self._seconds)
            task.future.set_result(said)
            if worker.tasks:
                self._begin(worker)

    def _begin(self, worker: _Worker) -> None:
        worker.begin()
        self._told.put((worker.tasks[0].number, 0.0))

    def _end_overdue(self) -> None:
        for worker in self._workers:
            if worker.tasks and worker.ready and time.monotonic() - worker.since > self._limits.time:
                worker.overdue = True
                worker.process.kill()

    def _bury(self, worker: _Worker) -> None:
        """Tell of the job that a worker was at, and give its others to the next one."""
        self._workers.remove(worker)
        worker.process.join(PATIENCE)  # its pipes are closed some time before it is gone
        worker.process.kill()
        worker.process.join()
        reason = self._limits.overdue() if worker.overdue else _why(worker.process, self._limits.memory)
        worker.jobs.close()
        worker.told.close()
        if not worker.ready:
            self._stillborn += 1
            if self._stillborn >= STILLBORN:
                self._broken = f"no worker process can start: {reason}"
        if worker.tasks:
            culprit = worker.tasks.popleft()
            self._waiting.extendleft(reversed(worker.tasks))
            lost = WorkerLostError(reason, estimator=worker.estimator, again=not worker.overdue)
            culprit.future.set_exception(lost)

    def _fill(self) -> None:
        """Start what workers are needed, and send them what waits: first to those that have nothing to do."""
        while len(self._workers) < self.count and self._wanted() and not (self._stopped or self._broken):
            self._start()
        for worker in sorted(self._workers, key=lambda worker: len(worker.tasks)):
            while self._waiting and worker.ready and self._has_room(worker):
                self._send(worker, self._waiting.popleft())

    def _wanted(self) -> bool:
        free = sum(not worker.tasks for worker in self._workers)
        return len(self._waiting) > free

    def _has_room(self, worker: _Worker) -> bool:
        if not worker.tasks:
            return True
        room = self._seconds < SHORT and len(worker.tasks) < IN_PIPE
        return room and sum(len(task.sent) for task in [*worker.tasks, self._waiting[0]]) < BYTES_IN_PIPE

    def _send(self, worker: _Worker, task: _Task) -> None:
        with suppress(OSError):  # it has died; that will be heard next
            worker.jobs.send_bytes(task.sent)
        worker.tasks.append(task)
        if len(worker.tasks) == 1:
            self._begin(worker)

    def _start(self) -> None:
        theirs, jobs = SPAWN.Pipe(duplex=False)
        told, to_us = SPAWN.Pipe(duplex=False)
        process = SPAWN.Process(target=work, args=(theirs, to_us, self._limits.memory), name="fraexp worker")
        with self._lock:
            if self._stopped:
                return
            with _one_thread_each():
                process.start()
            self._workers.append(_Worker(process, jobs, told))
        theirs.close()
        to_us.close()

    def _dismiss(self) -> None:
        """End all workers: those that have nothing to do by themselves."""
        for worker in self._workers:
            worker.jobs.close()
        deadline = time.monotonic() + (0.0 if self._stopped or self._broken else PATIENCE)
        for worker in self._workers:
            worker.process.join(max(deadline - time.monotonic(), 0.0))
            worker.process.kill()
            worker.process.join()


def _why(process: BaseProcess, memory: int | None) -> str:
    """Return how a process ended."""
    code = process.exitcode or 0
    if code >= 0:
        return f"its worker exited with code {code}"
    cap = f"; it may have {size_text(memory)} of memory, see --memory" if memory else ""
    if -code == signal.SIGKILL and not cap:
        cap = ", as a system does that is out of memory"
    return f"its worker was killed by signal {-code} ({_name(-code)}){cap}"


def _name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return "unnamed"


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Have a process that starts meanwhile compute with one thread."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
