"""Duration of a run: the work of its sweeps at this machine's speed, divided over its workers, and compile time."""

import random
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from fraexp.components.registry import Registry
from fraexp.data import fit_references
from fraexp.data.sweep import Sweep
from fraexp.execution.estimates.compile_time import compile_seconds, kernels_of
from fraexp.execution.estimates.group_sampling import SEED, SweepGroup, sampled_groups
from fraexp.execution.estimates.machine_load import slowdown
from fraexp.execution.estimates.reference_costs import run_cost
from fraexp.execution.estimates.speeds import PARALLEL, Speeds
from fraexp.execution.estimates.work import Work
from fraexp.execution.estimates.workload import estimator_work, experiment_work
from fraexp.execution.executors import ResourceLimits, worker_count

MAX_ESTIMATORS = 512
"""Maximum number of estimators whose work is counted; beyond it, a random sample of each experiment is."""
HASH_DIGITS = 12
"""Digits of a source's hash that identify it."""
PARALLEL_THRESHOLD = 0.9
"""Time with several processes, relative to one process, below which several are started."""
SERIAL, PROCESSES = "serial", "processes"


@dataclass(frozen=True)
class Estimate:
    """The expected duration of a run."""

    seconds: float
    """Time from the plan to the run's figure [s], including the compile time."""
    compiling: float
    """Compile time [s]."""
    executor: str
    """The executor that is used: the requested one, or the faster one."""


class EstimatedTask(NamedTuple):
    """The work of one job: an experiment and its estimators."""

    experiment: tuple[Work, ...]
    estimators: tuple[Work, ...]
    estimator_ratio: float
    """Number of estimators relative to those whose work is counted."""
    weight: float
    """Number of tasks that it represents."""
    sweeps: int

    def seconds(self, speeds: Speeds) -> float:
        """Return the time of a worker on this machine [s]."""
        return work_seconds(self.experiment, speeds) + self.estimator_ratio * work_seconds(self.estimators, speeds)


@dataclass(frozen=True)
class Workload:
    """The tasks of a run in batches: a later batch needs the fits of earlier ones."""

    batches: Sequence[Sequence[EstimatedTask]]
    source: Callable[[str], str]
    """Returns the hash of a friction law's source by the name of the law."""

    @property
    def kernels(self) -> frozenset[str]:
        """Compiled kernels that the tasks need."""
        tasks = [task for batch in self.batches for task in batch]
        kinds = (work.kind for task in tasks for work in (*task.experiment, *task.estimators))
        return kernels_of(kinds, self.source)

    def seconds(self, executor: str, speeds: Speeds) -> float:
        """Return the time from the first task to the last result [s], without compiling."""
        workers = worker_count(executor)
        kind = SERIAL if executor == SERIAL else PROCESSES
        loaded = known_seconds("kernel", speeds) * len(self.kernels)
        return (
            known_seconds(f"start_{kind}", speeds)
            + loaded
            + sum(_batch_seconds(batch, workers, speeds) for batch in self.batches)
        )


def _batch_seconds(tasks: Sequence[EstimatedTask], workers: int, speeds: Speeds) -> float:
    """Return the time of tasks that are divided over workers [s]: no less than that of the longest task."""
    each = [task.seconds(speeds) for task in tasks]
    stored = known_seconds("sweep", speeds)
    total = sum(task.weight * (one + stored * task.sweeps) for task, one in zip(tasks, each, strict=True))
    count = sum(task.weight for task in tasks)
    shared = total / min(workers, max(count, 1.0)) * (speeds.ratio(PARALLEL) if workers > 1 else 1.0)
    return max(shared, *each)


def estimate(
    missing: Sequence[Sweep],
    registry: Registry,
    speeds: Speeds,
    executor: str | None = None,
    limits: ResourceLimits | None = None,
) -> Estimate:
    """Return the expected duration of sweeps; without an `executor` the faster one of this machine is chosen."""
    workload = count_workload(missing, registry)
    requested = executor or (PROCESSES if limits and limits.memory is not None else None)
    times = {
        name: slowdown(worker_count(name)) * workload.seconds(name, speeds)
        for name in ([requested] if requested else [SERIAL, PROCESSES])
    }
    chosen = requested or (PROCESSES if times[PROCESSES] < PARALLEL_THRESHOLD * times[SERIAL] else SERIAL)
    compiling = slowdown(1) * compile_seconds(workload.kernels, speeds)
    figure = slowdown(1) * known_seconds("figure", speeds)
    return Estimate(times[chosen] + compiling + figure, compiling, chosen)


def known_seconds(name: str, speeds: Speeds) -> float:
    """Return a time of a run as a whole on this machine [s]."""
    return run_cost(name) * speeds.ratio(name)


def work_seconds(works: Iterable[Work], speeds: Speeds) -> float:
    """Return the time that work takes on this machine [s]."""
    return sum(
        work.seconds
        * (speeds.ratio(work.sized) if work.kind else 1.0)
        * (speeds.ratio(work.settling) if work.settling else 1.0)
        for work in works
    )


def count_workload(missing: Sequence[Sweep], registry: Registry) -> Workload:
    """Return the work of sweeps, in batches if some need the fits of others."""
    groups = sampled_groups(missing)
    max_estimators = max(MAX_ESTIMATORS // max(len(groups), 1), 1)
    batches: dict[bool, list[EstimatedTask]] = {}
    for group in groups:
        first = group.sweeps[0]
        needs_fits = any(fit_references.references_in([first.experiment, first.estimator]))
        batches.setdefault(needs_fits, []).append(_estimated_task(group, max_estimators, registry))
    return Workload([batches[needs_fits] for needs_fits in sorted(batches)], law_hash_lookup(registry))


def law_hash_lookup(registry: Registry) -> Callable[[str], str]:
    """Return a function from the name of a friction law to the hash of its source: an edited law is compiled again."""
    providers = registry.providers

    def source(name: str) -> str:
        provider = providers.get(("friction", name))
        return provider.source_hash[:HASH_DIGITS] if provider else ""

    return source


def _estimated_task(group: SweepGroup, max_estimators: int, registry: Registry) -> EstimatedTask:
    """Return a group as a task, in which the work of at most `max_estimators` estimators is counted."""
    sweeps, first = group.sweeps, group.sweeps[0]
    experiment = experiment_work(first.experiment, registry)
    chosen = sweeps if len(sweeps) <= max_estimators else random.Random(SEED).sample(sweeps, max_estimators)
    work = [estimator_work(one.estimator, first.experiment, experiment.shape, registry) for one in chosen]
    estimators = tuple(one for each in work for one in each)
    return EstimatedTask(experiment.work, estimators, len(sweeps) / len(chosen), group.weight, len(sweeps))
