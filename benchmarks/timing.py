"""Measure the times that the README states: a warm sweep, a reused study, the help text, a first result.

    python benchmarks/timing.py

Each figure is the median of several runs; the machine should have nothing else to do.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from calibrate_machine import MACHINE, sections_of

from fraexp.perform import Job, perform

FRAEXP = [sys.executable, "-m", "fraexp"]


def median_time(action: Callable[[], object], runs: int) -> float:
    """Return the median time [s] of an action over several runs, after one that is not counted."""
    action()
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        action()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def sweep_job(amplitude: float) -> Job:
    """Return both methods on the paper's machine at 100 frequencies, 1 to 200 Hz."""
    sections = sections_of(MACHINE)
    experiment = {
        "source": "loop",
        **sections,
        "excitation": {"name": "stepped_sine", "amplitude": amplitude},
        "numerics": {},
    }
    path = {"input_dead_time": sections["loop"]["input_dead_time"]}
    return Job(experiment, ({"name": "proposed", "friction": sections["friction"], **path},))


def command(*arguments: str, folder: str) -> Callable[[], object]:
    """Return an action that runs fraexp in a folder."""
    return lambda: subprocess.run([*FRAEXP, *arguments], cwd=folder, check=True, capture_output=True)


def main() -> None:
    """Print all times."""
    for amplitude in (12.0, 75.0):
        job = sweep_job(amplitude)
        taken = median_time(lambda job=job: perform(job, lambda _: None), 7)  # type: ignore[misc]
        print(
            f"sweep of 100 frequencies, 1…200 Hz, {amplitude:g} N, simulated and estimated, warm: {taken:.3f} s (0.5)"
        )
    with tempfile.TemporaryDirectory() as folder:
        fresh = ["run", "quick", "--rerun", "all", "--executor", "serial"]
        print(f"fraexp --help: {median_time(command('--help', folder=folder), 7):.3f} s (0.3)")
        print(f"study quick, fresh process, laws compiled: {median_time(command(*fresh, folder=folder), 3):.2f} s")
        command("run", "paper/fig12", folder=folder)()
        print(f"study paper/fig12, reused: {median_time(command('run', 'paper/fig12', folder=folder), 7):.3f} s (1)")
        size = sum(file.stat().st_size for file in Path(folder).glob("results.db*"))
        print(f"database with these studies: {size / 1024:.0f} KiB")


if __name__ == "__main__":
    main()
