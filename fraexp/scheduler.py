"""Running a study: what is missing is computed, what is there is reused; events tell how it goes."""

import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from statistics import median

from fraexp import references
from fraexp.executors import Answer, Workers
from fraexp.perform import Failure, Job
from fraexp.plugins import Registry
from fraexp.results import Outcome, Result
from fraexp.store import Store, StoredState, Supplied
from fraexp.study import Study
from fraexp.sweep import Plain, Sweep

BEAT = 5.0
"""Seconds between two signs of life in the database."""
POLL = 0.1
"""Seconds between two looks at the workers."""
GATHER = 0.2
"""Seconds for which results are gathered, to be stored together: a transaction takes as long as a short sweep."""
AHEAD = 16
"""Jobs that are sent ahead to each worker: short ones must not wait for the next while others are stored."""
FRUITLESS = (Outcome.NO_SIGNAL, Outcome.DIVERGED, Outcome.FAILED)
"""Outcomes that ``rerun = "failed"`` computes again."""
GUESS = 0.1
"""Seconds assumed for a sweep when nothing like it has been computed yet."""
SHORT = 1.0
"""Seconds of work that one process does itself: to start others takes as long."""


@dataclass(frozen=True)
class Planned:
    """What a run will do."""

    study: str
    title: str
    total: int
    reused: int
    missing: int
    stale: int
    """Sweeps that are reused although a plugin's source has changed since."""
    seconds: float | None
    """Expected time [s]; None if nothing is missing."""


@dataclass(frozen=True)
class Preparing:
    """Something that takes its time before the first sweep."""

    what: str


@dataclass(frozen=True)
class Progress:
    """Sweeps done, with the fraction of those that are running."""

    done: float
    total: float


@dataclass(frozen=True)
class Finished:
    """One sweep has come to its end: `computed`, `reused` or `failed`."""

    sweep: Sweep
    result: Result | None
    state: str
    error: str = ""


@dataclass(frozen=True)
class Ended:
    """The run is over: `complete`, `partial`, `interrupted` or `dry`."""

    run: int | None
    state: str
    figures: tuple[Path, ...] = ()
    """Files that show the sweeps, one for each unit of their responses."""
    note: str = ""
    """Why there is no figure, where there should be one."""


Event = Planned | Preparing | Progress | Finished | Ended


@dataclass
class _Group:
    """Missing sweeps that share an experiment."""

    number: int
    sweeps: list[Sweep] = field(default_factory=list)
    attempts: int = 0

    def job(self, plugins: str, fits: Callable[[Plain], Plain]) -> Job:
        """Return them as one job, with the fits that they refer to."""
        first = self.sweeps[0]
        estimators = tuple(references.replaced(sweep.estimator, fits) for sweep in self.sweeps)
        return Job(references.replaced(first.experiment, fits), estimators, first.files, plugins)


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


def plan(study: Study, store: Store | None, registry: Registry, rerun: str | None) -> "tuple[list[Sweep], Planned]":
    """Return the sweeps to compute, and the plan; `rerun` is None, ``stale``, ``failed`` or ``all``."""
    known = store.known([sweep.key for sweep in study.sweeps]) if store else {}
    stale = _stale(study.sweeps, known, registry)
    fruitless = {key for key, state in known.items() if state.outcome in FRUITLESS}
    again = {None: set[str](), "stale": stale, "failed": fruitless, "all": set(known)}[rerun]
    missing = [sweep for sweep in study.sweeps if sweep.key not in known or sweep.key in again]
    reused = len(study.sweeps) - len(missing)
    times = [state.elapsed for state in known.values() if state.elapsed > 0]
    seconds = len(missing) * (median(times) if times else GUESS) if missing else None
    kept = len(stale - {sweep.key for sweep in missing})
    return missing, Planned(study.name, study.title, len(study.sweeps), reused, len(missing), kept, seconds)


def _stale(sweeps: Sequence[Sweep], known: Mapping[str, StoredState], registry: Registry) -> set[str]:
    result = set()
    for sweep in sweeps:
        if sweep.key in known:
            now = {name: supply.source_hash for name, supply in components_of(sweep, registry).items()}
            if any(known[sweep.key].sources.get(name, value) != value for name, value in now.items()):
                result.add(sweep.key)
    return result


def run(
    study: Study,
    store: Store,
    registry: Registry,
    *,
    executor: str | None,
    rerun: str | None,
    command: str,
    provenance: Plain,
    plugins: str,
) -> Iterator[Event]:
    """Compute what is missing of a study and yield events; closing the iterator interrupts the run.

    Without an `executor` all cores are used, unless the work is done before other processes would be there.
    """
    missing, planned = plan(study, store, registry, rerun)
    yield planned
    executor = executor or ("processes" if (planned.seconds or 0.0) > SHORT else "serial")
    number = store.begin_run(study.name, str(study.file), command, provenance, study.sweeps)
    computed = {sweep.key for sweep in missing}
    reused = [sweep for sweep in study.sweeps if sweep.key not in computed]
    state = "interrupted"
    try:
        store.reuse(number, [sweep.key for sweep in reused])
        for sweep in reused:
            yield Finished(sweep, None, "reused")
        failures = 0
        done = 0
        for turn in references.in_turn(missing):
            fits = _Fits(store)
            ready, lacking = _with_fits(turn, fits)
            for sweep, reason in lacking:
                store.fail(number, sweep.key, reason, "")
                yield Finished(sweep, None, "failed", reason)
            failures += len(lacking)
            for event in _compute(ready, store, registry, number, executor, plugins, fits) if ready else ():
                failures += isinstance(event, Finished) and event.state == "failed"
                yield Progress(done + event.done, len(missing)) if isinstance(event, Progress) else event
            done += len(turn)
        state = "partial" if failures else "complete"
    finally:
        store.end_run(number, state)
    yield Ended(number, state)


class _Fits:
    """What earlier sweeps have identified, each looked up once."""

    def __init__(self, store: Store) -> None:
        self._result = cache(lambda key: store.results([key]).get(key))

    def component(self, reference: Plain) -> Plain:
        """Return the component that a reference stands for."""
        result = self._result(str(reference[references.OF]))
        return next(fit.component for fit in (result.fits if result else ()) if fit.kind == reference[references.WORD])

    def lack(self, reference: Plain) -> str:
        """Return why there is no such component; empty if there is."""
        key, kind = str(reference[references.OF]), reference[references.WORD]
        result = self._result(key)
        if result is not None and any(fit.kind == kind for fit in result.fits):
            return ""
        why = "has no result" if result is None else result.message or "identifies none"
        return f"it needs the {kind} that sweep {key[4:12]} identifies, which {why}"


def _with_fits(sweeps: Sequence[Sweep], fits: _Fits) -> tuple[list[Sweep], list[tuple[Sweep, str]]]:
    """Return the sweeps whose fits are there, and the others with what they lack."""
    ready, lacking = [], []
    for sweep in sweeps:
        wanted = references.found_in([sweep.experiment, sweep.estimator])
        reasons = [reason for reference in wanted if (reason := fits.lack(reference))]
        if reasons:
            lacking.append((sweep, reasons[0]))
        else:
            ready.append(sweep)
    return ready, lacking


def _compute(
    missing: Sequence[Sweep], store: Store, registry: Registry, run: int, executor: str, plugins: str, fits: _Fits
) -> Iterator[Event]:
    groups: dict[str, _Group] = {}
    for sweep in missing:
        groups.setdefault(sweep.experiment_key, _Group(len(groups))).sweeps.append(sweep)
    waiting, running = deque(groups.values()), dict[Future[Answer], _Group]()
    sizes = {group.number: len(group.sweeps) for group in waiting}
    fractions: dict[int, float] = {}
    beaten = stored = time.monotonic()
    answered: list[tuple[_Group, Answer]] = []
    with Workers(executor, len(waiting)) as workers:
        yield Preparing(f"{workers.count} at once; a friction law that is new to this machine is compiled first")
        while waiting or running:
            while waiting and len(running) < _most_at_once(waiting[0], running.values(), workers.count):
                group = waiting.popleft()
                job = group.job(plugins, fits.component)
                running[workers.submit(group.number, job)] = group
            done, _ = wait(running, POLL, FIRST_COMPLETED)
            fractions.update(workers.reports())
            for future in done:
                group = running.pop(future)
                if isinstance(future.exception(), BrokenProcessPool) and not group.attempts:
                    group.attempts += 1  # a worker died: it may have been another group's
                    workers.renew()
                    waiting.appendleft(group)
                    continue
                fractions[group.number] = 1.0
                answered.append((group, _answers(future, group)))
            if answered and (time.monotonic() - stored > GATHER or not (waiting or running)):
                yield from _stored(answered, store, registry, run)
                answered, stored = [], time.monotonic()
            if time.monotonic() - beaten > BEAT:
                store.beat(run)
                beaten = time.monotonic()
            yield Progress(sum(sizes[number] * part for number, part in fractions.items()), len(missing))


def _answers(future: "Future[Answer]", group: _Group) -> Answer:
    error = future.exception()
    if error is None:
        return future.result()
    died = "its worker process died twice (killed, or out of memory); lower the number of processes"
    message = died if isinstance(error, BrokenProcessPool) else f"{type(error).__name__}: {error}"
    return [Failure(message, "".join(traceback.format_exception(error)))] * len(group.sweeps)


def _most_at_once(following: _Group, running: Iterable[_Group], workers: int) -> int:
    """Return how many jobs may be under way; what was there when a worker died is tried again alone."""
    suspected = following.attempts or any(group.attempts for group in running)
    return 1 if suspected else AHEAD * workers


def _stored(
    answered: Sequence[tuple[_Group, Answer]], store: Store, registry: Registry, run: int
) -> Iterator[Finished]:
    """Store what jobs have answered, all of it in one transaction, then tell."""
    pairs = [pair for group, answers in answered for pair in zip(group.sweeps, answers, strict=True)]
    good = [(sweep, answer, components_of(sweep, registry)) for sweep, answer in pairs if isinstance(answer, Result)]
    if good:
        store.save(run, good)
    for sweep, answer in pairs:
        if isinstance(answer, Failure):
            store.fail(run, sweep.key, answer.message, answer.log)
            yield Finished(sweep, None, "failed", answer.message)
        else:
            yield Finished(sweep, answer, "computed")
