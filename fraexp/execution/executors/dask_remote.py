"""The code of a Dask worker: it compares its code with that of a run, and computes jobs whose requirements it meets."""

import pickle
import platform
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path

import fraexp
from fraexp.data.identity import file_hash
from fraexp.errors import FraexpError
from fraexp.execution.job import describe_failure, registry_of
from fraexp.execution.sent_jobs import Job
from fraexp.execution.watched_job import JobCancelled, run_watched_job

TOPIC = "fraexp"
"""Topic of the events with which workers report progress."""
PROGRESS_INTERVAL_S = 1.0
"""Minimum interval between two progress events of a worker: each passes through Dask's scheduler."""
LEAVE_DELAY_S = 1.0
"""Time in which the last answer of a worker reaches the scheduler."""
COMPARED_PACKAGES = ("fraexp", "numpy", "scipy", "numba")
"""Packages on which results may depend."""


@dataclass(frozen=True)
class Requirements:
    """What a job requires on a worker."""

    components: frozenset[tuple[str, str, str, str]]
    """Kind, name, source hash and distribution of each component."""
    files: frozenset[tuple[str, str]]
    """Path and content hash of each record."""
    plugins: str
    """Folder of local plugins; empty if none of them is used."""


class RefusedError(Exception):
    """A worker cannot compute a job."""

    def __init__(self, address: str, reason: str) -> None:
        super().__init__(address, reason)
        self.address, self.reason = address, reason
        """Why, as a clause that follows the worker's name; empty if its process has not been checked."""


class JobTimeoutError(Exception):
    """A job has exceeded its time limit."""


_checked: set[str] = set()
"""Runs that have checked this process."""
_verified: set[tuple[object, ...]] = set()
"""Requirements that have been found to be met."""
_compute_lock = threading.Lock()
"""A process computes one job at a time: plugins need not be thread-safe."""
_last_report = float("-inf")


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


def versions() -> dict[str, str | None]:
    """Return the versions of Python and of the compared packages; None for one that is not installed."""
    found: dict[str, str | None] = {"Python": ".".join(platform.python_version_tuple()[:2])}
    for name in COMPARED_PACKAGES:
        found[name] = None
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def check_process(run: str, theirs: Mapping[str, str | None]) -> tuple[str, dict[str, str]]:
    """Return why this process has other versions than a run, empty if it has not, and the hashes of its code."""
    _checked.add(run)
    for name, here in versions().items():
        wanted = theirs[name]
        if here is None and wanted is not None:
            return f"has no {name}; install {name} {wanted} there and restart it", {}
        if here != wanted:
            return f"has {name} {here}, but {wanted} is here; install the same there and restart it", {}
    return "", dict(_loaded_code)


def compute(run: str, number: int, sent: bytes, limit: float) -> bytes:
    """Compute a job, which is pickled with its requirements, and return its pickled answer.

    RefusedError if this process does not meet them, JobTimeoutError if an estimator takes longer than `limit` [s]; then
    the worker closes, because its thread cannot be stopped.
    """
    from distributed import get_worker

    worker = get_worker()
    if run not in _checked:
        raise RefusedError(worker.address, "")
    job, requirements = pickle.loads(sent)
    with _compute_lock:
        reason = _refusal(requirements)
        if reason:
            raise RefusedError(worker.address, reason)
        return _compute(job, _Reporter(worker, run, number), limit)


def _compute(job: Job, reporter: "_Reporter", limit: float) -> bytes:
    end = run_watched_job(job, reporter.report, lambda _: reporter.check_cancelled(), reporter.announce, limit)
    if end.is_overdue or end.hangs:
        reporter.end_worker()
    if end.is_overdue:
        raise JobTimeoutError
    if isinstance(end.error, JobCancelled):
        return pickle.dumps([])
    if end.error is not None:  # such as a plugin's sys.exit(): the worker goes on with others
        return pickle.dumps([describe_failure(end.error)] * len(job.estimators))
    try:
        return pickle.dumps(end.answer, pickle.HIGHEST_PROTOCOL)
    except Exception as error:  # a plugin's result cannot be pickled
        return pickle.dumps([describe_failure(error)] * len(job.estimators))


class _Reporter:
    """Reports the progress of a job to the client, and stops the job if nobody waits for it."""

    def __init__(self, worker: "distributed.Worker", run: str, number: int) -> None:  # type: ignore[name-defined]  # noqa: F821
        self.worker = worker
        self._key = worker.get_current_task()
        self._run, self._number = run, number
        self.report(0.0)

    def report(self, done: float) -> None:
        """Report the fraction of the job that is done, if a report is due."""
        global _last_report  # noqa: PLW0603
        self.check_cancelled()
        if time.monotonic() - _last_report > PROGRESS_INTERVAL_S:
            _last_report = time.monotonic()
            self._send(done=float(done))

    def announce(self, laws: str) -> None:
        """Report the friction laws that are about to be compiled, and none when they are."""
        self.check_cancelled()
        self._send(compiling=laws)

    def end_worker(self) -> None:
        """Have the worker leave the cluster, and its nanny start another one, when the answer has been sent."""
        leave = partial(self.worker.close_gracefully, restart=True, reason="a job of fraexp does not end")
        self.worker.loop.add_callback(self.worker.loop.call_later, LEAVE_DELAY_S, leave)

    def _send(self, **said: object) -> None:
        self.worker.log_event(TOPIC, {"run": self._run, "number": self._number, **said})

    def check_cancelled(self) -> None:
        """Raise JobCancelled if nobody waits for the answer."""
        task = self.worker.state.tasks.get(self._key)
        if task is None or task.state == "cancelled":
            raise JobCancelled


def _refusal(requirements: Requirements) -> str:
    """Return the first requirement that is not met, or an empty text; what was met once is not checked again."""
    for component in requirements.components:
        here = (component, requirements.plugins)  # a folder is read and hashed at its first use
        reason = "" if here in _verified else _component_refusal(component, requirements.plugins)
        if reason:
            return reason
        _verified.add(here)
    for file in requirements.files - _verified:
        reason = _file_refusal(*file)
        if reason:
            return reason
        _verified.add(file)
    return ""


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
