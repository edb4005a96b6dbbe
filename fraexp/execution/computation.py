"""Computation of a run's sweeps: claimed, sent to workers, retried when a worker is lost, and stored."""

import itertools
import math
import queue
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from itertools import islice
from typing import TypeVar

from fraexp.components.registry import Registry
from fraexp.data import fit_references
from fraexp.data.results import Result
from fraexp.data.sweep import Plain, Sweep
from fraexp.errors import FraexpError, StoreError
from fraexp.execution.database_retry import WAITING_TEXT, Clock, DatabaseRetry
from fraexp.execution.events import Event, Finished, Noticed, Preparing, Progress
from fraexp.execution.executors import Answer, WorkerLostError, Workers
from fraexp.execution.run_time import RunTime
from fraexp.execution.sent_jobs import Failure, Job
from fraexp.execution.used_components import component_origins, local_sources
from fraexp.store import MAX_RUNNING_SHOWN, ComponentOrigin, RunProgress, Store

HEARTBEAT_INTERVAL_S = 5.0
"""Heartbeat interval while nothing changes."""
PROGRESS_INTERVAL_S = 1.0
"""Minimum interval between two updates of the progress in the database."""
POLL_INTERVAL_S = 0.1
"""Interval at which the workers are asked for answers."""
GATHER_INTERVAL_S = 0.2
"""Time for which answers are gathered to be stored together: a transaction takes as long as a short sweep."""
PREFETCH_S = 0.6
"""Work that each worker has in advance: short jobs must not wait for the next one while results are stored."""
MAX_PREFETCHED_JOBS = 256
"""Maximum number of jobs that a worker has in advance: another run may claim what has not been sent."""
LEASE_POLL_INTERVAL_S = 1.0
"""Interval at which sweeps are polled that another run computes."""
MIN_ELAPSED_S = 1e-6
"""Least time that counts as elapsed: a coarse clock may stand still between two answers."""
LOSSES_BEFORE_ISOLATION = 2
"""Lost workers after which a sweep is computed alone, so that it has all the memory."""
ComputedSweep = tuple[Sweep, Result, Mapping[str, ComponentOrigin]]
"""A sweep with its result and the origins of its components, as the store takes it."""
Found = TypeVar("Found")


def discard(results: Sequence[ComputedSweep]) -> str:
    """Return the remedy for results that cannot be stored anywhere."""
    return f"{len(results)} results are lost; run the study again" if results else "run the study again"


@dataclass(frozen=True)
class RunContext:
    """What all sweeps of a run share."""

    run: int
    store: Store
    registry: Registry
    plugins: str
    """Folder of the workspace's own plugins; empty for none."""
    is_rerun: bool
    """Whether sweeps are computed again if their result is older than the run."""
    time: RunTime
    """What its missing sweeps are expected to take; sweeps that end are noted there."""
    retry: DatabaseRetry = field(default_factory=DatabaseRetry)
    spool: Callable[[Sequence[ComputedSweep]], str] = discard
    """Keeps results that the database does not accept elsewhere, and returns the remedy for the user."""


class Heartbeat:
    """Reports to the database that a run is alive, and how far it has come."""

    def __init__(self, store: Store, run: int, total: int, clock: Clock | None = None) -> None:
        self._store, self._run, self._total = store, run, total
        self._clock = clock or Clock()
        self._last = self._clock.now()
        self._sent: RunProgress | None = None
        self.finished_before = 0
        """Sweeps of earlier batches."""

    def beat(self, progress: Progress, workers: int, running: Iterable[tuple[str, float]]) -> None:
        """Send a heartbeat if one is due; `running` are the keys of running sweeps with the fraction that is done."""
        waited = self._clock.now() - self._last
        if waited < PROGRESS_INTERVAL_S:
            return
        done, shown = self.finished_before + progress.done, dict(islice(running, MAX_RUNNING_SHOWN))
        now = RunProgress(done, self._total, workers, shown, progress.doing, *progress.time)
        if now != self._sent or waited > HEARTBEAT_INTERVAL_S:
            self._store.beat(self._run, now)
            self._last, self._sent = self._clock.now(), now


@dataclass(eq=False)
class _SweepGroup:
    """Missing sweeps that share an experiment."""

    number: int
    sweeps: list[Sweep] = field(default_factory=list)
    lost_workers: int = 0
    """Workers that were lost while they computed it."""

    def job(self, plugins: str, registry: Registry, fits: Callable[[Plain], Plain]) -> Job:
        """Return the sweeps as one job, in which `fits` replaces the references to fits of other sweeps."""
        first = self.sweeps[0]
        estimators = tuple(fit_references.replace_references(sweep.estimator, fits) for sweep in self.sweeps)
        experiment = fit_references.replace_references(first.experiment, fits)
        return Job(experiment, estimators, first.files, plugins, local_sources(self.sweeps, registry))


class Computation:
    """Computes sweeps with workers and stores their results."""

    def __init__(
        self,
        sweeps: Sequence[Sweep],
        context: RunContext,
        workers: Workers,
        fits: Callable[[Plain], Plain],
        heartbeat: Heartbeat,
    ) -> None:
        self._context, self._store = context, context.store
        self._clock = context.retry.clock
        self._workers, self._fits, self._heartbeat = workers, fits, heartbeat
        self._numbers = itertools.count()
        self._total = len(sweeps)
        self._pending = deque(self._group(sweeps))
        self._retries: deque[_SweepGroup] = deque()
        """Claimed groups that are sent once more."""
        self._isolated: deque[_SweepGroup] = deque()
        """Claimed groups that are sent when nothing else is running."""
        self._held_elsewhere: list[Sweep] = []
        """Sweeps that another run has claimed."""
        self._running: dict[int, _SweepGroup] = {}
        self._fractions: dict[int, float] = {}
        self._compiling: dict[int, str] = {}
        """What running jobs compile, by the number of the job."""
        self._announced: set[str] = set()
        self._answers: queue.SimpleQueue[tuple[_SweepGroup, Future[Answer]]] = queue.SimpleQueue()
        self._answered: list[tuple[Sweep, Result | Failure]] = []
        self._finished = 0
        self._stored_at = self._polled_at = self._reported_at = self._clock.now()
        self._seconds = math.inf
        """Approximate duration of a job; infinite until it is known."""

    def events(self) -> Generator[Event, None, None]:
        """Compute all sweeps and yield events; what is finished is stored even if the run is interrupted.

        While the database is unavailable results are kept in memory, and workers go on.
        """
        try:
            yield from self._events()
        except (GeneratorExit, KeyboardInterrupt):
            self._store_last()
            raise
        except StoreError as error:
            raise self._given_up(error) from error
        except FraexpError:  # of the workers: nothing more is computed, but what has been is kept
            self._store_last()
            raise

    def _events(self) -> Iterator[Event]:
        while (
            self._pending or self._retries or self._isolated or self._running or self._held_elsewhere or self._answered
        ):
            yield from self._send_jobs()
            self._collect_answers()
            yield from self._store_answers()
            yield from self._poll_held()
            yield from (Noticed(text) for text in self._workers.notes())
            yield from self._report_compilation()
            if self._clock.now() - self._reported_at > POLL_INTERVAL_S:
                yield from self._report_progress()
        yield from self._report_progress()

    def _retried(self, attempt: Callable[[], Found]) -> Generator[Event, None, Found]:
        """Return what a call of the store returns; while the database is unavailable, workers go on."""
        return (yield from self._context.retry.call(attempt, self._pause))

    def _pause(self, seconds: float) -> Iterator[Event]:
        until = self._clock.now() + seconds
        while self._clock.now() < until:
            self._collect_answers()
            yield self._progress(WAITING_TEXT)

    def _group(self, sweeps: Iterable[Sweep]) -> list[_SweepGroup]:
        groups: dict[str, _SweepGroup] = {}
        for sweep in sweeps:
            if sweep.experiment_key not in groups:
                groups[sweep.experiment_key] = _SweepGroup(next(self._numbers))
            groups[sweep.experiment_key].sweeps.append(sweep)
        return list(groups.values())

    def _send_jobs(self) -> Iterator[Event]:
        """Send each worker a little more than it computes; other runs may claim the rest."""
        limit = self._max_running()
        while self._retries and len(self._running) < limit:
            self._submit(self._retries.popleft())
        room = limit - len(self._running)
        if self._pending and (room >= limit // 4 or not self._running):
            groups = [self._pending.popleft() for _ in range(min(max(room, 1), len(self._pending)))]
            for group in (yield from self._claim(groups)):
                self._submit(group)
        if self._isolated and not (self._running or self._pending or self._retries):
            self._submit(self._isolated.popleft())

    def _max_running(self) -> int:
        ahead = min(max(PREFETCH_S / self._seconds, 1.0), MAX_PREFETCHED_JOBS)
        return math.ceil(max(self._workers.count, 1) * (1 + ahead))

    def _claim(self, groups: Sequence[_SweepGroup]) -> Generator[Event, None, list[_SweepGroup]]:
        """Claim sweeps and return those that this run computes; the others are held by another run, or done."""
        keys = {sweep.key for group in groups for sweep in group.sweeps}
        context = self._context
        ours = yield from self._retried(lambda: self._store.claim(context.run, keys, context.is_rerun))
        if len(ours) < len(keys):
            self._held_elsewhere += [sweep for group in groups for sweep in group.sweeps if sweep.key not in ours]
            self._polled_at = -math.inf
        for group in groups:
            group.sweeps = [sweep for sweep in group.sweeps if sweep.key in ours]
        return [group for group in groups if group.sweeps]

    def _poll_held(self) -> Iterator[Event]:
        """Take over sweeps that other runs have given up, and reuse those that they have computed."""
        if not self._held_elsewhere or self._clock.now() - self._polled_at < LEASE_POLL_INTERVAL_S:
            return
        held, self._held_elsewhere = self._held_elsewhere, []
        self._retries += yield from self._claim(self._group(held))
        self._polled_at = self._clock.now()
        if not self._held_elsewhere:
            return
        keys = [sweep.key for sweep in self._held_elsewhere]
        holding_runs = yield from self._retried(lambda: self._store.lease_holders(keys))
        free = [key for key in keys if key not in holding_runs]
        done = yield from self._retried(lambda: self._store.stored_states(free))
        reused = [sweep for sweep in self._held_elsewhere if sweep.key in done]
        self._held_elsewhere = [sweep for sweep in self._held_elsewhere if sweep.key not in done]
        if reused:
            yield from self._retried(lambda: self._store.reuse(self._context.run, [sweep.key for sweep in reused]))
            self._finished += len(reused)
            for sweep in reused:
                self._context.time.finish(sweep)
            yield from (Finished(sweep, None, "reused") for sweep in reused)
        if holding_runs and not (self._running or self._pending or self._retries):
            runs = ", ".join(str(run) for run in sorted(set(holding_runs.values())))
            yield Preparing(f"waiting for sweeps that run {runs} computes: {len(self._held_elsewhere)}")

    def _submit(self, group: _SweepGroup) -> None:
        self._running[group.number] = group
        job = group.job(self._context.plugins, self._context.registry, self._fits)
        future = self._workers.submit(group.number, job)
        future.add_done_callback(lambda future: self._answers.put((group, future)))

    def _collect_answers(self) -> None:
        """Accept the answers that have arrived, or wait for the first one for a poll interval."""
        timeout: float | None = POLL_INTERVAL_S
        while True:
            try:
                group, future = self._clock.next_item(self._answers, timeout) if timeout else self._answers.get_nowait()
            except queue.Empty:
                break
            timeout = None
            del self._running[group.number]
            self._fractions.pop(group.number, None)
            self._compiling.pop(group.number, None)
            self._accept(group, future)
        for number, fraction in self._workers.reports():
            if number in self._running:
                self._fractions[number] = fraction

    def _report_compilation(self) -> Iterator[Event]:
        """Report once for each friction law that it is being compiled."""
        for number, laws in self._workers.compilations():
            self._compiling.pop(number, None)
            if not laws or number not in self._running:
                continue
            text = self._compiling[number] = f"compiling friction law {laws}"
            if text not in self._announced:
                self._announced.add(text)
                yield Preparing(f"{text} (once per machine)")

    def _accept(self, group: _SweepGroup, future: "Future[Answer]") -> None:
        error = future.exception()
        if error is None:
            self._answered += zip(group.sweeps, future.result(), strict=True)
        elif isinstance(error, WorkerLostError):
            self._retry(group, error)
        else:
            message = f"{type(error).__name__}: {error}"
            self._reject(group, message, "".join(traceback.format_exception(error)))

    def _reject(self, group: _SweepGroup, message: str, log: str = "") -> None:
        self._answered += [(sweep, Failure(message, log)) for sweep in group.sweeps]

    def _retry(self, group: _SweepGroup, error: WorkerLostError) -> None:
        """Retry a group whose worker was lost; it has failed if a third worker is lost while it is computed alone."""
        if error.estimator is not None and len(group.sweeps) > 1:  # the other estimators are not to blame
            others = [sweep for at, sweep in enumerate(group.sweeps) if at != error.estimator]
            self._retries.append(_SweepGroup(next(self._numbers), others, group.lost_workers))
            group = _SweepGroup(next(self._numbers), [group.sweeps[error.estimator]], group.lost_workers)
        group.lost_workers += 1
        if not error.is_retryable:
            self._reject(group, str(error))
        elif group.lost_workers < LOSSES_BEFORE_ISOLATION:
            self._retries.append(group)
        elif group.lost_workers == LOSSES_BEFORE_ISOLATION:
            self._isolated += (_SweepGroup(next(self._numbers), [sweep], group.lost_workers) for sweep in group.sweeps)
        else:
            self._reject(group, f"{error}, the {group.lost_workers}rd time; the last time it was computed alone")

    def _store_answers(self) -> Iterator[Event]:
        """Store all answers, then yield their events."""
        now = self._clock.now()
        if not self._answered or (now - self._stored_at < GATHER_INTERVAL_S and (self._running or self._pending)):
            return
        pairs = list(self._answered)
        elapsed = max(now - self._stored_at, MIN_ELAPSED_S)
        self._seconds = max(self._workers.count, 1) * elapsed / len(pairs)
        stored = yield from self._retried(lambda: self._store_pairs(pairs))
        del self._answered[: len(pairs)]  # more have arrived if the database was unavailable
        self._stored_at = self._clock.now()
        yield from self._release_overtaken([sweep for sweep, _ in pairs if sweep.key not in stored])
        finished = [(sweep, found) for sweep, found in pairs if sweep.key in stored]
        self._finished += len(finished)
        for sweep, found in finished:
            self._context.time.finish(sweep, found.elapsed if isinstance(found, Result) else None)
            if isinstance(found, Failure):
                yield Finished(sweep, None, "failed", found.message)
            else:
                yield Finished(sweep, found, "computed")

    def _release_overtaken(self, sweeps: Sequence[Sweep]) -> Iterator[Event]:
        """Wait for sweeps that other runs have taken over, because this run sent no heartbeat."""
        if sweeps:
            yield Noticed(f"other runs took over sweeps while this run was silent: {len(sweeps)}")
            self._held_elsewhere += sweeps
            self._polled_at = -math.inf

    def _store_pairs(self, pairs: Sequence[tuple[Sweep, Result | Failure]]) -> set[str]:
        """Store answers and return the keys that are stored; the other sweeps have been taken over by other runs."""
        run, stored = self._context.run, set[str]()
        if good := self._computed_sweeps(pairs):
            stored |= self._store.save(run, good, is_fenced=True)
        for sweep, found in pairs:
            if isinstance(found, Failure) and self._store.fail(run, sweep.key, found.message, found.log, True):
                stored.add(sweep.key)
        return stored

    def _computed_sweeps(self, pairs: Sequence[tuple[Sweep, Result | Failure]]) -> list[ComputedSweep]:
        registry = self._context.registry
        return [
            (sweep, found, component_origins(sweep, registry)) for sweep, found in pairs if isinstance(found, Result)
        ]

    def _store_last(self) -> None:
        """Store the answers of an interrupted run, which does not wait for the database."""
        try:
            self._store_pairs(self._answered)
        except StoreError as error:
            raise self._given_up(error) from error
        self._answered = []

    def _given_up(self, error: StoreError) -> StoreError:
        """Keep the answers that are not stored elsewhere, and return the error with the remedy."""
        results, self._answered = self._computed_sweeps(self._answered), []
        return type(error)(f"{error}; {self._context.spool(results)}") if results else error

    def _report_progress(self) -> Iterator[Event]:
        """Yield the progress, and send it to the database."""
        self._reported_at = self._clock.now()
        progress = self._progress(self._workers.status() or next(iter(self._compiling.values()), ""))
        running = [(sweep.key, part) for sweep, part in self._parts_done()]
        yield from self._retried(lambda: self._heartbeat.beat(progress, self._workers.count, running))
        yield progress

    def _parts_done(self) -> list[tuple[Sweep, float]]:
        """Return the running sweeps, each with the fraction of its experiment that is done."""
        return [(sweep, part) for number, part in self._fractions.items() for sweep in self._running[number].sweeps]

    def _progress(self, doing: str) -> Progress:
        running = self._parts_done()
        done = self._finished + len(self._answered) + sum(part for _, part in running)
        time = self._context.time.left(self._workers.count, running)
        return Progress(done, self._total, len(running), doing, time)
