"""Run a Monte Carlo study over the friction force: rate against one process without storing, and memory during the run.

    python benchmarks/monte_carlo.py             10,000 sweeps of 30 frequencies: some minutes
    python benchmarks/monte_carlo.py --reduced   300 sweeps

"alone" computes sweeps of the same study one after another, without storing and without other processes. The rate must
be 0.85 of cores times that, that of two workers 1.8 of one, and memory must not grow.
"""

import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from harness import Bench, run

from fraexp.execution.events import Finished
from fraexp.execution.executors import usable_cores
from fraexp.execution.job import Job, run_job
from fraexp.workspace.workspace_service import WorkspaceService

STUDY = """
title = "Friction force within its tolerance"
machine = "linear_motor_table"

[excitation]
name = "stepped_sine"
amplitude = 12
points = 30
settling_tolerance = 1e-4

[estimator]
name = "conventional"

[grid]
"friction.curve.coulomb_force" = {forces}
"""
MIN_SHARE, MIN_GAIN, MAX_GROWTH = 0.85, 1.8, 1.15
"""Bounds: rate over cores times the rate alone, that of two workers over one, memory over that at a quarter."""
GROUP = 10
"""Sweeps of which a rate is taken."""


def alone(workspace: WorkspaceService, groups: int) -> float:
    """Return the rate [1/s] of one process that stores nothing: the median over groups of sweeps."""
    sweeps = workspace.studies(["draws"])[0].sweeps[: (groups + 1) * GROUP]
    rates = []
    for begin in range(0, len(sweeps), GROUP):
        began = time.perf_counter()
        for sweep in sweeps[begin : begin + GROUP]:
            run_job(Job(sweep.experiment, (sweep.estimator,), sweep.files), lambda _: None)
        rates.append(GROUP / (time.perf_counter() - began))
    return float(np.median(rates[1:]))


def resident() -> float:
    """Return the memory of this process [MiB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def stored(folder: Path, executor: str, database: str) -> tuple[float, list[float]]:
    """Run the study; return its rate [1/s] once the workers have started, and the memory [MiB] after each sweep."""
    times, memory = [], []
    for event in WorkspaceService.open(folder, str(folder / database)).run(["draws"], executor):
        if isinstance(event, Finished):
            times.append(time.perf_counter())
            memory.append(resident())
    skipped = len(times) // 10
    return (len(times) - 1 - skipped) / (times[-1] - times[skipped]), memory


def workspace(folder: str, bench: Bench, count: int) -> Path:
    """Write the study into a folder."""
    (Path(folder) / "studies").mkdir()
    forces = [round(force, 5) for force in bench.generator().normal(17.9, 1.5, count).tolist()]
    (Path(folder) / "studies" / "draws.toml").write_text(STUDY.format(forces=forces), encoding="utf-8")
    return Path(folder)


def all_cores(bench: Bench) -> None:
    """Rate and memory on all cores."""
    with tempfile.TemporaryDirectory() as name:
        folder, began = workspace(name, bench, bench.options.count), time.perf_counter()
        single = alone(WorkspaceService.open(folder), 6)
        rate, memory = stored(folder, bench.options.executor, "results.db")
        size = (folder / "results.db").stat().st_size / 2**20
    share, early = rate / (single * usable_cores()), memory[len(memory) // 4]
    text = f"{rate:.1f}/s, alone {single:.1f}/s; {share:.2f} of cores x alone (at least {MIN_SHARE})"
    bench.row(f"{len(memory)} sweeps on {usable_cores()} cores", text, share >= MIN_SHARE, share=share)
    text = f"{early:.0f} MiB at a quarter, {memory[-1]:.0f} MiB at the end; database {size:.0f} MiB"
    bench.row(f"memory, in {time.perf_counter() - began:.0f} s", text, memory[-1] <= MAX_GROWTH * early)


def two_workers(bench: Bench) -> None:
    """Rate of two workers over that of one: the median of pairs of runs."""
    ratios = []
    with tempfile.TemporaryDirectory() as name:
        folder = workspace(name, bench, min(bench.options.count, 300))
        for pair in range(bench.options.pairs):
            one, two = (stored(folder, f"processes:{n}", f"{pair}-{n}.db")[0] for n in (1, 2))
            ratios.append(two / one)
    ratio = float(np.median(ratios))
    text = f"{ratio:.2f} of {bench.options.pairs} pairs (at least {MIN_GAIN})"
    bench.row("two workers over one", text, ratio >= MIN_GAIN, ratio=ratio)


if __name__ == "__main__":
    run(__doc__, all_cores, two_workers, count=(10_000, 300), pairs=(5, 1), executor="processes")
