"""What a run teaches about the speed of its machine: measured over reference times of each kind of work."""

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from fraexp.components.registry import Registry
from fraexp.data.results import EFFORT, Result, Timing
from fraexp.data.sweep import Sweep
from fraexp.execution.estimates.compile_time import kernels_of
from fraexp.execution.estimates.estimate import PROCESSES, SERIAL, law_source, work_seconds
from fraexp.execution.estimates.reference_costs import run_cost
from fraexp.execution.estimates.run_times import Ratios, RunTimes, learn_run
from fraexp.execution.estimates.speeds import Speeds, learn_speeds, read_speeds
from fraexp.execution.estimates.work import Counted, Work
from fraexp.execution.estimates.workload import estimator_work, experiment_work

MAX_KINDS, MAX_ALIKE = 16, 3
"""Kinds of sweeps that a run is learned from, and sweeps of each: counting their work takes some milliseconds."""
MAX_COLD = 64
"""Sweeps that were the first of their kind in a process, of which the time of loading and compiling is learned."""
LEAST_SHARE = 0.25
"""Share of an expected time from which on a kind of work is learned from it."""
TELLING = 2.0
"""Time [s] from which on a sweep tells a speed even if libraries were loaded meanwhile."""


@dataclass(frozen=True)
class _Lesson:
    """A computed sweep."""

    sweep: Sweep
    timing: Timing
    measuring_time: float | None
    """Time that the experiment takes on a machine [s], which tells its samples; None without a loop."""


@dataclass
class Lessons:
    """The sweeps of a run, as far as they teach something."""

    registry: Registry
    count: int = 0
    computing: float = 0.0
    """Processor time of all sweeps [s]."""
    warm: dict[tuple[str, ...], list[_Lesson]] = field(default_factory=lambda: defaultdict(list))
    cold: list[_Lesson] = field(default_factory=list)
    _began: tuple[float, float] = field(default_factory=lambda: (time.monotonic(), time.process_time()))

    def take(self, sweep: Sweep, result: Result | None) -> None:
        """Take note of a sweep that has been computed."""
        if result is None or result.timing is None:
            return
        self.count += 1
        self.computing += result.timing.experiment / result.timing.sharers + result.timing.estimator
        _, _, name = EFFORT
        measuring = next((float(metric.value) for metric in result.metrics if metric.name == name), None)
        lesson, kind = _Lesson(sweep, result.timing, measuring), _kind(sweep)
        if not all(result.timing.is_warm):
            self.cold += [lesson] if len(self.cold) < MAX_COLD else []
        elif (kind in self.warm or len(self.warm) < MAX_KINDS) and len(self.warm[kind]) < MAX_ALIKE:
            self.warm[kind].append(lesson)

    def learn(self, executor: str) -> None:
        """Keep what a run by an executor, which ends now, has taught; nothing if it cannot be told."""
        took = time.monotonic() - self._began[0], time.process_time() - self._began[1]
        if not self.count or not executor.startswith((SERIAL, PROCESSES)):  # those of a cluster are other machines
            return
        try:
            measured, kernels = self._measured(took[executor == SERIAL], executor, read_speeds())
        except Exception:  # a plugin that fails while its work is counted must not end a run that is done
            return
        learn_speeds(measured, kernels)

    def _measured(self, took: float, executor: str, speeds: Speeds) -> tuple[Ratios, frozenset[str]]:
        ratios: Ratios = defaultdict(list)
        counts = [(lesson, self._counted(lesson)) for lesson in [*chain(*self.warm.values()), *self.cold]]
        kinds = (work.kind for _, (of, own) in counts for work in (*of.work, *own))
        kernels = kernels_of(kinds, law_source(self.registry))
        is_new = bool(kernels - speeds.kernels)
        for lesson, (of, own) in counts:
            _learn_work(lesson, of, own, speeds, ratios, is_new)
        known = speeds.learned(ratios)
        spent = [_excess(lesson, of, own, known) for lesson, (of, own) in counts if not all(lesson.timing.is_warm)]
        run = RunTimes(took, executor, self.count, self.computing, sum(spent), kernels)
        learn_run(run, speeds, known, ratios)
        return ratios, kernels

    def _counted(self, lesson: _Lesson) -> tuple[Counted, tuple[Work, ...]]:
        experiment = lesson.sweep.experiment
        counted = experiment_work(experiment, self.registry)
        return counted, estimator_work(lesson.sweep.estimator, experiment, counted.shape, self.registry)


def timed_figures(draw: Callable[[], Mapping[Path, bool]]) -> tuple[Path, ...]:
    """Return the figures that are drawn, or were there already, and keep how long drawing has taken."""
    began = time.process_time()
    figures = draw()
    if any(figures.values()):
        learn_speeds({"figure": [(time.process_time() - began) / run_cost("figure")]})
    return tuple(figures)


def _kind(sweep: Sweep) -> tuple[str, ...]:
    sections = (sweep.experiment.get("excitation"), sweep.experiment.get("friction"), sweep.estimator)
    return tuple(str(section["name"]) if isinstance(section, Mapping) else "" for section in sections)


def _learn_work(
    lesson: _Lesson, of: Counted, own: Sequence[Work], speeds: Speeds, ratios: Ratios, is_new: bool
) -> None:
    """Add the ratios of a sweep, of what was warm, or took so long that loading does not matter."""
    timing, samples = lesson.timing, 1.0
    if lesson.measuring_time and of.rows:
        samples = lesson.measuring_time / (of.rows * of.sample_time)
        if of.work[0].settling and of.rounds == 1:
            ratios[of.work[0].settling].append(samples)
    works = [work._replace(seconds=work.seconds * samples, settling="") if work.settling else work for work in of.work]
    if of.rounds == 1 and _tells(timing.experiment, timing.is_warm[0], is_new):
        _attribute(works, timing.experiment, speeds, ratios)
    if _tells(timing.estimator, timing.is_warm[1], is_new):
        _attribute(own, timing.estimator, speeds, ratios)
    if of.rounds > 1 and of.work[0].settling and timing.is_warm[0]:  # rounds and settling are learned as one
        expected = work_seconds([of.work[0]._replace(settling="")], speeds)
        ratios[of.work[0].settling].append(timing.experiment / expected)


def _tells(seconds: float, is_warm: bool, is_new: bool) -> bool:
    return is_warm or (seconds > TELLING and not is_new)


def _attribute(works: Sequence[Work], measured: float, speeds: Speeds, ratios: Ratios) -> None:
    """Add the ratio of each kind of work that takes a large part of a time: all were as much slower than expected."""
    each = [work_seconds([work], speeds) for work in works]
    expected = sum(each)
    for work, seconds in zip(works, each, strict=True):
        if work.kind and seconds > LEAST_SHARE * expected:
            for kind in (work.kind, work.sized):
                ratios[kind].append(speeds.ratio(work.sized) * measured / expected)


def _excess(lesson: _Lesson, of: Counted, own: Sequence[Work], speeds: Speeds) -> float:
    """Return the time that a sweep took beyond what it will take the next time [s]: loading and compiling."""
    timing = lesson.timing
    parts = ((of.work, timing.experiment, timing.is_warm[0]), (own, timing.estimator, timing.is_warm[1]))
    beyond = [0.0 if is_warm else max(took - work_seconds(works, speeds), 0.0) for works, took, is_warm in parts]
    return beyond[0] / timing.sharers + beyond[1]
