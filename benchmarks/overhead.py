"""Measure the overhead of a sweep: sending it to a worker, and storing its result.

    python benchmarks/overhead.py             5000 tiny sweeps per executor, and two workers beside one on real sweeps
    python benchmarks/overhead.py --quick     500 tiny sweeps only

Tiny sweeps are a driven friction model without friction and an estimator that does nothing: what is left is claiming,
sending, answering, storing and reporting. The time of the bare computation in this process is subtracted from the time
per sweep. Real sweeps are those of the paper's machine at 75 N, of 30 frequencies each; pairs of runs with one and two
workers follow one another, and the median of their ratios is printed. Exit code 1 if a target is missed.
"""

import argparse
import importlib.util
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from fraexp.execution.events import Finished
from fraexp.execution.job import Job, run_job
from fraexp.workspace.workspace_service import WorkspaceService

PLUGIN = '''
from fraexp.api import Estimator, Metric, Outcome, Result


class Trivial(Estimator, name="trivial", version=1):
    """Does next to nothing."""

    def estimate(self, signals):
        """Return one metric."""
        return Result(Outcome.OK, metrics=(Metric("peak", float(signals.segments[0].channels["friction"][0, 0]), "N"),))
'''
TINY = """
[loop]
sample_time = 1e-3
[friction]
name = "none"
[estimator]
name = "trivial"
[excitation]
name = "displacement_sine"
frequency = 10.0
[grid]
"excitation.amplitude" = {values}
"""
REAL = """
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
amplitude = 75
points = 30
[estimator]
name = "conventional"
[grid]
"friction.curve.coulomb_force" = {values}
"""
MOST = 2.0
"""Maximum overhead per sweep [ms]."""
MOST_BY_DASK = 5.0
"""The same through Dask."""
LEAST_GAIN = 1.8
"""Rate of two workers over that of one, at least."""


def bare(workspace: WorkspaceService, name: str) -> float:
    """Return the seconds that computing takes per sweep, in this process."""
    sweeps = workspace.studies([name])[0].sweeps
    jobs = [Job(s.experiment, (s.estimator,), s.files, str(workspace.folder / "plugins")) for s in sweeps[:500]]
    run_job(jobs[0], lambda _: None)
    began = time.perf_counter()
    for job in jobs:
        run_job(job, lambda _: None)
    return (time.perf_counter() - began) / len(jobs)


def stored(folder: Path, name: str, executor: str, database: str) -> tuple[float, float, int]:
    """Run a study; return seconds, processor seconds of this process, and sweeps, all without the first fifth."""
    workspace = WorkspaceService.open(folder, str(folder / database))
    moments = []
    for event in workspace.run([name], executor):
        if isinstance(event, Finished):
            if event.state != "computed":
                raise SystemExit(f"{event.state}: {event.error}")
            moments.append((time.perf_counter(), time.process_time()))
    first = len(moments) // 5  # workers are up by then
    (began, spent), (ended, used) = moments[first], moments[-1]
    return ended - began, used - spent, len(moments) - 1 - first


def overhead(folder: Path, executor: str, sweeps: int) -> float:
    """Print and return what a tiny sweep costs beside computing it [ms]."""
    (folder / "studies" / "tiny.toml").write_text(
        TINY.format(values=[round((n + 1) * 1e-6, 9) for n in range(sweeps)]), encoding="utf-8"
    )
    alone = bare(WorkspaceService.open(folder), "tiny")
    wall, used, count = stored(folder, "tiny", executor, f"{executor.partition(':')[0]}.db")
    shared = alone if executor == "serial" else 0.0  # this process computes nothing itself then
    cost = 1e3 * (wall / count - alone)
    cpu = 1e3 * (used / count - shared)
    name = executor.partition(":")[0]
    print(f"{name:<12} {count} sweeps: {1e3 * wall / count:.2f} ms each, {1e3 * alone:.2f} ms bare: "
          f"{cost:.2f} ms more; the scheduler's process is busy for {cpu:.2f} ms of it", flush=True)  # fmt: skip
    return min(cost, cpu)


@contextmanager
def cluster(folder: Path) -> Iterator[str]:
    """Start a Dask scheduler and two workers, and yield the name of their executor."""
    command, file = [sys.executable, "-m", "dask"], folder / "scheduler.json"
    quiet = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    local = ["--scheduler-file", str(file), "--no-dashboard", "--host", "127.0.0.1"]
    processes = [subprocess.Popen([*command, "scheduler", "--port", "0", *local], **quiet)]
    try:
        while not file.exists():
            time.sleep(0.1)
        processes += [subprocess.Popen([*command, "worker", *local, "--nthreads", "1"], **quiet) for _ in range(2)]
        yield f"dask:{file}"
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            process.wait()


def gain(folder: Path, sweeps: int, pairs: int) -> float:
    """Print and return the rate of two workers over that of one on real sweeps: the median of pairs."""
    (folder / "studies" / "real.toml").write_text(
        REAL.format(values=[round(12 + 12 * n / sweeps, 6) for n in range(sweeps)]), encoding="utf-8"
    )
    ratios = []
    for pair in range(pairs):
        rates = []
        for workers in (1, 2):
            wall, _, count = stored(folder, "real", f"processes:{workers}", f"real-{pair}-{workers}.db")
            rates.append(count / wall)
        ratios.append(rates[1] / rates[0])
        print(
            f"pair {pair + 1}: {rates[0]:.2f}/s with one worker, {rates[1]:.2f}/s with two: {ratios[-1]:.2f}",
            flush=True,
        )
    print(f"two workers compute {statistics.median(ratios):.2f} times what one does")
    return statistics.median(ratios)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer sweeps, and no pairs")
    parser.add_argument("--sweeps", type=int, default=5000, help="tiny sweeps per executor")
    parser.add_argument("--pairs", type=int, default=5, help="pairs of runs with one and two workers")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("plugins", "studies"):
            (folder / part).mkdir()
        (folder / "plugins" / "trivial.py").write_text(PLUGIN, encoding="utf-8")
        costs = [overhead(folder, of, 500 if given.quick else given.sweeps) for of in ("serial", "processes:2")]
        if importlib.util.find_spec("distributed"):
            with cluster(folder) as executor:
                costs.append(MOST / MOST_BY_DASK * overhead(folder, executor, 500 if given.quick else given.sweeps))
        else:
            print("dask         left out: it is not installed")
        gained = LEAST_GAIN if given.quick or not given.pairs else gain(folder, 300, given.pairs)
    return int(max(costs) > MOST or gained < LEAST_GAIN)


if __name__ == "__main__":
    sys.exit(main())
