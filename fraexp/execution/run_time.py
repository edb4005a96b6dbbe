"""Remaining time of a run, from what like sweeps took: the newest stored ones, and those that it has computed."""

from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from statistics import median_low

from fraexp.data.sweep import Sweep
from fraexp.execution.events import TimeLeft
from fraexp.execution.provenance import usable_cores
from fraexp.store import Likeness, Store

MAX_LIKE_SWEEPS = 15
"""Like sweeps from which a time follows: those that the run computes displace stored ones of other parameters."""
WORKER_START_S = 2.0
"""Time in which worker processes start and load their libraries: a run that they shorten by less needs none."""
SERIAL, PROCESSES = "serial", "processes"


class RunTime:
    """The sweeps that a run has still to compute, and what like ones took.

    Sweeps are alike if their components are, whatever their parameters. The time of each is the median of the newest
    like ones, and of two the lower: the first sweep of a process, which loads and compiles, takes many times as long.
    """

    def __init__(self, missing: Iterable[Sweep], known: Mapping[Likeness, Sequence[float]]) -> None:
        """Take the missing sweeps, and the times [s] of stored ones, newest first."""
        self._missing = Counter(map(likeness, missing))
        self._times = {
            like: deque(reversed(known.get(like, ())[:MAX_LIKE_SWEEPS]), MAX_LIKE_SWEEPS) for like in self._missing
        }

    def finish(self, sweep: Sweep, elapsed: float | None = None) -> None:
        """Note that a sweep has ended; `elapsed` is its computing time [s], None if it was not computed."""
        like = likeness(sweep)
        self._missing[like] -= 1
        if elapsed is not None:
            self._times[like].append(elapsed)

    def left(self, workers: int, running: Iterable[tuple[Sweep, float]] = ()) -> TimeLeft:
        """Return the time left with a number of workers; `running` are sweeps with the fraction that is done."""
        each = {like: median_low(times) for like, times in self._times.items() if times}
        waiting, parts = Counter(self._missing), list[float]()
        for sweep, done in running:
            like = likeness(sweep)
            waiting[like] -= 1
            parts += [(1 - done) * each[like]] if like in each else []
        open_kinds = [like for like, count in self._missing.items() if count > 0]
        unlike = sum(self._missing[like] for like in open_kinds if like not in each)
        total = sum(parts) + sum(count * each[like] for like, count in waiting.items() if count > 0 and like in each)
        longest = max([*parts, *(each[like] for like in open_kinds if waiting[like] > 0 and like in each)], default=0.0)
        is_unknown = bool(open_kinds) and not any(like in each for like in open_kinds)
        seconds = None if is_unknown else max(total / max(workers, 1), longest)
        return TimeLeft(seconds, sum(len(self._times[like]) for like in open_kinds), unlike)


def likeness(sweep: Sweep) -> Likeness:
    """Return the names of a sweep's components, which decide about its computing time more than their parameters."""
    sections = (*(sweep.experiment.get(name) for name in ("plant", "friction", "controller", "excitation")),)
    names = (section.get("name") if isinstance(section, Mapping) else None for section in (*sections, sweep.estimator))
    return (sweep.experiment.get("source"), *names)


def run_time_of(missing: Sequence[Sweep], store: Store | None) -> RunTime:
    """Return the time of missing sweeps, of which a store may have like ones."""
    return RunTime(missing, store.like_times() if store and missing else {})


def choose_executor(missing: Sequence[Sweep], time: TimeLeft) -> str:
    """Return the executor for sweeps whose `time` in one process is given: processes, unless they save too little.

    What they save by working side by side must exceed the time in which they start.
    """
    workers = min(len({sweep.experiment_key for sweep in missing}), max(usable_cores(), 2))
    saved = (time.seconds or 0.0) * (1 - 1 / max(workers, 1))
    is_short = not time.unlike and saved < WORKER_START_S
    return SERIAL if workers <= 1 or is_short else PROCESSES
