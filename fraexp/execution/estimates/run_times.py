"""What a run as a whole teaches: how long starting, compiling and storing take, and how well its work is divided."""

from dataclasses import dataclass

from fraexp.execution.estimates.compile_time import compile_seconds, new_families
from fraexp.execution.estimates.estimate import PROCESSES, SERIAL, known_seconds
from fraexp.execution.estimates.machine_load import slowdown
from fraexp.execution.estimates.reference_costs import run_cost
from fraexp.execution.estimates.speeds import COMPILE, PARALLEL, Speeds
from fraexp.execution.executors import workers_of

IDLE = 1.2
"""Slowdown by other programs up to which the time by the clock teaches something."""
MANY = 50
"""Sweeps in a run from which on the time of storing one shows."""
COMPILED_SHARE = 0.3
"""Share of the expected compile time below which nothing was compiled: the kernels were there, unknown to us."""
LONG = 5.0
"""Times of the start that computing takes in a run whose division over workers shows, and in no shorter one."""
MOST_SURPRISE = 4.0
"""Greatest ratio of a measured start to an expected one that is believed: beyond, an estimator has compiled a law."""
Ratios = dict[str, list[float]]
"""Measured over reference times, by kind of work."""


@dataclass(frozen=True)
class RunTimes:
    """A run as a whole."""

    took: float
    """Time from its plan to its end; of one process, processor time [s]."""
    executor: str
    count: int
    computing: float
    excess: float
    """Time that was spent on loading and compiling, in all processes [s]."""
    kernels: frozenset[str]


def learn_run(run: RunTimes, before: Speeds, speeds: Speeds, ratios: Ratios) -> None:
    """Add the ratios of a run as a whole: of its start, what it compiled, how it stored and divided its work."""
    workers = min(workers_of(run.executor), run.count)
    if run.executor != SERIAL and slowdown(1) > IDLE:
        return  # others have taken a part of the time, which is told for this process alone
    start = f"start_{SERIAL if run.executor == SERIAL else PROCESSES}"
    loading = known_seconds("kernel", speeds) * len(run.kernels)
    work = max(run.computing - run.excess, 0.0) / workers
    stored = known_seconds("sweep", speeds) * run.count / workers
    if run.executor == SERIAL and run.count >= MANY:
        ratios["sweep"].append((run.took - run.computing) / run.count / run_cost("sweep"))
        stored = run.took - run.computing
    spent = run.took - work - stored - loading
    compiling = compile_seconds(run.kernels, before)
    if compiling and spent > COMPILED_SHARE * compiling:
        ratio = (spent - known_seconds(start, speeds)) / compile_seconds(run.kernels, Speeds(kernels=before.kernels))
        for family in set(new_families(run.kernels, before.kernels)):
            ratios[f"{COMPILE}/{family}"].append(ratio)
    elif work < LONG * known_seconds(start, speeds):
        if spent < MOST_SURPRISE * (known_seconds(start, speeds) + loading):
            ratios[start].append(spent / run_cost(start))
    elif workers > 1:
        ratios[PARALLEL].append((run.took - known_seconds(start, speeds) - loading) / (work + stored))
