"""What the numerical certificate costs: sweeps with it over the same sweeps without, in turns in one process."""

import argparse
import statistics
import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

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


def ratio(jobs: list[Job], turns: int) -> float:
    """Return the median ratio of a job with certificate to one without."""
    verify, plain = loop.verify, [without_choice(job) for job in jobs]
    ratios = []
    for _ in range(turns + 1):
        loop.verify = verify
        certified = processor_time(jobs)
        loop.verify = lambda *_: None  # type: ignore[assignment]
        ratios.append(certified / processor_time(plain))
    loop.verify = verify
    return statistics.median(ratios[1:])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=20, help="comparisons of each case")
    turns, registry, missed = parser.parse_args().turns, discover(None), 0
    for name, overrides in CASES.items():
        found = ratio(jobs_of(name, overrides, registry), turns)
        missed += found > MAX_RATIO
        print(f"{name:32} {found:.3f} times, bound {MAX_RATIO}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
