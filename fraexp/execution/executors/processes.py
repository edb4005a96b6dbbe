"""Jobs in worker processes, each with pipes of its own: if one dies, the job that it was computing is known."""

import multiprocessing
import os
import pickle
import signal
import sys
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
from types import ModuleType
from typing import Any

from fraexp.errors import StudyError
from fraexp.execution.executors.limits import ResourceLimits, size_text
from fraexp.execution.executors.worker import Message, serve_jobs
from fraexp.execution.executors.workers import Answer, WorkerLostError, Workers
from fraexp.execution.sent_jobs import Job

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Variables that are 1 in workers: several processes compute in parallel, and sums keep their order."""
HAS_FORK_SERVER = "forkserver" in multiprocessing.get_all_start_methods()
CONTEXT: Any = multiprocessing.get_context("forkserver" if HAS_FORK_SERVER else "spawn")
"""Start method: a fork of this process would inherit its connection to the database. A fork server has none; it loads
what workers need once, in half a second of processor time, and each of them is there at once."""
if HAS_FORK_SERVER:
    CONTEXT.set_forkserver_preload(["fraexp.execution.executors.preloaded"])
MAX_PIPED_JOBS = 8
"""Maximum number of jobs in a worker's pipe: short jobs must not wait for the next one."""
MAX_PIPED_BYTES = 12_000
"""Maximum size of these jobs: a pipe that is never full never blocks."""
SHORT_JOB_S = 0.02
"""Duration below which several jobs are sent at a time."""
MAX_STARTUP_FAILURES = 3
"""Workers in a row that may die before they are ready."""
SHUTDOWN_TIMEOUT_S = 2.0
"""Time in which workers must end by themselves."""
# Python restarts its tracker of shared memory, which is not used here, if it was killed; the warning is of no use.
warnings.filterwarnings("ignore", "resource_tracker: process died unexpectedly")


@dataclass(eq=False)
class _ProcessTask:
    """A submitted job."""

    number: int
    sent: bytes
    future: "Future[Answer]" = field(default_factory=Future)


@dataclass(eq=False)
class _Worker:
    """A process with its pipes and the tasks that were sent to it; it computes the first one."""

    process: BaseProcess
    jobs: Connection
    messages: Connection
    ready: bool = False
    tasks: deque[_ProcessTask] = field(default_factory=deque)
    since: float = 0.0
    """Time at which the first task, or its present estimator, began [s]."""
    began: float = 0.0
    estimator: int | None = None
    overdue: bool = False

    def note_start(self) -> None:
        """Note that the first task begins now."""
        self.since = self.began = time.monotonic()
        self.estimator = None


class Processes(Workers):
    """A fixed number of processes; one that dies is replaced. A thread sends jobs and receives messages."""

    def __init__(self, count: int, limits: ResourceLimits) -> None:
        super().__init__()
        self.count = count
        self._limits = limits
        self._workers: list[_Worker] = []
        self._waiting: deque[_ProcessTask] = deque()
        self._wake_receiver, self._wake_sender = CONTEXT.Pipe(duplex=False)
        self._lock = threading.Lock()
        """Held while a worker is added, all are ended, or the thread is woken."""
        self._is_woken = self._is_stopped = self._is_closing = False
        self._startup_failures = 0
        self._seconds = 1.0
        """Approximate duration of a job."""
        self._thread = threading.Thread(target=self._serve_workers, daemon=True)
        self._thread.start()

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        task = _ProcessTask(number, pickle.dumps(job, pickle.HIGHEST_PROTOCOL))
        self._waiting.append(task)
        self._wake_thread()
        return task.future

    def stop(self) -> None:
        with self._lock:
            self._is_stopped = True
            for worker in self._workers:
                worker.process.kill()
        self._wake_thread()
        self._thread.join(SHUTDOWN_TIMEOUT_S)

    def close(self) -> None:
        self._is_closing = True
        self._wake_thread()
        self._thread.join()

    def _wake_thread(self) -> None:
        with self._lock:
            if not self._is_woken:
                self._is_woken = True
                self._wake_sender.send_bytes(b"!")

    def _serve_workers(self) -> None:
        """Send jobs and receive messages until the end; this is what the thread runs."""
        try:
            while not (self._is_stopped or self._failure or (self._is_closing and self._is_idle())):
                self._receive(wait(self._waitables(), self._time_to_limit()))
                self._kill_overdue()
                self._distribute_tasks()
        except Exception as error:  # nobody must wait in vain
            self._failure = StudyError(f"the worker processes cannot be served: {type(error).__name__}: {error}")
        self._end_workers()

    def _is_idle(self) -> bool:
        return not (self._waiting or any(worker.tasks for worker in self._workers))

    def _waitables(self) -> "list[Connection | int]":
        found: list[Connection | int] = [self._wake_receiver]
        for worker in self._workers:
            found += [worker.messages, worker.process.sentinel]
        return found

    def _time_to_limit(self) -> float | None:
        """Return the time until the first worker reaches the time limit [s]; None if none will."""
        times = [worker.since for worker in self._workers if worker.tasks and worker.ready]
        if not times or self._limits.time == float("inf"):
            return None
        return max(min(times) + self._limits.time - time.monotonic(), 0.0) + 0.01

    def _receive(self, found: Iterable[object]) -> None:
        ready_objects = set(found)
        if self._wake_receiver in ready_objects:
            with self._lock:
                self._wake_receiver.recv_bytes()
                self._is_woken = False
        for worker in list(self._workers):
            gone = worker.process.sentinel in ready_objects
            if worker.messages in ready_objects or gone:
                try:
                    while worker.messages.poll():  # also messages that were sent before the worker died
                        self._handle_message(worker, worker.messages.recv())
                except (EOFError, OSError, pickle.UnpicklingError):
                    gone = True
                if gone:
                    self._remove_dead(worker)

    def _handle_message(self, worker: _Worker, said: Message) -> None:
        match said.what:
            case "ready":
                worker.ready = True
                self._startup_failures = 0
            case "compiles":
                self._compilations.put((worker.tasks[0].number, said.value))
            case "progress":
                self._progress.put((worker.tasks[0].number, said.value))
            case "estimator":
                self._progress.put((worker.tasks[0].number, 1.0))
                worker.estimator = said.value
                worker.since = time.monotonic() if said.value else worker.since
            case "last answer":
                worker.tasks.popleft().future.set_result(said.value)
                self._waiting.extendleft(reversed(worker.tasks))  # the worker ends, and they are not to blame
                worker.tasks.clear()
            case "answer":
                task = worker.tasks.popleft()
                self._seconds += 0.2 * (time.monotonic() - worker.began - self._seconds)
                task.future.set_result(said.value)
                if worker.tasks:
                    self._begin_task(worker)

    def _begin_task(self, worker: _Worker) -> None:
        worker.note_start()
        self._progress.put((worker.tasks[0].number, 0.0))

    def _kill_overdue(self) -> None:
        for worker in self._workers:
            if worker.tasks and worker.ready and time.monotonic() - worker.since > self._limits.time:
                worker.overdue = True
                worker.process.kill()

    def _remove_dead(self, worker: _Worker) -> None:
        """Remove a dead worker: fail the job that it was computing, and queue its other jobs again."""
        self._workers.remove(worker)
        worker.process.join(SHUTDOWN_TIMEOUT_S)  # its pipes close before the process ends
        worker.process.kill()
        worker.process.join()
        reason = self._limits.overdue_message() if worker.overdue else _exit_reason(worker.process, self._limits.memory)
        worker.jobs.close()
        worker.messages.close()
        if not worker.ready:
            self._startup_failures += 1
            if self._startup_failures >= MAX_STARTUP_FAILURES:
                self._failure = StudyError(f"no worker process can start: {reason}")
        if worker.tasks:
            lost_task = worker.tasks.popleft()
            self._waiting.extendleft(reversed(worker.tasks))
            lost = WorkerLostError(reason, estimator=worker.estimator, is_retryable=not worker.overdue)
            lost_task.future.set_exception(lost)

    def _distribute_tasks(self) -> None:
        """Start the workers that are needed, and send waiting tasks, first to idle workers."""
        while len(self._workers) < self.count and self._needs_worker() and not (self._is_stopped or self._failure):
            self._start_worker()
        for worker in sorted(self._workers, key=lambda worker: len(worker.tasks)):
            while self._waiting and worker.ready and self._has_room(worker):
                self._send_task(worker, self._waiting.popleft())

    def _needs_worker(self) -> bool:
        free = sum(not worker.tasks for worker in self._workers)
        return len(self._waiting) > free

    def _has_room(self, worker: _Worker) -> bool:
        if not worker.tasks:
            return True
        room = self._seconds < SHORT_JOB_S and len(worker.tasks) < MAX_PIPED_JOBS
        return room and sum(len(task.sent) for task in [*worker.tasks, self._waiting[0]]) < MAX_PIPED_BYTES

    def _send_task(self, worker: _Worker, task: _ProcessTask) -> None:
        with suppress(OSError):  # the worker has died, which the next round notices
            worker.jobs.send_bytes(task.sent)
        worker.tasks.append(task)
        if len(worker.tasks) == 1:
            self._begin_task(worker)

    def _start_worker(self) -> None:
        theirs, jobs = CONTEXT.Pipe(duplex=False)
        answers, to_us = CONTEXT.Pipe(duplex=False)
        process = CONTEXT.Process(target=serve_jobs, args=(theirs, to_us, self._limits.memory), name="fraexp worker")
        with self._lock:
            if self._is_stopped:
                return
            with _single_threaded_children(), _without_main_module():
                process.start()
            self._workers.append(_Worker(process, jobs, answers))
        theirs.close()
        to_us.close()

    def _end_workers(self) -> None:
        """End all workers; idle ones end by themselves."""
        for worker in self._workers:
            worker.jobs.close()
        deadline = time.monotonic() + (0.0 if self._is_stopped or self._failure else SHUTDOWN_TIMEOUT_S)
        for worker in self._workers:
            worker.process.join(max(deadline - time.monotonic(), 0.0))
            worker.process.kill()
            worker.process.join()


@contextmanager
def _without_main_module() -> Iterator[None]:
    """Let a starting process not run the user's script again, as multiprocessing does: workers need nothing of it."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _exit_reason(process: BaseProcess, memory: int | None) -> str:
    """Return as a sentence how a process ended."""
    code = process.exitcode or 0
    if code >= 0:
        return f"its worker exited with code {code}"
    cap = f"; it may have {size_text(memory)} of memory, see --memory-limit" if memory else ""
    if -code == signal.SIGKILL and not cap:
        cap = ", as a system does that is out of memory"
    return f"its worker was killed by signal {-code} ({_signal_name(-code)}){cap}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return "unnamed"


@contextmanager
def _single_threaded_children() -> Iterator[None]:
    """Start processes in this context such that they compute with one thread."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
