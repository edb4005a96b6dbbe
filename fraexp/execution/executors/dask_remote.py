"""What runs on a Dask worker: it says which code it has, and computes batches of jobs if it has what they need."""

import pickle
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from os import _exit
from pathlib import Path
from typing import Any
from uuid import uuid4

import fraexp
from fraexp.components.registry import Registry
from fraexp.data.identity import file_hash
from fraexp.errors import FraexpError
from fraexp.execution.executors.workers import Answer
from fraexp.execution.job import Job, failure, perform, registry_of

TOPIC = "fraexp"
"""Of the events by which workers tell how far they are."""
TELL = 1.0
"""Seconds between two words on the progress of a job, at least: each goes through Dask's scheduler."""
PROCESS = uuid4().hex
"""Tells this process from another one at the same address."""


@dataclass(frozen=True)
class Need:
    """What jobs need to be there."""

    components: frozenset[tuple[str, str, str, str]]
    """Kind, name, source hash and distribution of each component."""
    files: frozenset[tuple[str, str]]
    """Path and content hash of each record."""
    plugins: str
    """Folder of dropped-in plugins; empty if none of them is used."""


@dataclass(frozen=True)
class Lack:
    """Why a worker cannot compute a batch: a clause after its name."""

    reason: str


@dataclass(frozen=True)
class Done:
    """What came out of the jobs of a batch, from the first one on; the rest is to be sent again."""

    answers: list[Answer]
    seconds: float
    """What they took."""


class BatchCancelled(BaseException):
    """Raised in a running job whose answer nobody waits for any more."""


_met: set[Any] = set()
"""What was found to be there."""
_alone = threading.Lock()
"""A process computes one job at a time, as everywhere: plugins need not know of threads."""


def hello() -> tuple[str, dict[str, str]]:
    """Return what tells this process from others, and the hash of each module of fraexp that it has loaded."""
    return PROCESS, dict(_code)


def code_hashes(names: list[str] | None = None) -> dict[str, str]:
    """Return the content hash of modules of fraexp, of all that are loaded unless told which."""
    wanted = names if names is not None else [name for name in sys.modules if name.split(".")[0] == "fraexp"]
    package = Path(fraexp.__file__).parent
    found = {}
    for name in wanted:
        path = package.joinpath(*name.split(".")[1:])
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        with suppress(OSError):
            found[name] = file_hash(file)
    return found


_code = code_hashes()
"""As loaded, not as the files are by now: this module is imported when a worker is first asked."""


def end() -> None:
    """End this process."""
    _exit(1)


def compute(sent: bytes, run: str, number: int, budget: float) -> bytes:
    """Compute the jobs of a run's batch one after another, until `budget` [s] is used up; the first in any case.

    `sent` holds who is meant, the jobs and their need; the answer is Done, a Lack, or None for another process.
    """
    process, jobs, need = pickle.loads(sent)
    if process != PROCESS:
        return pickle.dumps(None)
    with _alone:
        lack = _lack(need)
        return pickle.dumps(lack) if lack else _packed(*_computed(jobs, _Teller(run, number), budget))


def _computed(jobs: list[Job], teller: "_Teller", budget: float) -> tuple[list[Job], list[Answer], float]:
    began = time.monotonic()
    answers: list[Answer] = []
    for place, job in enumerate(jobs):
        if place and time.monotonic() - began > budget:
            break
        teller.begin(place)
        try:
            answers.append(perform(job, teller.tell, lambda _: teller.check()))
        except BatchCancelled:
            break
        except BaseException as error:  # such as a plugin's sys.exit(): the worker is there for the others
            answers.append([failure(error)] * len(job.estimators))
    return jobs, answers, time.monotonic() - began


def _packed(jobs: list[Job], answers: list[Answer], seconds: float) -> bytes:
    try:
        return pickle.dumps(Done(answers, seconds), pickle.HIGHEST_PROTOCOL)
    except Exception:  # a plugin's result holds what cannot be sent
        return pickle.dumps(Done([_sendable(*pair) for pair in zip(jobs, answers, strict=False)], seconds))


def _sendable(job: Job, answer: Answer) -> Answer:
    try:
        pickle.dumps(answer)
    except Exception as error:
        return [failure(error)] * len(job.estimators)
    return answer


class _Teller:
    """Tells the client now and then how far a batch is, and ends it if it has been cancelled."""

    def __init__(self, run: str, number: int) -> None:
        from distributed import get_worker

        self._worker = get_worker()
        self._key = self._worker.get_current_task()
        self._run, self._number = run, number
        self._place = 0
        self._last = float("-inf")

    def begin(self, place: int) -> None:
        """Say that the job at this place of the batch begins."""
        self._place = place
        self.tell(0.0)

    def tell(self, done: float) -> None:
        """Say what fraction of the job is done, if it is time to."""
        self.check()
        if time.monotonic() - self._last > TELL:
            self._last = time.monotonic()
            said = {"run": self._run, "batch": self._number, "place": self._place, "done": float(done)}
            self._worker.log_event(TOPIC, said)

    def check(self) -> None:
        """Raise Cancelled if nobody waits for the answer."""
        task = self._worker.state.tasks.get(self._key)
        if task is None or task.state == "cancelled":
            raise BatchCancelled


def _lack(need: Need) -> Lack | None:
    """Return what is not there; what was found once is not looked for again."""
    for component in need.components:
        here = (component, need.plugins)  # each folder is read when it is first asked for, and hashed as it was read
        reason = "" if here in _met else _component_lack(component, need.plugins)
        if reason:
            return Lack(reason)
        _met.add(here)
    for file in need.files - _met:
        reason = _file_lack(*file)
        if reason:
            return Lack(reason)
        _met.add(file)
    return None


def _component_lack(component: tuple[str, str, str, str], plugins: str) -> str:
    kind, name, source, distribution = component
    own = distribution == "workspace"
    found = _hash(kind, name, plugins)
    if own and found != source:  # a dropped-in file may have been edited since; installed code cannot be loaded again
        registry_of.cache_clear()
        _met.clear()
        found = _hash(kind, name, plugins)
    if found == source:
        return ""
    if own:
        gone = found is None
        what = f"finds no {kind} '{name}' in {plugins}" if gone else f"has another version of {kind} '{name}'"
        return f"{what}; keep the workspace in a folder that all workers share, or install the plugin there"
    if found is None:
        return f"has no {kind} '{name}'; install {distribution} there"
    return f"has another version of {kind} '{name}'; install the same {distribution} there and restart it"


def _hash(kind: str, name: str, plugins: str) -> str | None:
    try:
        registry: Registry = registry_of(plugins)
        if not any("source_hash" in vars(supply) for supply in registry.supplies.values()):
            for supply in registry.supplies.values():  # now, when they have just been loaded
                _ = supply.source_hash
        return registry.supply(kind, name).source_hash
    except (FraexpError, OSError):
        return None


def _file_lack(path: str, content: str) -> str:
    try:
        if file_hash(Path(path)) == content:
            return ""
    except OSError as error:
        return f"cannot read the record {path} ({error.strerror}); keep records in a folder that all workers share"
    return f"has another record at {path}; keep records in a folder that all workers share"
