"""Run a Monte Carlo study over the friction force: rate against one process without storing, and memory during the run.

    python benchmarks/monte_carlo.py             10,000 sweeps of 30 frequencies, on two cores: some minutes
    python benchmarks/monte_carlo.py --reduced   300 sweeps

"alone" computes sweeps of the same study one after another, without storing and without other processes. The exit code
is 1 if the run is slower than 0.85 of cores times that, or if memory grows.
"""

import argparse
import os
import random
import resource
import statistics
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

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
LEAST_SHARE = 0.85
"""Rate over cores times the rate alone, at least."""
MOST_GROWTH = 1.15
"""Memory at the end over memory at a quarter of the way, at most."""


def alone(workspace: WorkspaceService, sweeps: int) -> float:
    """Return the rate [1/s] of one process that stores nothing: the median over groups of ten sweeps."""
    jobs = [Job(s.experiment, (s.estimator,), s.files) for s in workspace.studies(["draws"])[0].sweeps[: sweeps + 10]]
    rates = []
    for begin in range(0, len(jobs), 10):
        began = time.perf_counter()
        for job in jobs[begin : begin + 10]:
            run_job(job, lambda _: None)
        rates.append(10 / (time.perf_counter() - began))
    return statistics.median(rates[1:])


def resident() -> float:
    """Return the memory of this process [MiB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def main() -> int:
    """Print rates and memory; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--reduced", action="store_true", help="300 sweeps")
    options.add_argument("--executor", default="processes", help="such as processes:2")
    chosen = options.parse_args()
    count = 300 if chosen.reduced else 10_000
    draw = random.Random(1)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "studies").mkdir()
        forces = [round(draw.gauss(17.9, 1.5), 5) for _ in range(count)]
        (Path(folder) / "studies" / "draws.toml").write_text(STUDY.format(forces=forces))
        workspace = WorkspaceService.open(folder)
        single = alone(workspace, 60)
        began, times, memory = time.perf_counter(), [], []
        for event in workspace.run(["draws"], chosen.executor):
            if isinstance(event, Finished):
                times.append(time.perf_counter() - began)
                if len(times) % max(count // 100, 1) == 0:
                    memory.append(resident())
        whole = time.perf_counter() - began
        size = (Path(folder) / "results.db").stat().st_size / 2**20
    skipped = len(times) // 10  # while the workers start
    rate = (len(times) - skipped) / (times[-1] - times[skipped])
    share = rate / (single * usable_cores())
    growth = memory[-1] / memory[len(memory) // 4]
    print(f"{count} sweeps of 30 frequencies: {whole:.1f} s, starting, storing and the figure included")
    print(f"alone {single:.1f} sweeps/s; stored on {usable_cores()} cores {rate:.1f}/s, {share:.2f} of cores x alone")
    early, late = memory[len(memory) // 4], memory[-1]
    print(f"memory {early:.0f} MiB at a quarter, {late:.0f} MiB at the end; database {size:.0f} MiB")
    missed = [name for name, bad in (("rate", share < LEAST_SHARE), ("memory", growth > MOST_GROWTH)) if bad]
    print(f"missed: {', '.join(missed)}" if missed else "0 missed")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
