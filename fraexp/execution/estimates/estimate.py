"""How long a run will take: the work of its sweeps at this machine's speed, over its workers, with what is compiled."""

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
from fraexp.execution.executors import ResourceLimits, workers_of

MAX_ESTIMATORS = 512
"""Estimators that are counted for a study; of more, some of each experiment stand for all."""
HASH_DIGITS = 12
"""Digits of a source's hash that tell it from others."""
ADVANTAGE = 0.9
"""Share of the time of one process at which several are worth being started."""
SERIAL, PROCESSES = "serial", "processes"


@dataclass(frozen=True)
class Estimate:
    """What a run is expected to take."""

    seconds: float
    """From the plan to the run's figure [s], compiling included."""
    compiling: float
    """Time for what is compiled first [s]."""
    executor: str
    """The executor that is used: the one that was asked for, or the faster one."""


class EstimatedTask(NamedTuple):
    """What one worker does in one go: an experiment and its estimators, counted."""

    experiment: tuple[Work, ...]
    estimators: tuple[Work, ...]
    share: float
    """Estimators of the experiment over those that were counted."""
    weight: float
    """Tasks for which it stands."""
    sweeps: int

    def seconds(self, speeds: Speeds) -> float:
        """Return the time that a worker of this machine takes [s]."""
        return work_seconds(self.experiment, speeds) + self.share * work_seconds(self.estimators, speeds)


@dataclass(frozen=True)
class Workload:
    """The tasks of a run, in turns: those of a later turn need what earlier ones have identified."""

    turns: Sequence[Sequence[EstimatedTask]]
    source: Callable[[str], str]
    """Returns a hash of a friction law's source by its name."""

    @property
    def kernels(self) -> frozenset[str]:
        """Compiled kernels that it needs."""
        tasks = [task for turn in self.turns for task in turn]
        kinds = (work.kind for task in tasks for work in (*task.experiment, *task.estimators))
        return kernels_of(kinds, self.source)

    def seconds(self, executor: str, speeds: Speeds) -> float:
        """Return the time from the first task to the last result [s], without what is compiled."""
        workers = workers_of(executor)
        kind = SERIAL if executor == SERIAL else PROCESSES
        loaded = known_seconds("kernel", speeds) * len(self.kernels)
        return (
            known_seconds(f"start_{kind}", speeds) + loaded + sum(_turn(turn, workers, speeds) for turn in self.turns)
        )


def _turn(tasks: Sequence[EstimatedTask], workers: int, speeds: Speeds) -> float:
    """Return the time of tasks that are divided over workers: that of the longest one, at least."""
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
    """Return what computing sweeps takes; without an `executor` the faster one of those of this machine is chosen."""
    workload = counted(missing, registry)
    asked = executor or (PROCESSES if limits and limits.memory is not None else None)
    times = {
        name: slowdown(workers_of(name)) * workload.seconds(name, speeds)
        for name in ([asked] if asked else [SERIAL, PROCESSES])
    }
    chosen = asked or (PROCESSES if times[PROCESSES] < ADVANTAGE * times[SERIAL] else SERIAL)
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


def counted(missing: Sequence[Sweep], registry: Registry) -> Workload:
    """Return the work of sweeps, in turns where some need the fits of others."""
    groups = sampled_groups(missing)
    most = max(MAX_ESTIMATORS // max(len(groups), 1), 1)
    turns: dict[bool, list[EstimatedTask]] = {}
    for group in groups:
        first = group.sweeps[0]
        needs_fits = any(fit_references.found_in([first.experiment, first.estimator]))
        turns.setdefault(needs_fits, []).append(_task(group, most, registry))
    return Workload([turns[needs_fits] for needs_fits in sorted(turns)], law_source(registry))


def law_source(registry: Registry) -> Callable[[str], str]:
    """Return what tells a hash of a friction law's source by its name: an edited law is compiled again."""
    supplies = registry.supplies

    def source(name: str) -> str:
        supply = supplies.get(("friction", name))
        return supply.source_hash[:HASH_DIGITS] if supply else ""

    return source


def _task(group: SweepGroup, most: int, registry: Registry) -> EstimatedTask:
    """Return a group as a task, of which at most so many estimators are counted."""
    sweeps, first = group.sweeps, group.sweeps[0]
    experiment = experiment_work(first.experiment, registry)
    chosen = sweeps if len(sweeps) <= most else random.Random(SEED).sample(sweeps, most)
    work = [estimator_work(one.estimator, first.experiment, experiment.shape, registry) for one in chosen]
    estimators = tuple(one for each in work for one in each)
    return EstimatedTask(experiment.work, estimators, len(sweeps) / len(chosen), group.weight, len(sweeps))
