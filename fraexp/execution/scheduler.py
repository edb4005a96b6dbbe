"""Running a study: what is missing is computed, what is there is reused; events tell how it goes."""

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import cache

from fraexp.components.registry import Registry
from fraexp.data import fit_references
from fraexp.data.sweep import Plain, Sweep
from fraexp.errors import FraexpError
from fraexp.execution.computation import Computation, Pulse, Setting
from fraexp.execution.estimates.estimate import estimate
from fraexp.execution.estimates.learning import Lessons
from fraexp.execution.estimates.speeds import read_speeds
from fraexp.execution.events import Begun, Ended, Event, Finished, Noticed, Planned, Preparing, Progress
from fraexp.execution.executors import ResourceLimits, Workers, make
from fraexp.execution.explain import FRUITLESS, Origins, reasons
from fraexp.store import Store, StoredState
from fraexp.study.study_file import Study


def plan(
    study: Study,
    store: Store | None,
    registry: Registry,
    rerun: str | None,
    explain: bool = False,
    executor: str | None = None,
    limits: ResourceLimits | None = None,
) -> "tuple[list[Sweep], Planned]":
    """Return the sweeps to compute, and the plan; `rerun` is None, ``stale``, ``failed`` or ``all``.

    With `explain` the plan says why. Its time is that of the `executor`, by default the faster one within `limits`.
    """
    known = store.known([sweep.key for sweep in study.sweeps]) if store else {}
    stale = _stale(study.sweeps, known, registry)
    fruitless = {key for key, state in known.items() if state.outcome in FRUITLESS}
    again = {None: set[str](), "stale": set(stale), "failed": fruitless, "all": set(known)}[rerun]
    missing = [sweep for sweep in study.sweeps if sweep.key not in known or sweep.key in again]
    reused = len(study.sweeps) - len(missing)
    kept = len(set(stale) - again)
    planned = Planned(study.name, study.title, len(study.sweeps), reused, len(missing), kept, None)
    if missing:
        found = estimate(missing, registry, read_speeds(), executor, limits)
        planned = replace(planned, seconds=found.seconds, compiling=found.compiling, executor=found.executor)
    if not explain:
        return missing, planned
    whys = reasons(study.sweeps, known, again, stale, store, study.name, registry)
    return missing, replace(planned, whys=whys)


def _stale(sweeps: Sequence[Sweep], known: Mapping[str, StoredState], registry: Registry) -> dict[str, list[str]]:
    """Return the keys of stored sweeps that other sources have computed, with the components concerned."""
    origins = Origins(registry)
    stored = ((sweep, known[sweep.key]) for sweep in sweeps if sweep.key in known)
    return {sweep.key: changed for sweep, state in stored if (changed := origins.changed(sweep, state))}


def run(
    study: Study,
    store: Store,
    registry: Registry,
    *,
    executor: str | None,
    limits: ResourceLimits | None = None,
    rerun: str | None,
    command: str,
    provenance: Plain,
    plugins: str,
) -> Iterator[Event]:
    """Compute what is missing of a study and yield events; closing the iterator interrupts the run.

    Without an `executor` all cores are used, unless one process is expected to be done before.
    """
    limits = limits or ResourceLimits()
    missing, planned = plan(study, store, registry, rerun, executor=executor, limits=limits)
    yield planned
    if store.advice:
        yield Noticed(store.advice)
    lessons = Lessons(registry)
    # Before a run is recorded, for it may be refused; what has nothing to compute needs none.
    with make(planned.executor, len(missing), limits) if missing else nullcontext() as workers:
        number = store.begin_run(study.name, str(study.file), command, provenance, study.sweeps)
        setting = Setting(number, store, registry, plugins, rerun is not None, planned.compiling)
        state = yield from _recorded(study, missing, setting, workers, lessons)
    lessons.learn(planned.executor)
    yield Ended(number, state)


def _recorded(
    study: Study, missing: Sequence[Sweep], setting: Setting, workers: Workers | None, lessons: Lessons
) -> Generator[Event, None, str]:
    """Compute the sweeps of a run that has been begun, and return how it ended; the database has that in any case."""
    computed = {sweep.key for sweep in missing}
    reused = [sweep for sweep in study.sweeps if sweep.key not in computed]
    state, failures = "interrupted", 0
    try:
        yield Begun(setting.run)
        setting.store.reuse(setting.run, [sweep.key for sweep in reused])
        for sweep in reused:
            yield Finished(sweep, None, "reused")
        if workers:
            yield Preparing("1 worker" if workers.count == 1 else f"{workers.count} workers")
            for event in _in_turn(missing, setting, workers):
                if isinstance(event, Finished):
                    failures += event.state == "failed"
                    lessons.take(event.sweep, event.result)
                yield event
        state = "partial" if failures else "complete"
    except FraexpError:  # nothing can be computed any more, such as when a cluster is gone
        state = "partial"
        raise
    finally:
        setting.store.end_run(setting.run, state)
    return state


def _in_turn(missing: Sequence[Sweep], setting: Setting, workers: Workers) -> Iterator[Event]:
    """Compute sweeps, after those whose fits they refer to."""
    done = 0
    pulse = Pulse(setting.store, setting.run, len(missing))
    for turn in fit_references.in_turn(list(missing)):
        fits = _Fits(setting.store)
        ready, lacking = _with_fits(turn, fits)
        for sweep, reason in lacking:
            setting.store.fail(setting.run, sweep.key, reason, "")
            yield Finished(sweep, None, "failed", reason)
        for event in Computation(ready, setting, workers, fits.component, pulse).events():
            yield replace(event, done=done + event.done, total=len(missing)) if isinstance(event, Progress) else event
        done += len(turn)
        pulse.before = done


class _Fits:
    """What earlier sweeps have identified, each looked up once."""

    def __init__(self, store: Store) -> None:
        self._result = cache(lambda key: store.results([key]).get(key))

    def component(self, reference: Plain) -> Plain:
        """Return the component that a reference stands for."""
        result = self._result(str(reference[fit_references.OF]))
        return next(
            fit.component for fit in (result.fits if result else ()) if fit.kind == reference[fit_references.WORD]
        )

    def lack(self, reference: Plain) -> str:
        """Return why there is no such component; empty if there is."""
        key, kind = str(reference[fit_references.OF]), reference[fit_references.WORD]
        result = self._result(key)
        if result is not None and any(fit.kind == kind for fit in result.fits):
            return ""
        why = "has no result" if result is None else result.message or "identifies none"
        return f"it needs the {kind} that sweep {key[4:12]} identifies, which {why}"


def _with_fits(sweeps: Sequence[Sweep], fits: _Fits) -> tuple[list[Sweep], list[tuple[Sweep, str]]]:
    """Return the sweeps whose fits are there, and the others with what they lack."""
    ready, lacking = [], []
    for sweep in sweeps:
        wanted = fit_references.found_in([sweep.experiment, sweep.estimator])
        reasons = [reason for reference in wanted if (reason := fits.lack(reference))]
        if reasons:
            lacking.append((sweep, reasons[0]))
        else:
            ready.append(sweep)
    return ready, lacking
