"""What numerical certificate and check of the friction model cost: sweeps with them over sweeps without, in turns.

Each turn compares processor times of one process, the two in alternating order. The figure is the median.
"""

import argparse
import statistics
import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

from fraexp_plugins.estimators import effective_input

from fraexp.components.registry import Registry, discover
from fraexp.execution.job import Job, run_job
from fraexp.simulation import loop
from fraexp.study.study_file import load

MAX_RATIO = 1.2
"""Most that a sweep may cost over one without certificate."""
ROOT = Path(__file__).resolve().parents[1]
CASES = {"paper/fig12": [], "paper/fig12, ideal encoder": ["loop.resolution=0"]}
FORMER_OVERSAMPLING = 4


def jobs_of(name: str, overrides: list[str], registry: Registry) -> list[Job]:
    """Return the jobs of a study."""
    file = ROOT / "studies" / f"{name.partition(',')[0]}.toml"
    groups = defaultdict(list)
    for sweep in load(name, file, ROOT, registry, overrides).sweeps:
        groups[sweep.experiment_key].append(sweep)
    return [Job(group[0].experiment, tuple(sweep.estimator for sweep in group)) for group in groups.values()]


def without_choice(job: Job) -> Job:
    """Return a job whose observers do not choose their points per sample."""
    fixed = tuple(
        {**spec, "oversampling": FORMER_OVERSAMPLING} if "oversampling" in spec else spec for spec in job.estimators
    )
    return replace(job, estimators=fixed)


def processor_time(jobs: list[Job]) -> float:
    """Return the processor time [s] of jobs."""
    begin = time.thread_time()
    for job in jobs:
        run_job(job, lambda _: None)
    return time.thread_time() - begin


def unchecked_time(jobs: list[Job]) -> float:
    """Return the processor time [s] of jobs without certificate and check of the friction model."""
    with patch.object(loop, "verify", lambda *_: None), patch.object(effective_input, "model_error", lambda *_: None):
        return processor_time(jobs)


def ratios(jobs: list[Job], turns: int) -> list[float]:
    """Return the ratio of jobs with all checks to those without, in each turn."""
    plain, found = [without_choice(job) for job in jobs], []
    for turn in range(turns + 1):
        if turn % 2:
            checked, unchecked = processor_time(jobs), unchecked_time(plain)
        else:
            unchecked, checked = unchecked_time(plain), processor_time(jobs)
        found.append(checked / unchecked)
    return found[1:]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=20, help="comparisons of each case")
    turns, registry, missed = parser.parse_args().turns, discover(None), 0
    for name, overrides in CASES.items():
        found = ratios(jobs_of(name, overrides, registry), turns)
        middle = statistics.median(found)
        missed += middle > MAX_RATIO
        low, _, high = statistics.quantiles(found, n=4)
        print(f"{name:32} {middle:.3f} times, quartiles {low:.3f} and {high:.3f}, bound {MAX_RATIO}", flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
