"""Times of a run as a whole: start, compiling and storing, and how well its work is divided over workers."""

from dataclasses import dataclass

from fraexp.execution.estimates.compile_time import compile_seconds, new_families
from fraexp.execution.estimates.estimate import PROCESSES, SERIAL, known_seconds
from fraexp.execution.estimates.machine_load import slowdown
from fraexp.execution.estimates.reference_costs import run_cost
from fraexp.execution.estimates.speeds import COMPILE, PARALLEL, Speeds
from fraexp.execution.executors import worker_count

MAX_IDLE_SLOWDOWN = 1.2
"""Slowdown by other programs up to which the clock time is used."""
MIN_STORED_SWEEPS = 50
"""Sweeps of a run from which the time to store one can be determined."""
MIN_COMPILED_SHARE = 0.3
"""Share of the expected compile time below which nothing was compiled, because the kernels existed already."""
MIN_WORK_RATIO = 5.0
"""Work relative to the start-up time from which a run shows how well its work is divided over workers."""
MAX_START_RATIO = 4.0
"""Largest plausible ratio of a measured start-up time to the expected one: above it, an estimator compiled a law."""
Ratios = dict[str, list[float]]
"""Measured over reference times, by kind of work."""


@dataclass(frozen=True)
class RunTimes:
    """A run as a whole."""

    took: float
    """Time from its plan to its end [s]; for one process its processor time."""
    executor: str
    count: int
    computing: float
    excess: float
    """Time of loading and compiling in all processes [s]."""
    kernels: frozenset[str]


def add_run_ratios(run: RunTimes, before: Speeds, speeds: Speeds, ratios: Ratios) -> None:
    """Add the ratios of a run as a whole: start, compiling, storing, and division of the work."""
    workers = min(worker_count(run.executor), run.count)
    if run.executor != SERIAL and slowdown(1) > MAX_IDLE_SLOWDOWN:
        return  # other programs took part of the clock time
    start = f"start_{SERIAL if run.executor == SERIAL else PROCESSES}"
    loading = known_seconds("kernel", speeds) * len(run.kernels)
    work = max(run.computing - run.excess, 0.0) / workers
    stored = known_seconds("sweep", speeds) * run.count / workers
    if run.executor == SERIAL and run.count >= MIN_STORED_SWEEPS:
        ratios["sweep"].append((run.took - run.computing) / run.count / run_cost("sweep"))
        stored = run.took - run.computing
    spent = run.took - work - stored - loading
    compiling = compile_seconds(run.kernels, before)
    if compiling and spent > MIN_COMPILED_SHARE * compiling:
        ratio = (spent - known_seconds(start, speeds)) / compile_seconds(run.kernels, Speeds(kernels=before.kernels))
        for family in set(new_families(run.kernels, before.kernels)):
            ratios[f"{COMPILE}/{family}"].append(ratio)
    elif work < MIN_WORK_RATIO * known_seconds(start, speeds):
        if spent < MAX_START_RATIO * (known_seconds(start, speeds) + loading):
            ratios[start].append(spent / run_cost(start))
    elif workers > 1:
        ratios[PARALLEL].append((run.took - known_seconds(start, speeds) - loading) / (work + stored))
