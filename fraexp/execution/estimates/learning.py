"""Speeds of this machine from a run: measured over reference times of each kind of work."""

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from fraexp.components.registry import Registry
from fraexp.data.results import EFFORT, Result, Timing
from fraexp.data.sweep import Sweep, component_names
from fraexp.execution.estimates.compile_time import kernels_of
from fraexp.execution.estimates.estimate import PROCESSES, SERIAL, law_hash_lookup, work_seconds
from fraexp.execution.estimates.reference_costs import run_cost
from fraexp.execution.estimates.run_times import Ratios, RunTimes, add_run_ratios
from fraexp.execution.estimates.speeds import Speeds, read_speeds, save_ratios
from fraexp.execution.estimates.work import CountedExperiment, Work
from fraexp.execution.estimates.workload import estimator_work, experiment_work

MAX_KINDS, MAX_SWEEPS_PER_KIND = 16, 3
"""Kinds of sweeps, and sweeps of each, from which a run is learned: counting their work takes some milliseconds."""
MAX_COLD_SWEEPS = 64
"""Sweeps, the first of their kind in a process, from which loading and compile times are learned."""
MIN_SHARE = 0.25
"""Least share of an expected time with which a kind of work is learned from it."""
LOADING_NEGLIGIBLE_S = 2.0
"""Time above which a speed is learned from a sweep even if libraries were loaded during it."""


@dataclass(frozen=True)
class _MeasuredSweep:
    """A computed sweep with its times."""

    sweep: Sweep
    timing: Timing
    measuring_time: float | None
    """Duration of the experiment on a real machine [s], which gives its samples; None without a loop."""


@dataclass
class Lessons:
    """The measured times of a run's sweeps."""

    registry: Registry
    count: int = 0
    computing: float = 0.0
    """Processor time of all sweeps [s]."""
    warm: dict[tuple[str, ...], list[_MeasuredSweep]] = field(default_factory=lambda: defaultdict(list))
    cold: list[_MeasuredSweep] = field(default_factory=list)
    _began: tuple[float, float] = field(default_factory=lambda: (time.monotonic(), time.process_time()))

    def add(self, sweep: Sweep, result: Result | None) -> None:
        """Add a computed sweep."""
        if result is None or result.timing is None:
            return
        self.count += 1
        self.computing += result.timing.experiment / result.timing.sharers + result.timing.estimator
        _, _, name = EFFORT
        measuring = next((float(metric.value) for metric in result.metrics if metric.name == name), None)
        measured, kind = _MeasuredSweep(sweep, result.timing, measuring), _sweep_kind(sweep)
        if not all(result.timing.is_warm):
            self.cold += [measured] if len(self.cold) < MAX_COLD_SWEEPS else []
        elif (kind in self.warm or len(self.warm) < MAX_KINDS) and len(self.warm[kind]) < MAX_SWEEPS_PER_KIND:
            self.warm[kind].append(measured)

    def save_speeds(self, executor: str) -> None:
        """Save the speeds that the run shows, which an executor ends now; nothing if they cannot be determined."""
        took = time.monotonic() - self._began[0], time.process_time() - self._began[1]
        if not self.count or not executor.startswith(
            (SERIAL, PROCESSES)
        ):  # the workers of a cluster are other machines
            return
        try:
            ratios, kernels = self._measured_ratios(took[executor == SERIAL], executor, read_speeds())
        except Exception:  # a plugin that fails while its work is counted must not fail a finished run
            return
        save_ratios(ratios, kernels)

    def _measured_ratios(self, took: float, executor: str, speeds: Speeds) -> tuple[Ratios, frozenset[str]]:
        ratios: Ratios = defaultdict(list)
        counts = [(measured, self._count_work(measured)) for measured in [*chain(*self.warm.values()), *self.cold]]
        kinds = (work.kind for _, (of, own) in counts for work in (*of.work, *own))
        kernels = kernels_of(kinds, law_hash_lookup(self.registry))
        is_new = bool(kernels - speeds.kernels)
        for measured, (of, own) in counts:
            _learn_work(measured, of, own, speeds, ratios, is_new)
        known = speeds.updated(ratios)
        spent = [
            _loading_time(measured, of, own, known)
            for measured, (of, own) in counts
            if not all(measured.timing.is_warm)
        ]
        run = RunTimes(took, executor, self.count, self.computing, sum(spent), kernels)
        add_run_ratios(run, speeds, known, ratios)
        return ratios, kernels

    def _count_work(self, measured: _MeasuredSweep) -> tuple[CountedExperiment, tuple[Work, ...]]:
        experiment = measured.sweep.experiment
        counted = experiment_work(experiment, self.registry)
        return counted, estimator_work(measured.sweep.estimator, experiment, counted.shape, self.registry)


def draw_timed(draw: Callable[[], Mapping[Path, bool]]) -> tuple[Path, ...]:
    """Return the figures that `draw` has drawn or found unchanged, and save the time that it took."""
    began = time.process_time()
    figures = draw()
    if any(figures.values()):
        save_ratios({"figure": [(time.process_time() - began) / run_cost("figure")]})
    return tuple(figures)


def _sweep_kind(sweep: Sweep) -> tuple[str, ...]:
    sections = (sweep.experiment.get("excitation"), sweep.experiment.get("friction"), sweep.estimator)
    return tuple("+".join(component_names(section)) for section in sections)


def _learn_work(
    measured: _MeasuredSweep, of: CountedExperiment, own: Sequence[Work], speeds: Speeds, ratios: Ratios, is_new: bool
) -> None:
    """Add the ratios of a sweep: of its warm parts, and of parts so long that loading does not matter."""
    timing, samples = measured.timing, 1.0
    if measured.measuring_time and of.rows:
        samples = measured.measuring_time / (of.rows * of.sample_time)
        if of.work[0].settling and of.rounds == 1:
            ratios[of.work[0].settling].append(samples)
    works = [work._replace(seconds=work.seconds * samples, settling="") if work.settling else work for work in of.work]
    if of.rounds == 1 and _is_informative(timing.experiment, timing.is_warm[0], is_new):
        _attribute(works, timing.experiment, speeds, ratios)
    if _is_informative(timing.estimator, timing.is_warm[1], is_new):
        _attribute(own, timing.estimator, speeds, ratios)
    if of.rounds > 1 and of.work[0].settling and timing.is_warm[0]:  # rounds and settling are learned as one
        expected = work_seconds([of.work[0]._replace(settling="")], speeds)
        ratios[of.work[0].settling].append(timing.experiment / expected)


def _is_informative(seconds: float, is_warm: bool, is_new: bool) -> bool:
    return is_warm or (seconds > LOADING_NEGLIGIBLE_S and not is_new)


def _attribute(works: Sequence[Work], measured: float, speeds: Speeds, ratios: Ratios) -> None:
    """Add the same ratio to each kind of work that takes a large part of a measured time."""
    each = [work_seconds([work], speeds) for work in works]
    expected = sum(each)
    for work, seconds in zip(works, each, strict=True):
        if work.kind and seconds > MIN_SHARE * expected:
            for kind in (work.kind, work.sized):
                ratios[kind].append(speeds.ratio(work.sized) * measured / expected)


def _loading_time(measured: _MeasuredSweep, of: CountedExperiment, own: Sequence[Work], speeds: Speeds) -> float:
    """Return the time of loading and compiling in a sweep [s]: what it took beyond its expected time."""
    timing = measured.timing
    parts = ((of.work, timing.experiment, timing.is_warm[0]), (own, timing.estimator, timing.is_warm[1]))
    beyond = [0.0 if is_warm else max(took - work_seconds(works, speeds), 0.0) for works, took, is_warm in parts]
    return beyond[0] / timing.sharers + beyond[1]
