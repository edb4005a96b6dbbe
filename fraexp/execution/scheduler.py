"""Runs of a study: missing sweeps are computed, stored ones are reused, and events report the progress."""

import shlex
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

from fraexp.components.registry import Registry
from fraexp.data import fit_references
from fraexp.data.results import UNUSABLE_OUTCOMES
from fraexp.data.sweep import Plain, Sweep
from fraexp.errors import FraexpError, StoreError, StudyError, UnavailableError, did_you_mean
from fraexp.execution.computation import Computation, ComputedSweep, Heartbeat, RunContext
from fraexp.execution.database_retry import DatabaseRetry
from fraexp.execution.events import Begun, Ended, Event, Finished, Noticed, Planned, Preparing, Progress, TimeLeft
from fraexp.execution.executors import ResourceLimits, Workers, create_workers, worker_count
from fraexp.execution.explain import Origins, reasons
from fraexp.execution.run_time import PROCESSES, choose_executor, run_time_of
from fraexp.store import Store, StoredState
from fraexp.study.study_file import ResolvedStudy

MAX_EXPLAINED_SWEEPS = 2000
"""Maximum number of sweeps for which a run says by itself why nothing is reused."""


class RunOptions(NamedTuple):
    """Where the sweeps of a run are computed, which of them, and within which limits."""

    executor: str | None = None
    """Such as ``serial`` or ``processes:4``; None for one that suits the sweeps and the limits."""
    rerun: str | None = None
    """Which stored sweeps are computed again: None, ``stale``, ``unusable`` or ``all``."""
    limits: ResourceLimits = ResourceLimits()

    def check(self) -> None:
        """Raise StudyError if there is no such executor, or if it cannot enforce the limits."""
        worker_count(self.executor or PROCESSES)
        self.limits.check(self.executor)


def plan(
    study: ResolvedStudy, store: Store | None, registry: Registry, options: RunOptions, explain: bool = False
) -> tuple[list[Sweep], Planned]:
    """Return the sweeps to compute, and the plan; if `explain`, it gives the reason of each sweep."""
    executor, rerun, limits = options
    known = store.stored_states([sweep.key for sweep in study.sweeps]) if store else {}
    stale = _changed_components(study.sweeps, known, registry)
    unusable = {key for key, state in known.items() if state.outcome in UNUSABLE_OUTCOMES}
    classes = {"stale": set(stale), "unusable": unusable, "all": set(known)}
    if rerun is not None and rerun not in classes:
        raise StudyError(f"there is no class of sweeps '{rerun}' to compute again{did_you_mean(rerun, classes)}")
    again = classes.get(rerun or "", set[str]())
    missing = [sweep for sweep in study.sweeps if sweep.key not in known or sweep.key in again]
    reused = len(study.sweeps) - len(missing)
    kept = len(set(stale) - again)
    planned = Planned(study.name, study.title, len(study.sweeps), reused, len(missing), kept, TimeLeft(0.0))
    if missing:
        time = run_time_of(missing, store)
        needs_process = limits.memory is not None
        chosen = executor or (PROCESSES if needs_process else choose_executor(missing, time.left(workers=1)))
        planned = replace(planned, time=time.left(worker_count(chosen)), executor=chosen)
    if not explain:
        return missing, planned
    whys = reasons(study.sweeps, known, again, stale, store, study.name, registry)
    return missing, replace(planned, whys=whys)


def _changed_components(
    sweeps: Sequence[Sweep], known: Mapping[str, StoredState], registry: Registry
) -> dict[str, list[str]]:
    """Return the components whose source has changed since a stored sweep was computed, by the key of the sweep."""
    origins = Origins(registry)
    stored = ((sweep, known[sweep.key]) for sweep in sweeps if sweep.key in known)
    return {sweep.key: changed for sweep, state in stored if (changed := origins.changed(sweep, state))}


def run(
    study: ResolvedStudy,
    store: Store,
    registry: Registry,
    options: RunOptions,
    *,
    command: str,
    provenance: Plain,
    plugins: str,
) -> Generator[Event, None, None]:
    """Compute the missing sweeps of a study and yield events; closing the iterator interrupts the run.

    Without an executor all cores are used, unless worker processes would start too late to help.
    """
    retry = DatabaseRetry(timeout=options.limits.database)
    missing, planned = yield from retry.call(lambda: plan(study, store, registry, options))
    yield planned
    for text in filter(None, (_repeats_text(study), store.advice)):
        yield Noticed(text)
    yield from (yield from retry.call(lambda: list(_notice_new_versions(study, planned, store, registry))))
    time = yield from retry.call(lambda: run_time_of(missing, store))
    # Workers are created before the run is recorded, because the executor may refuse; without sweeps none are needed.
    with create_workers(planned.executor, len(missing), options.limits) if missing else nullcontext() as workers:
        facts = {**provenance, "run_id": uuid4().hex}
        number = yield from begin_run(study, store, command, facts, retry)
        spool = Spool(study, command, facts, Path(plugins).parent if plugins else Path.cwd())
        context = RunContext(
            number, store, registry, plugins, options.rerun is not None, time, retry, spool.keep_results
        )
        state = yield from compute_recorded(study, missing, context, workers)
    yield Ended(number, state)


def _repeats_text(study: ResolvedStudy) -> str:
    """Return how many points of a grid are none of their own; empty if all are."""
    if not study.repeated:
        return ""
    points = f"{study.repeated:,} of {len(study.sweeps) + study.repeated:,} points of the grid"
    return f"{points} repeat another one, and are one sweep with it"


def _notice_new_versions(study: ResolvedStudy, planned: Planned, store: Store, registry: Registry) -> Iterator[Noticed]:
    """Yield why nothing is reused if earlier versions of components have computed the study's stored sweeps."""
    if planned.reused or not 0 < planned.total <= MAX_EXPLAINED_SWEEPS:
        return
    if not any(run.study == study.name for run in store.runs()):
        return
    for why in reasons(study.sweeps, {}, (), {}, store, study.name, registry):
        if any(path.endswith(".version") for path in why.paths):
            count = f"{len(why.sweeps):,} of {planned.total:,}"
            yield Noticed(f"nothing is reused, because components have changed: {count}: {why.reason}")


def begin_run(
    study: ResolvedStudy, store: Store, command: str, provenance: Plain, retry: DatabaseRetry
) -> Generator[Event, None, int]:
    """Record a run, and return its number; with a `run_id` in its provenance a repeated call records it once."""
    return (
        yield from retry.call(lambda: store.begin_run(study.name, str(study.file), command, provenance, study.sweeps))
    )


@dataclass(frozen=True)
class Spool:
    """A file for results that the database does not accept, which `fraexp merge` reads."""

    study: ResolvedStudy
    command: str
    provenance: Plain
    folder: Path

    def keep_results(self, results: Sequence[ComputedSweep]) -> str:
        """Write results to a new database file and return the remedy for the user."""
        count = "1 result is" if len(results) == 1 else f"{len(results)} results are"
        file = self.folder / f"kept-{self.provenance['run_id'][:8]}.db"
        try:
            with Store.open(str(file), create=True) as store:
                sweeps = [sweep for sweep, _, _ in results]
                number = store.begin_run(self.study.name, str(self.study.file), self.command, self.provenance, sweeps)
                store.save(number, results)
                store.end_run(number, "interrupted")
        except StoreError as error:
            return f"{count} lost, because {error}"
        return f"{count} kept in {file}; 'fraexp merge {shlex.quote(str(file))}' adds them to the database"


def compute_recorded(
    study: ResolvedStudy, missing: Sequence[Sweep], context: RunContext, workers: Workers | None
) -> Generator[Event, None, str]:
    """Compute the missing sweeps of a recorded run and return its final state, which is stored if that is possible."""
    retry = context.retry
    computed = {sweep.key for sweep in missing}
    reused = [sweep for sweep in study.sweeps if sweep.key not in computed]
    failures = 0
    try:
        yield Begun(context.run)
        if reused:
            yield from retry.call(lambda: context.store.reuse(context.run, [sweep.key for sweep in reused]))
        for sweep in reused:
            yield Finished(sweep, None, "reused")
        if workers:
            yield Preparing("1 worker" if workers.count == 1 else f"{workers.count} workers")
            with closing(_compute_batches(missing, context, workers)) as events:
                for event in events:
                    if isinstance(event, Finished):
                        failures += event.state == "failed"
                    yield event
        state = "partial" if failures else "complete"
        yield from retry.call(lambda: context.store.end_run(context.run, state))
    except BaseException as error:
        # A FraexpError is the end of those who compute, such as a cluster, or of the database: then readers see from
        # the end of this process that the run has ended.
        with suppress(StoreError) if isinstance(error, StoreError) else suppress(UnavailableError):
            context.store.end_run(context.run, "partial" if isinstance(error, FraexpError) else "interrupted")
        raise
    return state


def _compute_batches(missing: Sequence[Sweep], context: RunContext, workers: Workers) -> Generator[Event, None, None]:
    """Compute sweeps in batches: each after those whose fits it refers to."""
    done = 0
    heartbeat = Heartbeat(context.store, context.run, len(missing), context.retry.clock)
    for batch in fit_references.topological_batches(list(missing)):
        fits = StoredFits(context.store)
        ready, blocked = yield from context.retry.call(partial(_split_by_fits, batch, fits))
        for sweep, reason in blocked:
            yield from context.retry.call(partial(context.store.fail, context.run, sweep.key, reason, ""))
            context.time.finish(sweep)
            yield Finished(sweep, None, "failed", reason)
        # An iterator that is only dropped could not report that its last results were not stored.
        with closing(Computation(ready, context, workers, fits.component, heartbeat).events()) as events:
            for event in events:
                if isinstance(event, Progress):
                    event = replace(event, done=done + event.done, total=len(missing))  # noqa: PLW2901
                yield event
        done += len(batch)
        heartbeat.finished_before = done


class StoredFits:
    """The components that earlier sweeps have identified; each result is read once."""

    def __init__(self, store: Store) -> None:
        self._result = cache(lambda key: store.results([key]).get(key))

    def component(self, reference: Plain) -> Plain:
        """Return the component that a reference stands for; it must exist."""
        result = self._result(str(reference[fit_references.OF]))
        return next(
            fit.component for fit in (result.fits if result else ()) if fit.kind == reference[fit_references.FIT]
        )

    def missing_reason(self, reference: Plain) -> str:
        """Return why the component of a reference is missing; empty if it exists."""
        key, kind = str(reference[fit_references.OF]), reference[fit_references.FIT]
        result = self._result(key)
        if result is not None and any(fit.kind == kind for fit in result.fits):
            return ""
        why = "has no result" if result is None else result.message or "identifies none"
        return f"it needs the {kind} that sweep {key[4:12]} identifies, which {why}"


def _split_by_fits(sweeps: Sequence[Sweep], fits: StoredFits) -> tuple[list[Sweep], list[tuple[Sweep, str]]]:
    """Return the sweeps whose fits exist, and each of the others with the reason why it cannot be computed."""
    ready, blocked = [], []
    for sweep in sweeps:
        wanted = fit_references.references_in([sweep.experiment, sweep.estimator])
        reasons = [reason for reference in wanted if (reason := fits.missing_reason(reference))]
        if reasons:
            blocked.append((sweep, reasons[0]))
        else:
            ready.append(sweep)
    return ready, blocked
