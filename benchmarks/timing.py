"""Measure the everyday times of docs/performance.md: a warm sweep, start-up, a first result, a reused study.

Start-up is also given as a fraction of the time to import numpy, sqlalchemy and pydantic, measured in turn.

    python benchmarks/timing.py            medians of several runs
    python benchmarks/timing.py --reduced  of fewer runs

The machine should have nothing else to do; bounds are given in brackets, and the exit code is 1 if one is missed.
`benchmarks/scaling.py` measures how times grow, and memory.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from calibrate_machine import MACHINE, sections_of

from fraexp.components.registry import discover
from fraexp.execution.job import Failure, Job, run_job
from fraexp.simulation.machine import reference_response

FRAEXP = ["-m", "fraexp"]
FIRST = """
from fraexp.execution.events import Finished
from fraexp.workspace.workspace_service import WorkspaceService

events = WorkspaceService.open(".").run(["quick"], "serial", rerun="all")
next(event for event in events if isinstance(event, Finished))
events.close()
"""
"""Stops at the first result."""
IMPORTS = ["-c", "import numpy, sqlalchemy, pydantic"]
STARTS = {
    "fraexp list": ([*FRAEXP, "list"], 1.3),
    "fraexp plugins": ([*FRAEXP, "plugins"], None),
    "study paper/fig12 reused": ([*FRAEXP, "run", "paper/fig12"], 2.0),
}
"""Commands, and the share of the time of `IMPORTS` that they may take."""


def median_time(action: Callable[[], object], runs: int) -> float:
    """Return the median time [s] of an action over several runs, after one that is not counted."""
    action()
    return statistics.median(timed(action) for _ in range(runs))


def timed(action: Callable[[], object]) -> float:
    """Return the time [s] that an action takes."""
    began = time.perf_counter()
    action()
    return time.perf_counter() - began


def sweep_job(amplitude: float, quick: bool = False) -> Job:
    """Return FRA of the paper's machine at 100 frequencies, 1 to 200 Hz.

    Either the proposed method as studies have it by default, or `quick` both methods, settled to 1e-4, on an ideal
    scale with the numerics that 0.01 dB need.
    """
    sections = sections_of(MACHINE)
    excitation = {"name": "stepped_sine", "amplitude": amplitude}
    proposed = {"name": "effective_input", "friction": sections["friction"]}
    path = {"input_dead_time": sections["loop"]["input_dead_time"]}
    experiment = {"source": "loop", **sections, "excitation": excitation, "numerics": {}}
    if not quick:
        return Job(experiment, ({**proposed, **path},))
    experiment |= {
        "excitation": {**excitation, "settling_tolerance": 1e-4},
        "loop": {**sections["loop"], "resolution": 0.0},
        "numerics": {"tolerance": 1e-3},
    }
    return Job(experiment, ({"name": "conventional"}, {**proposed, **path, "oversampling": 2}))


def greatest_error(job: Job) -> float:
    """Return the greatest error of the last estimator against P(jω) [dB]."""
    answer = run_job(job, lambda _: None)[-1]
    if isinstance(answer, Failure) or answer.response is None:
        raise SystemExit(f"no response: {answer.message}")
    truth = reference_response(job.experiment, answer.response.frequency, discover())
    return float(np.max(np.abs(20 * np.log10(np.abs(answer.response.response / truth)))))


def command(*arguments: str, folder: str) -> Callable[[], object]:
    """Return an action that runs Python with these arguments in a folder, in a fresh process."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return lambda: subprocess.run([sys.executable, *arguments], cwd=folder, check=True, capture_output=True, env=kept)


def shares(runs: int) -> int:
    """Time commands in turn with the imports that they cannot do without; return how many bounds are missed."""
    with tempfile.TemporaryDirectory() as folder:
        actions = {name: command(*said, folder=folder) for name, (said, _) in STARTS.items()}
        actions = {"imports": command(*IMPORTS, folder=folder)} | actions
        command(*FRAEXP, "run", "paper/fig12", folder=folder)()
        for action in actions.values():
            action()
        times = [{name: timed(action) for name, action in actions.items()} for _ in range(runs)]
    missed = 0
    for name, (_, bound) in STARTS.items():
        share = statistics.median(turn[name] for turn in times) / statistics.median(turn["imports"] for turn in times)
        missed += row(f"{name} over importing numpy, sqlalchemy, pydantic", share, bound, "×")
    return missed


def row(what: str, taken: float, bound: float | None, unit: str = "s") -> bool:
    """Print a time [s], or a share [×], with its bound; return whether the bound is missed."""
    missed = bound is not None and taken > bound
    print(
        f"{what:<72s}{taken:8.3f} {unit}" + (f" ({bound:g})" if bound else "") + (" MISSED" if missed else ""),
        flush=True,
    )
    return missed


def fresh_processes(runs: int) -> int:
    """Time what a user waits for in a shell; return how many bounds are missed."""
    with tempfile.TemporaryDirectory() as folder:
        again = [*FRAEXP, "run", "quick", "--rerun", "all", "--executor", "serial"]
        reused = [*FRAEXP, "run", "paper/fig12"]
        command(*reused, folder=folder)()
        rows = [
            ("python alone", ["-c", ""], None),
            ("import fraexp.api", ["-c", "import fraexp.api"], None),
            ("fraexp --help", [*FRAEXP, "--help"], 0.3),
            ("fraexp plugins", [*FRAEXP, "plugins"], None),
            ("first result of study quick in a fresh process, laws compiled before", ["-c", FIRST], 1.5),
            ("all of study quick, the same, with its figure", again, None),
            ("study paper/fig12, reused", reused, 1.0),
            ("fraexp list", [*FRAEXP, "list"], None),
        ]
        missed = sum(row(what, median_time(command(*said, folder=folder), runs), bound) for what, said, bound in rows)
        size = sum(file.stat().st_size for file in Path(folder).glob("results.db*"))
        print(f"database with these studies: {size / 1024:.0f} KiB")
    return missed


def main() -> int:
    """Print all times; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--reduced", action="store_true", help="fewer runs")
    runs = 3 if options.parse_args().reduced else 7
    missed = 0
    for amplitude in (12.0, 75.0):
        job = sweep_job(amplitude)
        taken = median_time(lambda job=job: run_job(job, lambda _: None), runs)  # type: ignore[misc]
        missed += row(f"sweep of 100 frequencies, 1…200 Hz, {amplitude:g} N, with its estimate, warm", taken, 0.5)
    job = sweep_job(12.0, quick=True)
    taken = median_time(lambda: run_job(job, lambda _: None), 5 * runs)
    missed += row(f"the same at 12 N, both methods, to {greatest_error(job):.3f} dB", taken, 0.02)
    missed += fresh_processes(runs)
    missed += shares(3 * runs)
    print(f"{missed} missed")
    return min(missed, 1)


if __name__ == "__main__":
    sys.exit(main())
