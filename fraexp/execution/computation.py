"""Computing the sweeps of a run: claimed, sent to workers, tried again where a worker is lost, and stored."""

import itertools
import math
import queue
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from itertools import islice

from fraexp.components.registry import Registry
from fraexp.data import fit_references
from fraexp.data.results import Result
from fraexp.data.sweep import Plain, Sweep
from fraexp.execution.events import Event, Finished, Noticed, Preparing, Progress
from fraexp.execution.executors import Answer, WorkerLostError, Workers
from fraexp.execution.job import Failure, Job
from fraexp.store import MOST_TOLD, RunProgress, Store, Supplied

BEAT = 5.0
"""Seconds between two signs of life in the database while nothing changes."""
TELL = 1.0
"""Seconds between two notes of a run's progress in the database, at least."""
POLL = 0.1
"""Seconds between two looks at the workers."""
GATHER = 0.2
"""Seconds for which results are gathered, to be stored together: a transaction takes as long as a short sweep."""
AHEAD = 0.6
"""Seconds of work that are sent ahead to each worker: short jobs must not wait for the next while others are stored."""
MOST_AHEAD = 256
"""Jobs that are sent ahead to each worker, at most: another run may claim what has not been sent."""
LOOK = 1.0
"""Seconds between two looks at what another run computes."""
ALONE = 2
"""Lost workers after which a sweep is computed with nothing beside it, for all the memory that there is."""


def components_of(sweep: Sweep, registry: Registry) -> dict[str, Supplied]:
    """Return source hash and distribution of every component that a sweep uses, under ``kind:name``."""
    record = sweep.experiment.get("record", {})
    sections = {**sweep.experiment, "estimator": sweep.estimator, "reader": record.get("reader")}
    return {
        f"{supply.component.kind}:{supply.component.name}": Supplied(supply.source_hash, supply.distribution)
        for kind, spec in sections.items()
        if isinstance(spec, Mapping)
        for supply in registry.used(kind, spec)
    }


@dataclass(frozen=True)
class Setting:
    """What the sweeps of a run have in common."""

    run: int
    store: Store
    registry: Registry
    plugins: str
    """Folder of the workspace's own plugins; empty for none."""
    again: bool
    """Whether sweeps are computed although there is a result, if it is older than the run."""
    compiling: float = 0.0
    """Time that compiling is expected to take [s]."""


class Pulse:
    """What the database is told of a run that is going on: that it lives, and how far it came."""

    def __init__(self, store: Store, run: int, total: int) -> None:
        self._store, self._run, self._total = store, run, total
        self._last = time.monotonic()
        self._told: RunProgress | None = None
        self.before = 0
        """Sweeps of turns that are over."""

    def beat(self, done: float, workers: int, running: Iterable[tuple[str, float]], doing: str) -> None:
        """Tell it if it is time to; `running` are keys of sweeps that are being computed, with the fraction done."""
        waited = time.monotonic() - self._last
        if waited < TELL:
            return
        now = RunProgress(self.before + done, self._total, workers, dict(islice(running, MOST_TOLD)), doing)
        if now != self._told or waited > BEAT:
            self._store.beat(self._run, now)
            self._last, self._told = time.monotonic(), now


@dataclass(eq=False)
class _Group:
    """Missing sweeps that share an experiment."""

    number: int
    sweeps: list[Sweep] = field(default_factory=list)
    lost: int = 0
    """Workers that it has cost."""

    def job(self, plugins: str, fits: Callable[[Plain], Plain]) -> Job:
        """Return them as one job, with the fits that they refer to."""
        first = self.sweeps[0]
        estimators = tuple(fit_references.replaced(sweep.estimator, fits) for sweep in self.sweeps)
        return Job(fit_references.replaced(first.experiment, fits), estimators, first.files, plugins)


class Computation:
    """Missing sweeps on their way through workers into the database."""

    def __init__(
        self,
        sweeps: Sequence[Sweep],
        setting: Setting,
        workers: Workers,
        fits: Callable[[Plain], Plain],
        pulse: Pulse,
    ) -> None:
        self._setting, self._store = setting, setting.store
        self._workers, self._fits, self._pulse = workers, fits, pulse
        self._numbers = itertools.count()
        self._total = len(sweeps)
        self._new = deque(self._grouped(sweeps))
        self._again: deque[_Group] = deque()
        """Claimed, and to be sent once more."""
        self._alone: deque[_Group] = deque()
        """Claimed, and to be sent when nothing else is under way."""
        self._held: list[Sweep] = []
        """Which another run has claimed."""
        self._running: dict[int, _Group] = {}
        self._fractions: dict[int, float] = {}
        self._compiling: dict[int, str] = {}
        """What jobs compile, by their number."""
        self._announced: set[str] = set()
        self._answers: queue.SimpleQueue[tuple[_Group, Future[Answer]]] = queue.SimpleQueue()
        self._answered: list[tuple[Sweep, Result | Failure]] = []
        self._finished = 0
        self._stored = self._looked = self._told = time.monotonic()
        self._seconds = math.inf
        """What a job takes, about; infinite until it is known."""

    def events(self) -> Iterator[Event]:
        """Compute all, and tell how it goes; what is finished is kept when it is interrupted."""
        try:
            yield from self._events()
        except (GeneratorExit, KeyboardInterrupt):
            self._keep()
            raise

    def _events(self) -> Iterator[Event]:
        while self._new or self._again or self._alone or self._running or self._held or self._answered:
            self._send()
            self._hear()
            yield from self._store_answers()
            yield from self._look_at_held()
            yield from (Noticed(text) for text in self._workers.notes())
            yield from self._tell_compiling()
            if time.monotonic() - self._told > POLL:
                yield self._tell()
        yield self._tell()

    def _grouped(self, sweeps: Iterable[Sweep]) -> list[_Group]:
        groups: dict[str, _Group] = {}
        for sweep in sweeps:
            if sweep.experiment_key not in groups:
                groups[sweep.experiment_key] = _Group(next(self._numbers))
            groups[sweep.experiment_key].sweeps.append(sweep)
        return list(groups.values())

    def _send(self) -> None:
        """Keep workers busy: with a little more than they compute, for other runs may help with the rest."""
        most = self._most_under_way()
        while self._again and len(self._running) < most:
            self._submit(self._again.popleft())
        room = most - len(self._running)
        if self._new and (room >= most // 4 or not self._running):
            for group in self._claimed([self._new.popleft() for _ in range(min(max(room, 1), len(self._new)))]):
                self._submit(group)
        if self._alone and not (self._running or self._new or self._again):
            self._submit(self._alone.popleft())

    def _most_under_way(self) -> int:
        ahead = min(max(AHEAD / self._seconds, 1.0), MOST_AHEAD)
        return math.ceil(max(self._workers.count, 1) * (1 + ahead))

    def _claimed(self, groups: Sequence[_Group]) -> list[_Group]:
        """Claim sweeps and return what this run shall compute; what it shall not is held by another, or done."""
        keys = {sweep.key for group in groups for sweep in group.sweeps}
        ours = self._store.claim(self._setting.run, keys, self._setting.again)
        if len(ours) < len(keys):
            self._held += [sweep for group in groups for sweep in group.sweeps if sweep.key not in ours]
            self._looked = -math.inf
        for group in groups:
            group.sweeps = [sweep for sweep in group.sweeps if sweep.key in ours]
        return [group for group in groups if group.sweeps]

    def _look_at_held(self) -> Iterator[Event]:
        """Take over what other runs have given up, and reuse what they have computed by now."""
        if not self._held or time.monotonic() - self._looked < LOOK:
            return
        held, self._held = self._held, []
        self._again += self._claimed(self._grouped(held))
        self._looked = time.monotonic()
        holders = self._store.held([sweep.key for sweep in self._held])
        done = self._store.known([sweep.key for sweep in self._held if sweep.key not in holders])
        reused = [sweep for sweep in self._held if sweep.key in done]
        self._held = [sweep for sweep in self._held if sweep.key not in done]
        if reused:
            self._store.reuse(self._setting.run, [sweep.key for sweep in reused])
            self._finished += len(reused)
            yield from (Finished(sweep, None, "reused") for sweep in reused)
        if holders and not (self._running or self._new or self._again):
            runs = ", ".join(str(run) for run in sorted(set(holders.values())))
            yield Preparing(f"waiting for sweeps that run {runs} computes: {len(self._held)}")

    def _submit(self, group: _Group) -> None:
        self._running[group.number] = group
        future = self._workers.submit(group.number, group.job(self._setting.plugins, self._fits))
        future.add_done_callback(lambda future: self._answers.put((group, future)))

    def _hear(self) -> None:
        """Take what workers have answered since, or the first answer within a while."""
        timeout: float | None = POLL
        while True:
            try:
                group, future = self._answers.get(timeout=timeout) if timeout else self._answers.get_nowait()
            except queue.Empty:
                break
            timeout = None
            del self._running[group.number]
            self._fractions.pop(group.number, None)
            self._compiling.pop(group.number, None)
            self._take(group, future)
        for number, fraction in self._workers.reports():
            if number in self._running:
                self._fractions[number] = fraction
                self._compiling.pop(number, None)

    def _tell_compiling(self) -> Iterator[Event]:
        """Say once of each friction law that it is compiled."""
        for number, laws in self._workers.compiles():
            if number in self._running:
                self._compiling[number] = f"compiling friction law {laws}"
        for text in set(self._compiling.values()) - self._announced:
            self._announced.add(text)
            about = f", about {self._setting.compiling:.0f} s" if self._setting.compiling >= 1 else ""
            yield Preparing(f"{text} (once per machine{about})")

    def _take(self, group: _Group, future: "Future[Answer]") -> None:
        error = future.exception()
        if error is None:
            self._answered += zip(group.sweeps, future.result(), strict=True)
        elif isinstance(error, WorkerLostError):
            self._lost(group, error)
        else:
            message = f"{type(error).__name__}: {error}"
            self._fail(group, message, "".join(traceback.format_exception(error)))

    def _fail(self, group: _Group, message: str, log: str = "") -> None:
        self._answered += [(sweep, Failure(message, log)) for sweep in group.sweeps]

    def _lost(self, group: _Group, error: WorkerLostError) -> None:
        """Try again what has cost a worker; what does so thrice, the third time alone, has failed."""
        if error.estimator is not None and len(group.sweeps) > 1:  # one estimator's loss is its own
            others = [sweep for at, sweep in enumerate(group.sweeps) if at != error.estimator]
            self._again.append(_Group(next(self._numbers), others, group.lost))
            group = _Group(next(self._numbers), [group.sweeps[error.estimator]], group.lost)
        group.lost += 1
        if not error.again:
            self._fail(group, str(error))
        elif group.lost < ALONE:
            self._again.append(group)
        elif group.lost == ALONE:
            self._alone += (_Group(next(self._numbers), [sweep], group.lost) for sweep in group.sweeps)
        else:
            self._fail(group, f"{error}, the {group.lost}rd time; the last time it was computed alone")

    def _store_answers(self) -> Iterator[Event]:
        """Store what has been answered, all of it in one transaction, then tell."""
        now = time.monotonic()
        if not self._answered or (now - self._stored < GATHER and (self._running or self._new)):
            return
        pairs = self._answered
        self._seconds = max(self._workers.count, 1) * (now - self._stored) / len(pairs)
        self._keep()
        self._stored = time.monotonic()
        for sweep, found in pairs:
            if isinstance(found, Failure):
                yield Finished(sweep, None, "failed", found.message)
            else:
                yield Finished(sweep, found, "computed")

    def _keep(self) -> None:
        registry = self._setting.registry
        pairs = self._answered
        good = [(sweep, found, components_of(sweep, registry)) for sweep, found in pairs if isinstance(found, Result)]
        if good:
            self._store.save(self._setting.run, good)
        for sweep, found in pairs:
            if isinstance(found, Failure):
                self._store.fail(self._setting.run, sweep.key, found.message, found.log)
        self._finished += len(pairs)
        self._answered = []

    def _tell(self) -> Progress:
        """Tell the database, and those who watch here, how far it came."""
        self._told = time.monotonic()
        fractions = self._fractions
        done = self._finished + len(self._answered)
        share = done + sum(len(self._running[number].sweeps) * part for number, part in fractions.items())
        started = ((sweep.key, part) for number, part in fractions.items() for sweep in self._running[number].sweeps)
        doing = next(iter(self._compiling.values()), "")
        self._pulse.beat(share, self._workers.count, started, doing)
        return Progress(share, self._total, sum(len(self._running[number].sweeps) for number in fractions), doing)
