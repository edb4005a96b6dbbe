"""The code of a Dask worker: it reports its versions, and computes batches of jobs if it meets their requirements."""

import pickle
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from os import _exit
from pathlib import Path
from uuid import uuid4

import fraexp
from fraexp.data.identity import file_hash
from fraexp.errors import FraexpError
from fraexp.execution.executors.workers import Answer
from fraexp.execution.job import Job, describe_failure, registry_of
from fraexp.execution.watched_job import run_watched_job

TOPIC = "fraexp"
"""Topic of the events with which workers report progress."""
PROGRESS_INTERVAL_S = 1.0
"""Minimum interval between two progress events of a job: each passes through Dask's scheduler."""
PROCESS_ID = uuid4().hex
"""Distinguishes this process from another one at the same address."""


@dataclass(frozen=True)
class Requirements:
    """What jobs require on a worker."""

    components: frozenset[tuple[str, str, str, str]]
    """Kind, name, source hash and distribution of each component."""
    files: frozenset[tuple[str, str]]
    """Path and content hash of each record."""
    plugins: str
    """Folder of local plugins; empty if none of them is used."""


@dataclass(frozen=True)
class MissingRequirement:
    """Why a worker cannot compute a batch, as a clause that follows its name."""

    reason: str


@dataclass(frozen=True)
class BatchAnswer:
    """Answers of a batch, from its first job on; the other jobs must be sent again."""

    answers: list[Answer]
    seconds: float
    """Time in which they were computed."""


class BatchCancelled(BaseException):
    """Raised in a running job that has been cancelled."""


_verified: set[tuple[object, ...]] = set()
"""Requirements that have been found to be met."""
_compute_lock = threading.Lock()
"""A process computes one job at a time: plugins need not be thread-safe."""


def worker_versions() -> tuple[str, dict[str, str]]:
    """Return the identifier of this process, and the hash of each module of fraexp that it has loaded."""
    return PROCESS_ID, dict(_loaded_code)


def code_hashes(names: list[str] | None = None) -> dict[str, str]:
    """Return the content hash of modules of fraexp; without `names`, of all that are loaded."""
    wanted = names if names is not None else [name for name in sys.modules if name.split(".")[0] == "fraexp"]
    package = Path(fraexp.__file__).parent
    found = {}
    for name in wanted:
        path = package.joinpath(*name.split(".")[1:])
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        with suppress(OSError):
            found[name] = file_hash(file)
    return found


_loaded_code = code_hashes()
"""Hashes of the code as it was loaded: this module is imported at the first request, and files may change later."""


def end_process() -> None:
    """End this process."""
    _exit(1)


def compute_batch(sent: bytes, run: str, number: int, budget: float) -> bytes:
    """Compute the jobs of a batch one after another: the first one, then others until `budget` [s] is used up.

    `sent` is pickled: the process that is addressed, the jobs and their requirements. The answer is pickled, too: a
    BatchAnswer, a MissingRequirement, or None if this is another process.
    """
    process, jobs, requirements = pickle.loads(sent)
    if process != PROCESS_ID:
        return pickle.dumps(None)
    with _compute_lock:
        missing = _missing_requirement(requirements)
        return (
            pickle.dumps(missing) if missing else _pickle_answer(*_run_jobs(jobs, _BatchReporter(run, number), budget))
        )


def _run_jobs(jobs: list[Job], reporter: "_BatchReporter", budget: float) -> tuple[list[Job], list[Answer], float]:
    began = time.monotonic()
    answers: list[Answer] = []
    for place, job in enumerate(jobs):
        if place and time.monotonic() - began > budget:
            break
        reporter.start_job(place)
        try:
            answers.append(_run_job(job, reporter))
        except BatchCancelled:
            break
    return jobs, answers, time.monotonic() - began


def _run_job(job: Job, reporter: "_BatchReporter") -> Answer:
    """Return the answer of a job; where a law hangs, its thread goes on until the worker ends."""
    end = run_watched_job(job, reporter.report, lambda _: reporter.check_cancelled(), reporter.announce)
    if isinstance(end.error, BatchCancelled):
        raise end.error
    if end.error is not None:  # such as a plugin's sys.exit(): the worker goes on with the others
        return [describe_failure(end.error)] * len(job.estimators)
    return end.answer


def _pickle_answer(jobs: list[Job], answers: list[Answer], seconds: float) -> bytes:
    try:
        return pickle.dumps(BatchAnswer(answers, seconds), pickle.HIGHEST_PROTOCOL)
    except Exception:  # a plugin's result cannot be pickled
        return pickle.dumps(BatchAnswer([_picklable(*pair) for pair in zip(jobs, answers, strict=False)], seconds))


def _picklable(job: Job, answer: Answer) -> Answer:
    try:
        pickle.dumps(answer)
    except Exception as error:
        return [describe_failure(error)] * len(job.estimators)
    return answer


class _BatchReporter:
    """Reports the progress of a batch to the client, and stops the batch if it has been cancelled."""

    def __init__(self, run: str, number: int) -> None:
        from distributed import get_worker

        self._worker = get_worker()
        self._key = self._worker.get_current_task()
        self._run, self._number = run, number
        self._place = 0
        self._last = float("-inf")

    def start_job(self, place: int) -> None:
        """Report that the job at this place of the batch begins."""
        self._place = place
        self.report(0.0)

    def report(self, done: float) -> None:
        """Report the fraction of the job that is done, if a report is due."""
        self.check_cancelled()
        if time.monotonic() - self._last > PROGRESS_INTERVAL_S:
            self._last = time.monotonic()
            self._send(done=float(done))

    def announce(self, laws: str) -> None:
        """Report the friction laws that are about to be compiled, and none when they are."""
        self.check_cancelled()
        self._send(compiling=laws)

    def _send(self, **said: object) -> None:
        self._worker.log_event(TOPIC, {"run": self._run, "batch": self._number, "place": self._place, **said})

    def check_cancelled(self) -> None:
        """Raise BatchCancelled if nobody waits for the answer."""
        task = self._worker.state.tasks.get(self._key)
        if task is None or task.state == "cancelled":
            raise BatchCancelled


def _missing_requirement(requirements: Requirements) -> MissingRequirement | None:
    """Return the first requirement that is not met, or None; what was met once is not checked again."""
    for component in requirements.components:
        here = (component, requirements.plugins)  # a folder is read and hashed at its first use
        reason = "" if here in _verified else _component_refusal(component, requirements.plugins)
        if reason:
            return MissingRequirement(reason)
        _verified.add(here)
    for file in requirements.files - _verified:
        reason = _file_refusal(*file)
        if reason:
            return MissingRequirement(reason)
        _verified.add(file)
    return None


def _component_refusal(component: tuple[str, str, str, str], plugins: str) -> str:
    kind, name, source, distribution = component
    own = distribution == "workspace"
    found = _source_hash(kind, name, plugins)
    if own and found != source:  # a local file may have changed; installed code cannot be loaded again
        registry_of.cache_clear()
        _verified.clear()
        found = _source_hash(kind, name, plugins)
    if found == source:
        return ""
    if own:
        gone = found is None
        what = f"finds no {kind} '{name}' in {plugins}" if gone else f"has another version of {kind} '{name}'"
        return f"{what}; keep the workspace in a folder that all workers share, or install the plugin there"
    if found is None:
        return f"has no {kind} '{name}'; install {distribution} there"
    return f"has another version of {kind} '{name}'; install the same {distribution} there and restart it"


def _source_hash(kind: str, name: str, plugins: str) -> str | None:
    try:
        registry = registry_of(plugins)
        if not any("source_hash" in vars(provider) for provider in registry.providers.values()):
            for provider in registry.providers.values():  # now, because they have just been loaded
                _ = provider.source_hash
        return registry.provider(kind, name).source_hash
    except (FraexpError, OSError):
        return None


def _file_refusal(path: str, content: str) -> str:
    try:
        if file_hash(Path(path)) == content:
            return ""
    except OSError as error:
        return f"cannot read the record {path} ({error.strerror}); keep records in a folder that all workers share"
    return f"has another record at {path}; keep records in a folder that all workers share"
