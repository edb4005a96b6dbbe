"""What runs in a worker process: jobs come through one pipe, what became of them goes back through another."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection

from fraexp.execution.executors.limits import cap_memory, size_text
from fraexp.execution.executors.workers import Answer
from fraexp.execution.job import Failure, Job, failure, perform

TELL = 0.1
"""Seconds between two words on the progress of a job, at least."""
GONE = (BrokenPipeError, ConnectionResetError)


@dataclass(frozen=True)
class Ready:
    """The worker is up and waits for jobs."""


@dataclass(frozen=True)
class At:
    """How far a job has come: the fraction of its experiment, the estimator that begins, what it compiles."""

    done: float
    estimator: int | None = None
    compiles: str = ""
    """Friction laws that are about to be compiled."""


def work(jobs: Connection, told: Connection, memory: int | None) -> None:
    """Compute jobs until their pipe is closed, or the process that sends them is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the scheduler, which then ends its workers
    os.dup2(2, 1)  # what a plugin prints is talk: stdout is for data
    _end_with_parent()
    cap_memory(memory)
    try:
        told.send(Ready())
        while True:
            job = jobs.recv()
            _send(told, _explained(_answer(job, told), memory), job)
    except (EOFError, *GONE):
        os._exit(0)  # there is nothing to tidy up, and an interpreter takes its time for that


def _answer(job: Job, told: Connection) -> Answer:
    last = time.monotonic()

    def progress(done: float) -> None:
        nonlocal last
        if time.monotonic() - last > TELL:
            last = time.monotonic()
            told.send(At(done))

    def begins(estimator: int) -> None:
        if len(job.estimators) > 1:
            told.send(At(1.0, estimator))

    def compiles(laws: str) -> None:
        told.send(At(0.0, compiles=laws))

    try:
        return perform(job, progress, begins, compiles)
    except GONE:
        raise
    except BaseException as error:  # such as a plugin's sys.exit(): the worker is there for others too
        return [failure(error)] * len(job.estimators)


def _explained(answer: Answer, memory: int | None) -> Answer:
    """Return an answer whose failures for want of memory name the cap."""
    if memory is None:
        return answer
    cap = f"; a worker may have {size_text(memory)}, see --memory"
    return [
        replace(one, message=one.message + cap) if isinstance(one, Failure) and "MemoryError" in one.message else one
        for one in answer
    ]


def _send(told: Connection, answer: Answer, job: Job) -> None:
    try:
        told.send(answer)
    except GONE:
        raise
    except Exception as error:  # a plugin's result holds what cannot be sent; nothing of it has been written
        told.send([failure(error)] * len(job.estimators))


def _end_with_parent() -> None:
    """See to it that this worker ends when its scheduler is gone, however that died and whatever a plugin does."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()
    if sys.platform == "linux":
        set_parent_death_signal = 1
        ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGKILL)
        if os.getppid() != parent.pid:  # it died before
            os._exit(1)


def _exit_after(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)
