"""Measure how time and memory grow with the size of a study.

    python benchmarks/scaling.py            some minutes
    python benchmarks/scaling.py --reduced  smaller sizes, half a minute

Time over friction elements, modes, frequencies, amplitudes and stored sweeps: the exponent p of time ~ size^p, fitted
by least squares in logarithms; linear is 1. Processor time of a warm sweep per frequency, of many frequencies over 330.
Then the rate with two worker processes over that with one, and the peak
memory of fresh processes. The exit code is 1 if a bound is missed.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from calibrate_machine import MACHINE, sections_of
from timing import sweep_job

from fraexp.execution.events import Finished
from fraexp.execution.job import Failure, Job, run_job
from fraexp.workspace.workspace_service import WorkspaceService

GROWTH, CORES, GROWN, CLIFF = 1.1, 1.7, 1.15, 1.1
"""Bounds: greatest exponent, least gain of a second core, greatest ratio of memory with four times as many sweeps,
greatest ratio of times per frequency."""
FREQUENCIES, MORE_FREQUENCIES = 330, (360, 700, 1000)
"""Frequencies of a sweep, and numbers of them that tables once had no room for."""
STUDY = """
title = "Monte-Carlo over the presliding width"
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
amplitude = 12.0
min_frequency = 10.0
points = 30
[estimator]
name = "effective_input"
[grid]
"friction.curve.characteristic_displacement" = [{widths}]
"""
PEAK = """
import sys
from pathlib import Path

def peak():
    status = Path("/proc/self/status")
    if status.exists():  # the other way also counts what the process was before it became Python
        return int(status.read_text().split("VmHWM:")[1].split()[0]) / 1024
    import resource
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20

{work}
print(peak())
"""
RUN = """
from fraexp.workspace.workspace_service import WorkspaceService
for _ in WorkspaceService.open(".").run(["{study}"], "serial"):
    pass
"""


class Bounds:
    """Prints rows and counts those that miss their bound."""

    def __init__(self) -> None:
        self.missed = 0

    def row(self, what: str, value: str, met: bool) -> None:
        """Print a row."""
        self.missed += not met
        print(f"{what:<64s}{value:<64s} {'ok' if met else 'MISSED'}", flush=True)


def job(points: int = 20, amplitude: float = 12.0, elements: int = 20, modes: int = 2) -> Job:
    """Return a sweep of 20 to 200 Hz that simulates the same time at each frequency."""
    sections: dict[str, Any] = sections_of(MACHINE)
    friction = {**sections["friction"], "curve": {**sections["friction"]["curve"], "elements": elements}}
    plant = {
        **sections["plant"],
        "frequencies": [38.8 + 41.2 * i for i in range(modes)],
        "damping_ratios": [0.04] * modes,
        "modal_gain_ratios": [0.6 / modes] * modes,
    }
    excitation = {
        "name": "stepped_sine", "amplitude": amplitude, "points": points, "min_frequency": 20.0,
        "settling_tolerance": 1e-12, "settling_timeout": 1.0,
    }  # fmt: skip
    experiment = {"source": "loop", **sections, "plant": plant, "friction": friction, "excitation": excitation}
    path = {"input_dead_time": sections["loop"]["input_dead_time"]}
    return Job({**experiment, "numerics": {}}, ({"name": "effective_input", "friction": friction, **path},))


def performed(*jobs: Job) -> Callable[[], None]:
    """Return an action that performs jobs one after another."""

    def action() -> None:
        for one in jobs:
            for answer in run_job(one, lambda _: None):
                if isinstance(answer, Failure) or answer.response is None:
                    raise SystemExit(f"no response: {answer.message}")

    return action


def exponent(sizes: list[int], times: list[float]) -> float:
    """Return p of time ~ size^p."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def in_turns(actions: list[Callable[[], object]], repetitions: int) -> list[float]:
    """Return the median time [s] of each action; they take turns, and a first turn is not counted."""
    times: list[list[float]] = [[] for _ in actions]
    for turn in range(repetitions + 1):
        for action, taken in zip(actions, times, strict=True):
            began = time.perf_counter()
            action()
            if turn:
                taken.append(time.perf_counter() - began)
    return [statistics.median(taken) for taken in times]


def growth(reduced: bool, bounds: Bounds) -> None:
    """Time over the sizes of one job, and over the number of jobs."""
    sizes = [4, 8, 16] if reduced else [4, 8, 16, 32, 64]
    kinds: dict[str, Callable[[int], Callable[[], object]]] = {
        "friction elements, times 5": lambda n: performed(job(elements=5 * n)),
        "modes": lambda n: performed(job(modes=n)),
        "frequencies, times 5": lambda n: performed(job(points=5 * n)),
        "amplitudes": lambda n: performed(*(job(amplitude=12.0 + i) for i in range(n))),
    }
    for name, made in kinds.items():
        used = [n for n in sizes if n <= 16] if name == "modes" else sizes
        times = in_turns([made(n) for n in used], 3 if reduced else 5)
        grown(name, used, times, bounds)


def many_frequencies(reduced: bool, bounds: Bounds) -> None:
    """Processor time of a warm sweep, both methods, over the number of its frequencies; they take turns."""
    quick = sweep_job(12.0, quick=True)
    for count in MORE_FREQUENCIES[: 1 if reduced else None]:
        jobs = [
            replace(
                quick, experiment={**quick.experiment, "excitation": {**quick.experiment["excitation"], "points": n}}
            )
            for n in (FREQUENCIES, count)
        ]
        ratios = []
        for _ in range(4 if reduced else 8):
            few, many = (warm_time(one) / n for one, n in zip(jobs, (FREQUENCIES, count), strict=True))
            ratios.append(many / few)
        ratio = statistics.median(ratios)
        what = f"time per frequency, {count} over {FREQUENCIES} frequencies"
        bounds.row(what, f"{ratio:.3f} ({CLIFF})", ratio <= CLIFF)


def warm_time(one: Job) -> float:
    """Return the processor time [s] of a job that has just been performed."""
    performed(one)()
    began = time.process_time()
    performed(one)()
    return time.process_time() - began


def grown(name: str, sizes: list[int], times: list[float], bounds: Bounds) -> None:
    """Print the times and the exponent."""
    p = exponent(sizes, times)
    text = " ".join(f"{n}: {taken * 1e3:.4g}" for n, taken in zip(sizes, times, strict=True))
    bounds.row(f"time [ms] over {name}", f"{text}; exponent {p:.2f} ({GROWTH})", p <= GROWTH)


def studies(folder: Path, counts: list[int]) -> Iterator[str]:
    """Write a study of each number of sweeps; no two share one."""
    (folder / "studies").mkdir()
    for number, count in enumerate(counts):
        widths = ", ".join(f"{45e-6 * (1 + 0.1 * number + 0.05 * i / count):.12g}" for i in range(count))
        (folder / "studies" / f"of{number}.toml").write_text(STUDY.format(widths=widths), encoding="utf-8")
        yield f"of{number}"


def stored(folder: Path, study: str, executor: str, number: int) -> tuple[float, float]:
    """Run a study into an empty database; return the time in all [s], and the sweeps per second between first and last.

    The second figure leaves out how long worker processes take to start.
    """
    began, finished = time.perf_counter(), []
    for event in WorkspaceService.open(folder, str(folder / f"{number}.db")).run([study], executor):
        if isinstance(event, Finished):
            finished.append(time.perf_counter())
    return time.perf_counter() - began, (len(finished) - 1) / (finished[-1] - finished[0])


def sweeps(reduced: bool, bounds: Bounds) -> None:
    """Time over stored sweeps, and the gain of a second process."""
    counts = [5, 10, 20] if reduced else [25, 50, 100, 200]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        names = list(studies(folder, counts))
        stored(folder, names[0], "serial", -1)
        times = [stored(folder, study, "serial", number)[0] for number, study in enumerate(names)]
        grown("stored sweeps of 30 frequencies, one process", counts, times, bounds)
        if (os.cpu_count() or 1) < 2:
            return
        rates: dict[int, list[float]] = {1: [], 2: []}
        for turn in range(3):
            for cores, found in rates.items():
                found.append(stored(folder, names[-1], f"processes:{cores}", 100 * cores + turn)[1])
        one, two = statistics.median(rates[1]), statistics.median(rates[2])
        held = "too few to be held to it" if reduced else f"{CORES}"  # workers load compiled code at their first sweep
        text = f"{one:.4g} and {two:.4g} per second: {two / one:.2f} times ({held})"
        bounds.row(f"{counts[-1]} stored sweeps, by one and by two processes", text, reduced or two / one >= CORES)


def peak_memory(work: str, folder: Path) -> float:
    """Return the peak memory [MiB] of a fresh process that does this work."""
    script = [sys.executable, "-c", PEAK.format(work=work)]
    return float(subprocess.run(script, cwd=folder, check=True, capture_output=True, text=True).stdout)


def memory(reduced: bool, bounds: Bounds) -> None:
    """Peak memory of fresh processes; more sweeps must not need more."""
    counts = [5, 20] if reduced else [50, 200]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        names = list(studies(folder, counts))
        peaks = [peak_memory(RUN.format(study=study), folder) for study in names]
        works = {"python": "", "import of fraexp.api": "import fraexp.api", "study quick": RUN.format(study="quick")}
        for what, work in works.items():
            bounds.row(f"peak memory, {what}", f"{peak_memory(work, folder):.0f} MiB", True)
    text = " ".join(f"{count}: {peak:.0f}" for count, peak in zip(counts, peaks, strict=True))
    ratio = peaks[1] / peaks[0]
    bounds.row("peak memory [MiB] over stored sweeps", f"{text}; ratio {ratio:.2f} ({GROWN})", ratio <= GROWN)


def main() -> int:
    """Print all rows; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--reduced", action="store_true", help="smaller sizes")
    reduced = options.parse_args().reduced
    bounds = Bounds()
    for part in (growth, many_frequencies, sweeps, memory):
        part(reduced, bounds)
    print(f"{bounds.missed} missed")
    return min(bounds.missed, 1)


if __name__ == "__main__":
    sys.exit(main())
