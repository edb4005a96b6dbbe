"""The code of a worker process: jobs arrive through one pipe, messages and answers leave through another."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from dataclasses import replace
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from typing import Any, Literal, NamedTuple

from fraexp.execution.executors.limits import cap_memory, size_text
from fraexp.execution.executors.workers import Answer
from fraexp.execution.job import describe_failure
from fraexp.execution.sent_jobs import Failure, Job
from fraexp.execution.watched_job import run_watched_job

PROGRESS_INTERVAL_S = 0.1
"""Minimum interval between two progress messages of a job."""
PIPE_ERRORS = (BrokenPipeError, ConnectionResetError)


class Message(NamedTuple):
    """What a worker sends."""

    what: Literal["ready", "progress", "estimator", "compiles", "answer", "last answer"]
    """After its last answer, in whose job a law hangs, it ends itself, because its thread cannot be stopped."""
    value: Any = None
    """The fraction of the experiment that is done, the index of the estimator that begins, the friction laws that are
    compiled, none at the end, or the answer."""


def serve_jobs(jobs: Connection, answers: Connection, memory: int | None) -> None:
    """Compute jobs until their pipe is closed or the process that sends them has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the scheduler handles Ctrl-C, and ends its workers
    os.dup2(2, 1)  # a plugin may print; stdout is for data
    _end_when_parent_ends()
    cap_memory(memory)
    try:
        answers.send(Message("ready"))
        while True:
            job = jobs.recv()
            said = _run(job, answers)
            if said.what == "last answer":
                answers.send(said)
                os._exit(1)
            _send_answer(answers, _with_memory_limit(said.value, memory), job)
    except (EOFError, *PIPE_ERRORS):
        os._exit(0)  # nothing needs a clean-up, and the interpreter's own takes time


def _run(job: Job, answers: Connection) -> Message:
    last = time.monotonic()

    def report_progress(done: float) -> None:
        nonlocal last
        if time.monotonic() - last > PROGRESS_INTERVAL_S:
            last = time.monotonic()
            answers.send(Message("progress", done))

    def report_estimator(estimator: int) -> None:
        if len(job.estimators) > 1:
            answers.send(Message("estimator", estimator))

    def report_compilation(laws: str) -> None:
        answers.send(Message("compiles", laws))

    end = run_watched_job(job, report_progress, report_estimator, report_compilation)
    if isinstance(end.error, PIPE_ERRORS):
        raise end.error
    if end.error is not None:  # such as a plugin's sys.exit(): the worker goes on with other jobs
        return Message("answer", [describe_failure(end.error)] * len(job.estimators))
    return Message("last answer" if end.hangs else "answer", end.answer)


def _with_memory_limit(answer: Answer, memory: int | None) -> Answer:
    """Return an answer in which failures by lack of memory mention the memory limit."""
    if memory is None:
        return answer
    cap = f"; a worker may have {size_text(memory)}, see --memory-limit"
    return [
        replace(one, message=one.message + cap) if isinstance(one, Failure) and one.lacks_memory else one
        for one in answer
    ]


def _send_answer(answers: Connection, answer: Answer, job: Job) -> None:
    try:
        answers.send(Message("answer", answer))
    except PIPE_ERRORS:
        raise
    except Exception as error:  # a plugin's result cannot be pickled; nothing of it has been written
        answers.send(Message("answer", [describe_failure(error)] * len(job.estimators)))


def _end_when_parent_ends() -> None:
    """Have this process end when its scheduler has ended, however that happened and whatever a plugin does.

    The fork server, whose child this is, ends when nobody can ask it for workers any more.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    threading.Thread(target=_exit_when_ended, args=(parent,), daemon=True).start()
    if sys.platform == "linux":
        os.close(forkserver._forkserver._forkserver_alive_fd)  # type: ignore[attr-defined]
        set_parent_death_signal = 1  # PR_SET_PDEATHSIG of prctl(2)
        ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGKILL)
        if not parent.is_alive():
            os._exit(1)


def _exit_when_ended(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)
