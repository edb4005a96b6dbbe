"""Measure how time and memory grow with the size of a study.

    python benchmarks/scaling.py            some minutes
    python benchmarks/scaling.py --reduced  smaller sizes, half a minute

growth       time over friction elements, modes, frequencies and amplitudes: the exponent p of time ~ size^p, fitted by
             least squares in logarithms; linear is 1
frequencies  processor time of a warm sweep per frequency, of many frequencies over 330
planning     a grid of 100 × 100 × 100 sweeps is planned in a process of its own: computing time and memory

`benchmarks/monte_carlo.py` measures how stored sweeps scale with cores, and memory during a run.
"""

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from harness import Action, Bench, in_turns, run
from paper_machine import CURVE, PAPER, PATH, loop_job
from timing import performed, sweep_job

from fraexp.execution.job import Job

GROWTH, CLIFF = 1.1, 1.1
"""Bounds: greatest exponent, and greatest ratio of times per frequency."""
FREQUENCIES, MORE_FREQUENCIES = 330, (360, 700, 1000)
PLANNING_S, PLANNING_MB = 10.0, 1000.0
STUDY = """
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
frequencies = [20, 40, 80]
[estimator]
name = "effective_input"
[grid]
"plant.rigid_body_gain" = {gains}
"friction.viscous_coefficient" = {viscous}
"excitation.amplitude" = {amplitudes}
"""


def job(points: int = 20, amplitude: float = 12.0, elements: int = 20, modes: int = 2) -> Job:
    """Return a sweep of 20 to 200 Hz that simulates the same time at each frequency."""
    friction = {**PAPER["friction"], "curve": {**CURVE, "elements": elements}}
    plant = {
        **PAPER["plant"],
        "frequencies": [38.8 + 41.2 * i for i in range(modes)],
        "damping_ratios": [0.04] * modes,
        "modal_gain_ratios": [0.6 / modes] * modes,
    }
    excitation = {
        "name": "stepped_sine", "amplitude": amplitude, "points": points, "min_frequency": 20.0,
        "settling_tolerance": 1e-12, "settling_timeout": 1.0,
    }  # fmt: skip
    proposed = {"name": "effective_input", "friction": friction, **PATH}
    return loop_job({**PAPER, "plant": plant, "friction": friction}, excitation, proposed)


def growth(bench: Bench) -> None:
    """Time over the sizes of one job, and over the number of jobs."""
    sizes = [4, 8, 16] if bench.reduced else [4, 8, 16, 32, 64]
    kinds: dict[str, Callable[[int], Action]] = {
        "friction elements, times 5": lambda n: performed(job(elements=5 * n)),
        "modes": lambda n: performed(job(modes=n)),
        "frequencies, times 5": lambda n: performed(job(points=5 * n)),
        "amplitudes": lambda n: performed(*(job(amplitude=12.0 + i) for i in range(n))),
    }
    for name, made in kinds.items():
        used = [n for n in sizes if n <= 16] if name == "modes" else sizes
        times = np.median(in_turns(*map(made, used), turns=3 if bench.reduced else 5), axis=1)
        print(f"{name} [ms]: {' '.join(f'{n}: {1e3 * taken:.4g}' for n, taken in zip(used, times, strict=True))}")
        bench.bounded(f"exponent over {name}", float(np.polyfit(np.log(used), np.log(times), 1)[0]), GROWTH)


def frequencies(bench: Bench) -> None:
    """Processor time per frequency, both methods: medians of ratios."""
    for count in MORE_FREQUENCIES[: 1 if bench.reduced else None]:
        sizes = (FREQUENCIES, count)
        actions = [performed(sweep_job(points=n, is_quick=True)) for n in sizes]
        few, many = in_turns(*actions, turns=4 if bench.reduced else 8, clock=time.process_time) / np.c_[sizes]
        bench.bounded(f"{count} over {FREQUENCIES} frequencies", float(np.median(many / few)), CLIFF)


def planning(bench: Bench) -> None:
    """Computing time and peak memory of ``fraexp run --dry-run``."""
    points = range(bench.options.points)
    axes = {
        "gains": [0.1 + 1e-4 * n for n in points],
        "viscous": [4.0 + 0.01 * n for n in points],
        "amplitudes": [10.0 + 0.5 * n for n in points],
    }
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "many.toml"
        study.write_text(STUDY.format(**axes), encoding="utf-8")
        command = [sys.executable, "-m", "fraexp", "run", str(study), "--dry-run", "--workspace", folder]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    computing = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    what = f"{len(points) ** 3:,} sweeps planned"
    bench.bounded(what, computing, PLANNING_S, "s")
    bench.bounded(f"{what}, memory", used.ru_maxrss / 1e3, PLANNING_MB, "MB")


if __name__ == "__main__":
    run(__doc__, growth, frequencies, planning, points=(100, 20))
