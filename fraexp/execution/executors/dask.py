"""Jobs on a Dask cluster, through Dask's own executor: it assigns jobs, and retries those whose worker dies.

What fraexp alone knows is done here: only workers with the same code and the same plugins compute, a scheduler that
disappears is waited for, and jobs whose workers have all left are sent to others.
"""

import asyncio
import importlib.util
import json
import logging
import os
import pickle
import queue
import re
import threading
import time
import warnings
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any, TypeGuard
from uuid import uuid4

from fraexp.data.sweep import Plain
from fraexp.errors import StudyError, UnreachedError
from fraexp.execution.executors.dask_remote import (
    TOPIC,
    JobTimeoutError,
    RefusedError,
    Requirements,
    check_process,
    code_hashes,
    compute,
    versions,
)
from fraexp.execution.executors.limits import ResourceLimits, parse_duration
from fraexp.execution.executors.workers import Answer, WorkerLostError, Workers
from fraexp.execution.job import job_registry
from fraexp.execution.sent_jobs import Job
from fraexp.execution.used_components import component_sections

HOST_AND_PORT = re.compile(r"[\w.\-]+:\d+|\[[\da-fA-F:.]+\]:\d+")
CONNECT_TIMEOUT_S = 10.0
"""Time to wait for the scheduler at the start."""
RECONNECT_TIMEOUT_S = 2.0
"""Time of one attempt to reach a scheduler that has disappeared."""
DEFAULT_TIMEOUT_S = 120.0
"""Time to wait for a scheduler, or for workers, that have disappeared or are silent."""
TIMEOUT_VARIABLE = "FRAEXP_DASK_TIMEOUT"
"""Environment variable that replaces it, such as ``10min`` or ``none``."""
POLL_INTERVAL_S = 0.5
"""Interval at which the list of workers is read."""
QUIET_CHECK_S = 3.0
"""Time for which workers are checked before the user is told that none is ready."""
NOTICE_DELAY_S = 5.0
"""Time for which something is missing before the user reads for how long; also the step of that time."""
STOP_TIMEOUT_S = 0.8
"""Time in which jobs are cancelled and the connection is closed: the user must not wait for a silent cluster."""
MAX_REFUSALS_SHOWN = 5
"""Maximum number of refused workers that are reported one by one."""
RESUME_HINT = "what is computed is stored, and the same command goes on from there"


def check_executor_name(name: str) -> str:
    """Return the address in an executor's name such as ``dask:tcp://host:8786``; StudyError if it is invalid."""
    address = name.partition(":")[2]
    if not address:
        raise StudyError(f"executor '{name}': expected dask:ADDRESS, such as dask:tcp://host:8786, or dask:FILE")
    if importlib.util.find_spec("distributed") is None:
        raise StudyError(f"executor '{name}' needs Dask, which is not installed: pip install distributed")
    if "://" in address:
        if not re.fullmatch(r"\w+://\S+:\d+", address):
            raise StudyError(f"executor '{name}': expected an address with its port, such as dask:tcp://host:8786")
    elif not HOST_AND_PORT.fullmatch(address):
        scheduler_address(address)
    return address


def scheduler_address(address: str) -> str:
    """Return the scheduler's address; a file is read, in which the scheduler has written it."""
    if "://" in address or HOST_AND_PORT.fullmatch(address):
        return address
    try:
        return str(json.loads(Path(address).read_text(encoding="utf-8"))["address"])
    except OSError as error:
        reason = f"{address}: {error.strerror}; expected dask:tcp://host:port, or a file that dask scheduler writes"
    except (ValueError, KeyError, TypeError):
        reason = f"{address}: this is not a scheduler file; expected what dask scheduler --scheduler-file writes"
    raise StudyError(f"executor 'dask:{address}': {reason}")


def cluster_timeout() -> float:
    """Return the time to wait for a scheduler, or for workers [s]; StudyError if the variable is invalid."""
    text = os.environ.get(TIMEOUT_VARIABLE, "")
    return parse_duration(text, TIMEOUT_VARIABLE) if text else DEFAULT_TIMEOUT_S


@dataclass(eq=False)
class _Member:
    """A worker of the cluster."""

    address: str
    name: str
    is_fit: bool = False
    refused: str = ""
    """Why it must not compute; empty if it may, or is being checked."""

    def __str__(self) -> str:
        return self.address if self.name == self.address else f"{self.name} ({self.address})"


@dataclass(eq=False)
class _Task:
    """A submitted job."""

    number: int
    sent: bytes
    """The job with its requirements, pickled."""
    future: "Future[Answer]" = field(default_factory=Future)
    remote: "Future[Any] | None" = None
    """Dask's future; None while the job waits to be sent."""
    members: list[_Member] = field(default_factory=list)
    """Workers among which Dask chooses."""


class Dask(Workers):
    """The suitable workers of a cluster. All is done by one thread, which reads its actions from a queue."""

    def __init__(self, name: str, limits: ResourceLimits) -> None:
        super().__init__()
        self._address, self._timeout, self._limits = check_executor_name(name), cluster_timeout(), limits
        self._run = uuid4().hex[:12]
        self._code = code_hashes()
        self._actions: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._client: Any = None
        self._executor: Any = None
        self._members: dict[str, _Member] = {}
        self._open: dict[int, _Task] = {}
        self._asked: Future[Plain] | None = None
        self._looked = time.monotonic()
        self._silence = self._loneliness = self._idle = 0.0
        """Time without an answer of the scheduler, without a worker that may compute, and without one that does [s]."""
        self._is_silence_told = False
        self._refusals = 0
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True, name="fraexp dask")
        self._thread.start()
        try:
            self._ready.wait()
        except BaseException:
            self.stop()
            raise
        if self._failure:
            raise self._failure

    @property
    def count(self) -> int:  # type: ignore[override]  # it changes
        """Number of workers that compute."""
        return len(self._fit())

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        task = _Task(number, pickle.dumps(split_requirements(job), pickle.HIGHEST_PROTOCOL))
        self._actions.put(lambda: self._add(task))
        return task.future

    def status(self) -> str:
        if self._silence >= NOTICE_DELAY_S or not self._client:
            return f"Dask scheduler {'silent' if self._client else 'gone'}{_for_seconds(self._silence)}"
        if self._fit():
            return ""
        words = "no workers" if self._loneliness else "no workers ready"
        return f"{words}{_for_seconds(max(self._loneliness, self._idle))}"

    def stop(self) -> None:
        self._actions.put(None)
        self._thread.join(STOP_TIMEOUT_S)

    def close(self) -> None:
        self.stop()

    def _fit(self) -> list[_Member]:
        return [member for member in list(self._members.values()) if member.is_fit]

    def _serve(self) -> None:
        """Execute actions, and look after the cluster at intervals; this is what the thread runs."""
        try:
            silence_dask()
            self._connect(CONNECT_TIMEOUT_S)
            self._looked = began = time.monotonic()
            while not self._failure:
                try:
                    action = self._actions.get(timeout=POLL_INTERVAL_S)
                except queue.Empty:
                    action = self._look
                if action is None:
                    break
                action()
                if time.monotonic() - self._looked > POLL_INTERVAL_S:
                    self._look()
                if not self._ready.is_set():
                    self._note_start(time.monotonic() - began)
        except StudyError as error:
            self._fail(error)
        except Exception as error:  # nobody must wait in vain
            self._fail(StudyError(f"Dask at {self._address}: {type(error).__name__}: {first_line(error)}"))
        finally:
            self._ready.set()
            self._disconnect()

    def _fail(self, error: StudyError | UnreachedError) -> None:
        self._failure = self._failure or error

    def _note_start(self, waited: float) -> None:
        """End the wait of the caller when a worker is ready, or none is for some time."""
        if not self._fit() and waited > QUIET_CHECK_S:
            self._notes.put(f"waiting for a worker of Dask at {self._address}")
        if self._fit() or waited > QUIET_CHECK_S:
            self._ready.set()

    def _connect(self, timeout: float) -> None:
        """Connect to the scheduler; StudyError if that fails."""
        from distributed import Client
        from distributed.comm.addressing import get_address_host

        address = scheduler_address(self._address)
        get_address_host(address)  # ValueError for an unknown protocol, with which a client would try on and on
        try:
            self._client = Client(address, timeout=timeout, set_as_default=False, name="fraexp")  # type: ignore[no-untyped-call]
        except OSError as error:
            finding = f"no Dask scheduler answers at {self._address}{cause_text(error)}"
            raise StudyError(f"{finding}; start one: dask scheduler") from None
        self._executor = self._client.get_executor(pure=False)
        self._client.subscribe_topic(TOPIC, lambda event: self._actions.put(lambda: self._note_report(event[1])))

    def _disconnect(self) -> None:
        """Cancel what is sent and close the connection; all jobs without an answer wait to be sent again."""
        client, executor, self._client, self._asked = self._client, self._executor, None, None
        self._members.clear()
        for task in self._open.values():
            task.remote = None
        if client:
            with suppress(Exception):
                executor.shutdown(wait=False)
                client.close(timeout=STOP_TIMEOUT_S / 2)

    def _look(self) -> None:
        """Look after scheduler, workers and jobs."""
        now = time.monotonic()
        passed, self._looked = min(now - self._looked, 2 * RECONNECT_TIMEOUT_S), now  # this process may stand still
        self._silence += passed
        if self._client and self._client.status != "running":
            self._disconnect()
            self._is_silence_told = True
            self._notes.put(f"the Dask scheduler at {self._address} is gone; {self._patience()}")
        if not self._client:
            with suppress(StudyError):
                self._connect(RECONNECT_TIMEOUT_S)
        if self._client:
            self._ask(passed)
        self._send_waiting()
        self._judge_waiting()

    def _ask(self, passed: float) -> None:
        """Take what the scheduler says of its workers, and ask it again."""
        if self._asked and self._asked.done():
            answer, self._asked = self._asked, None
            if answer.exception() is None:
                self._note_answer(answer.result(), passed)
        if not self._asked:
            asked = self._client.scheduler.identity(n_workers=-1)
            self._asked = asyncio.run_coroutine_threadsafe(asked, self._client.loop.asyncio_loop)

    def _note_answer(self, identity: Plain, passed: float) -> None:
        if self._is_silence_told:
            self._notes.put(f"the Dask scheduler at {self._address} answers again after {self._silence:.0f} s")
        self._silence, self._is_silence_told = 0.0, False
        seen = identity["workers"]
        for address in set(self._members) - set(seen):
            self._remove(self._members.pop(address))
        for address in sorted(set(seen) - set(self._members)):
            self._check(_Member(address, str(seen[address]["name"])))
        members = list(self._members.values())
        self._loneliness = 0.0 if any(not member.refused for member in members) else self._loneliness + passed
        self._idle = 0.0 if self._fit() else self._idle + passed
        if members and all(member.refused for member in members):
            listed = "; ".join(f"{member} {member.refused}" for member in members[:MAX_REFUSALS_SHOWN])
            more = f"; and {len(members) - MAX_REFUSALS_SHOWN} more" if len(members) > MAX_REFUSALS_SHOWN else ""
            self._fail(StudyError(f"no worker of Dask at {self._address} can compute this study: {listed}{more}"))

    def _judge_waiting(self) -> None:
        """Tell the user that the scheduler is silent; end the run if nobody has been there for too long."""
        if self._silence > NOTICE_DELAY_S and not self._is_silence_told:
            self._is_silence_told = True
            self._notes.put(f"the Dask scheduler at {self._address} is silent; {self._patience()}")
        if not self._open:
            return
        if self._silence > self._timeout:
            was = "silent" if self._client else "gone"
            finding = f"the Dask scheduler at {self._address} was {was} for {self._timeout:g} s"
            self._fail(UnreachedError(f"{finding}; {RESUME_HINT}"))
        elif self._loneliness > self._timeout:
            finding = f"Dask at {self._address} had no worker for {self._timeout:g} s; start one: dask worker"
            self._fail(UnreachedError(f"{finding}; {RESUME_HINT}"))

    def _patience(self) -> str:
        return "waiting for it" + (f" up to {self._timeout:g} s" if self._timeout < inf else "")

    def _check(self, member: _Member) -> None:
        """Have a worker compare its versions and its code with those of the run."""
        self._members[member.address] = member
        asked = self._executor.submit(
            check_process, self._run, versions(), workers=[member.address], allow_other_workers=False
        )
        asked.add_done_callback(lambda future: self._actions.put(lambda: self._note_check(member, future)))

    def _note_check(self, member: _Member, answer: "Future[tuple[str, dict[str, str]]]") -> None:
        if self._members.get(member.address) is not member:
            return
        if answer.cancelled() or _is_lost(answer.exception()):
            del self._members[member.address]  # it is checked anew if it is still there
            return
        error = answer.exception()
        if error:  # an import there fails, in whatever way
            self._refuse(member, f"cannot run fraexp ({type(error).__name__}: {first_line(error)})")
            return
        reason, code = answer.result()
        here = {**code_hashes([name for name in code if name not in self._code]), **self._code}
        other = sorted(name for name in code if here.get(name) != code[name])
        if other:
            reason = (
                f"has another source of {other[0]} in the same version; install the same source there and restart it"
            )
        if reason:
            self._refuse(member, reason)
        else:
            member.is_fit = True
            self._send_waiting()

    def _refuse(self, member: _Member, reason: str) -> None:
        member.is_fit, member.refused = False, reason
        self._refusals += 1
        if self._refusals <= MAX_REFUSALS_SHOWN:
            self._notes.put(f"Dask worker {member} is left out: it {reason}")
        self._recall(lambda task: not any(one.is_fit for one in task.members))

    def _remove(self, member: _Member) -> None:
        """Give up jobs whose workers have all left the cluster: they died with one, or it took its leave."""
        was_fit, member.is_fit = member.is_fit, False
        if was_fit:
            for task in self._recall(lambda task: not any(one.is_fit for one in task.members)):
                self._settle(task, error=_loss(member))

    def _recall(self, chosen: Callable[[_Task], bool]) -> list[_Task]:
        """Cancel the sent jobs that are chosen, and return them."""
        recalled = [task for task in self._open.values() if task.remote and chosen(task)]
        for task in recalled:
            remote, task.remote = task.remote, None
            if remote:
                remote.cancel()
        return recalled

    def _add(self, task: _Task) -> None:
        self._open[task.number] = task
        self._send_waiting()

    def _send_waiting(self) -> None:
        """Send the jobs that wait to the workers that may compute them."""
        fit = self._fit()
        for task in list(self._open.values()) if fit and self._client else ():
            if task.remote is None:
                task.members = fit
                self._send(task)

    def _send(self, task: _Task) -> None:
        addresses = [member.address for member in task.members]
        try:
            task.remote = self._executor.submit(
                compute, self._run, task.number, task.sent, self._limits.time,
                workers=addresses, allow_other_workers=False,
            )  # fmt: skip
        except Exception:  # the connection has just been lost
            return
        task.remote.add_done_callback(lambda remote: self._actions.put(lambda: self._accept(task, remote)))

    def _accept(self, task: _Task, remote: "Future[bytes]") -> None:
        """Accept the answer of a job, unless it is of a connection that is lost, or of a job that was recalled."""
        if task.remote is not remote:
            return
        if remote.cancelled():
            task.remote = None
            return
        error = remote.exception()
        if error is None:
            self._settle(task, pickle.loads(remote.result()))
        elif isinstance(error, RefusedError):
            task.remote = None
            member = self._members.get(error.address)
            if member and error.reason:
                self._refuse(member, error.reason)
            elif member:  # another process has taken its place
                del self._members[error.address]
        elif isinstance(error, JobTimeoutError):
            self._settle(task, error=WorkerLostError(self._limits.overdue_message(), is_retryable=False))
        elif _is_lost(error):
            last = error.last_worker.address
            self._settle(task, error=_loss(self._members.get(last, last)))
        else:
            self._settle(task, error=error)

    def _settle(self, task: _Task, answer: Answer | None = None, error: BaseException | None = None) -> None:
        self._open.pop(task.number, None)
        task.remote = None
        if error is not None:
            task.future.set_exception(error)
        else:
            task.future.set_result(answer or [])

    def _note_report(self, said: Plain) -> None:
        if said.get("run") != self._run or said.get("number") not in self._open:
            return
        if "done" in said:
            self._progress.put((said["number"], said["done"]))
        else:
            self._compilations.put((said["number"], said["compiling"]))


def split_requirements(job: Job) -> tuple[Job, Requirements]:
    """Return a job, without the local plugins if it uses none of them, and what it requires on a worker."""
    registry = job_registry(job)
    sections = component_sections(job.experiment, job.estimators)
    providers = [provider for kind, spec in sections for provider in registry.used_providers(kind, spec)]
    own = any(provider.distribution == "workspace" for provider in providers)
    folder = str(Path(job.plugins).resolve()) if own else ""
    components = {(s.component.kind, s.component.name, s.source_hash, s.distribution) for s in providers}
    return replace(job, plugins=folder), Requirements(frozenset(components), frozenset(_record_files(job)), folder)


def _record_files(job: Job) -> Iterable[tuple[str, str]]:
    record = job.experiment.get("record") or {}
    parts = record.get("parts", [record] if record else [])
    names = ["record", *(f"record.{number}" for number in range(1, len(parts)))]
    return ((job.files[name], part["hash"]) for name, part in zip(names, parts, strict=bool(parts)))


def silence_dask() -> None:
    """Suppress the logs and warnings of Dask: fraexp reports what matters in its own words."""
    import distributed

    for name in ("asyncio", "tornado", *logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logger = logging.getLogger(name)
            logger.handlers = [logging.NullHandler()]
            logger.propagate = False
    warnings.filterwarnings("ignore", category=distributed.versions.VersionMismatchWarning)
    warnings.filterwarnings("ignore", message="Sending large graph")


def _is_lost(error: BaseException | None) -> TypeGuard["distributed.scheduler.KilledWorker"]:  # type: ignore[name-defined]  # noqa: F821
    from distributed import KilledWorker

    return isinstance(error, KilledWorker)


def _loss(member: _Member | str) -> WorkerLostError:
    return WorkerLostError(f"its Dask worker {member} was lost, as by a crash or for lack of memory; see its log")


def cause_text(error: BaseException | None) -> str:
    """Return the system's reason in brackets; empty after a mere timeout."""
    while error is not None:
        if isinstance(error, OSError) and error.strerror:
            return f" ({error.strerror})"
        error = error.__cause__
    return ""


def first_line(error: object) -> str:
    """Return the first line of an error's text."""
    return next(iter(str(error).splitlines()), "")


def _for_seconds(duration: float) -> str:
    """Return ``for 20 s`` in steps that do not flicker; empty for a moment."""
    whole = int(duration // NOTICE_DELAY_S * NOTICE_DELAY_S)
    return f" for {whole} s" if whole else ""
