"""Compare this version with a former one, side by side: a sweep of 100 frequencies, and Monte-Carlo sweeps of 30.

    python benchmarks/former_version.py                      against the version before machines of any shape
    python benchmarks/former_version.py --commit C --turns 40

The former version is taken from git into a folder of its own, with its own compiled laws. Each version computes in a
process of its own; they take turns, one at a time. Printed are medians of the processor time of a sweep, and the median
ratio of the turns. Of this version's time the part is printed that compiled loops and Fourier transforms take: what is
left of it if everything around them cost nothing. The exit code is 1 if a bound, given in brackets, is missed.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

TREE = Path(__file__).parents[1]
COMMIT = "da7e2e9"
"""The last version before machines of any shape: it has no check of steps, and none of the friction model."""
BOUND = 0.4
CASES = {
    "sweep of 100 frequencies, both methods": ("sweep", 4),
    "Monte-Carlo sweep of 30 frequencies, proposed method": ("proposed", 8),
    "the same, conventional method": ("conventional", 8),
}
"""What is compared: the name that the worker knows, and the sweeps of a turn."""
WORKER = '''
import os, random, sys, tempfile, time
from pathlib import Path

tree, case, shares = sys.argv[1:]
sys.path[:0] = [tree, tree + "/plugins", tree + "/benchmarks"]
import numpy as np
import fraexp
import timing
from fraexp.execution.job import Job
from monte_carlo import STUDY

assert fraexp.__file__.startswith(tree), fraexp.__file__
try:
    from fraexp.execution.job import run_job
    from fraexp.workspace.workspace_service import WorkspaceService
    proposed = "effective_input"
except ImportError:  # names of the former version
    from fraexp.execution.job import perform as run_job
    from fraexp.workspace.workspace import Workspace as WorkspaceService
    proposed = "proposed"

spent = 0.0

def timed(module, name):
    """Add the processor time of a function to what is spent in compiled loops and transforms."""
    compute = getattr(module, name)
    def measured(*given, **options):
        global spent
        began = time.process_time()
        try:
            return compute(*given, **options)
        finally:
            spent += time.process_time() - began
    setattr(module, name, measured)

def jobs():
    if case == "sweep":
        return [timing.sweep_job(12.0, quick=True)]
    draw, estimator = random.Random(1), {"proposed": proposed}.get(case, case)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "studies").mkdir()
        study = STUDY.format(forces=[round(draw.gauss(17.9, 1.5), 5) for _ in range(400)])
        (Path(folder) / "studies" / "draws.toml").write_text(study.replace('"conventional"', f'"{estimator}"'))
        sweeps = WorkspaceService.open(folder).studies(["draws"])[0].sweeps
    return [Job(sweep.experiment, (sweep.estimator,), sweep.files) for sweep in sweeps]

work, done = jobs(), 0
for job in work[:4]:
    run_job(job, lambda _: None)
if shares == "shares":
    from fraexp.kernels import batch, prescribed_motion
    timed(batch, "advance")
    timed(np.fft, "rfft")
    timed(np.fft, "irfft")
    drive = prescribed_motion._compiled_drive()
    class Holder:
        run = staticmethod(drive)
    timed(Holder, "run")
    prescribed_motion._compiled_drive = lambda: Holder.run
print("ready", flush=True)
for line in sys.stdin:
    spent, began = 0.0, time.process_time()
    for _ in range(int(line)):
        run_job(work[done % len(work)], lambda _: None)
        done += 1
    print((time.process_time() - began) / int(line), spent / int(line), flush=True)
'''


@dataclass
class Version:
    """A version that computes in a process of its own."""

    process: "subprocess.Popen[str]"

    @classmethod
    def started(cls, tree: Path, case: str, with_shares: bool = False) -> "Version":
        """Return the version in a folder, ready to compute a case."""
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        own = {} if tree == TREE else {"FRAEXP_CACHE_DIR": str(tree / "cache")}
        command = [sys.executable, "-c", WORKER, str(tree), case, "shares" if with_shares else ""]
        environment = {"OPENBLAS_NUM_THREADS": "1", **kept, **own}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        version = cls(subprocess.Popen(command, cwd=tree, env=environment, text=True, **pipes))  # type: ignore[call-overload]
        version._answer()
        return version

    def turn(self, sweeps: int) -> tuple[float, float]:
        """Return the processor time of a sweep [s], and that of its compiled loops and transforms, if asked for."""
        assert self.process.stdin
        self.process.stdin.write(f"{sweeps}\n")
        self.process.stdin.flush()
        whole, part = self._answer().split()
        return float(whole), float(part)

    def end(self) -> None:
        """End the process."""
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait()

    def _answer(self) -> str:
        assert self.process.stdout
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("a version ended before it answered; its error is above")
        return line


def former_tree(commit: str, folder: Path) -> Path:
    """Write a commit into a folder, and return it."""
    archive = subprocess.run(["git", "archive", commit], cwd=TREE, check=True, capture_output=True).stdout
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive, check=True)
    return folder


def in_turns(versions: list[Version], sweeps: int, turns: int) -> list[list[tuple[float, float]]]:
    """Return what each version took in each turn."""
    found: list[list[tuple[float, float]]] = [[] for _ in versions]
    for _ in range(turns):
        for version, taken in zip(versions, found, strict=True):
            taken.append(version.turn(sweeps))
    return found


def compare(what: str, case: str, sweeps: int, turns: int, former: Path) -> bool:
    """Print a row; return whether the bound is missed."""
    versions = [Version.started(former, case), Version.started(TREE, case), Version.started(TREE, case, True)]
    before, now, shared = in_turns(versions, sweeps, turns)
    for version in versions:
        version.end()
    ratio = statistics.median(new[0] / old[0] for new, old in zip(now, before, strict=True))
    loops = statistics.median(each[1] / old[0] for each, old in zip(shared, before, strict=True))
    new_ms, old_ms = (1e3 * statistics.median(each[0] for each in taken) for taken in (now, before))
    missed = ratio > BOUND
    text = (
        f"{new_ms:6.1f} ms over {old_ms:6.1f}: {ratio:.2f} times ({BOUND}), compiled loops and transforms {loops:.2f}"
    )
    print(f"{what:<54s}{text}{'  MISSED' if missed else ''}", flush=True)
    return missed


def main() -> int:
    """Print all rows; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--commit", default=COMMIT, help="the former version")
    options.add_argument("--turns", type=int, default=20)
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        former = former_tree(given.commit, Path(folder))
        missed = [compare(what, *case, given.turns, former) for what, case in CASES.items()]
    print(f"{sum(missed)} missed")
    return int(any(missed))


if __name__ == "__main__":
    sys.exit(main())
