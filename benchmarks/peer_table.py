"""Simulate the paper's closed loop with fraexp and with its alternatives, side by side in one process.

    python benchmarks/peer_table.py            all packages that are installed: pip install --group bench
    python benchmarks/peer_table.py --reduced  fraexp, NumPy, scipy and python-control; some seconds

All run on one core. Each row: simulated seconds per second of computing, the median of repetitions that take turns;
the time of the first run, which compiles; the greatest relative error of Y/U_e at 5, 36 and 150 Hz, 12 N, after half a
second from rest with an ideal encoder; and how much faster fraexp is with the same error or less. Programs that run
all frequencies side by side are timed on a sweep, the others on those three. The exit code is 1 if an error is greater
than its row claims.
"""

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from peers.problem import Peer, Problem, Run, paper_loop
from peers.reference import reference

ALWAYS = ("with_fraexp", "reference", "numpy_loops", "with_scipy", "with_control")
OTHERS = ("with_pathsim", "with_drake", "with_jaxonomy", "with_jax")
FREQUENCIES, SAMPLES = np.array([5.0, 36.0, 150.0]), 1000
SHORTEST = 0.05
"""A repetition takes so many runs that it lasts this long at least [s]."""

EQUAL = 1.1
"""Errors whose ratio is no greater count as equal."""


@dataclass
class Row:
    """A peer, made ready, and what was measured."""

    peer: Peer
    run: Run
    first: float
    error: float
    simulated_time: float
    times: list[float] = field(default_factory=list)

    @property
    def speed(self) -> float:
        """Simulated seconds per second."""
        return self.simulated_time / statistics.median(self.times)

    def repeat(self, patience: float) -> None:
        """Time one more repetition, unless all took longer than `patience` [s] already."""
        if sum(self.times) > patience:
            return
        began, runs = time.perf_counter(), 0
        while runs == 0 or time.perf_counter() - began < SHORTEST:
            self.run()
            runs += 1
        self.times.append((time.perf_counter() - began) / runs)


def prepared(peer: Peer, problem: Problem, truth: np.ndarray, sweep: Problem) -> Row:
    """Return a peer's row with its error and the time of its first run."""
    run = peer.prepare(problem)
    began = time.perf_counter()
    u, y = run()
    first = time.perf_counter() - began
    error = float(np.max(np.abs(problem.response(u, y) / truth - 1)))
    if peer.batch:
        problem, run = sweep, peer.prepare(sweep)
        began = time.perf_counter()
        run()
        first = time.perf_counter() - began
    return Row(peer, run, first, error, problem.simulated_time)


def chosen(names: tuple[str, ...]) -> Iterator[Peer]:
    """Return the peers of these modules whose packages are installed; say which are not."""
    for peer in (peer for name in names for peer in import_module(f"peers.{name}").peers()):
        if not peer.package or find_spec(peer.package):
            yield peer
        else:
            print(f"(left out, as {peer.package} is not installed: {peer.name}, {peer.settings})", file=sys.stderr)


def measure(names: tuple[str, ...], samples: int, repetitions: int, patience: float) -> list[Row]:
    """Return the rows of all peers, measured in turns."""
    problem = paper_loop(FREQUENCIES, SAMPLES)
    sweep = paper_loop(np.geomspace(5.0, 200.0, 100), samples)
    truth = problem.response(*reference(problem)())
    rows = []
    for peer in chosen(names):
        print(f"  preparing {peer.name}, {peer.settings}", file=sys.stderr)
        rows.append(prepared(peer, problem, truth, sweep))
    for _ in range(repetitions):
        for row in rows:
            row.repeat(patience)
    return rows


def report(rows: list[Row]) -> int:
    """Print the table, fastest first; return how many rows miss what they claim."""
    own = [row for row in rows if row.peer.name == "fraexp"]
    print(f"{'who':<38s}{'settings':<42s}{'s/s':>9s}{'first s':>9s}{'error':>10s}{'claimed':>9s}{'fraexp x':>10s}")
    missed = 0
    for row in sorted(rows, key=lambda row: -row.speed):
        better = [one.speed for one in own if one.error <= EQUAL * row.error and row not in own]
        factor = max(better, default=0.0) / row.speed
        ratio = (f"{factor:,.0f}" if factor >= 100 else f"{factor:.3g}") if better else ""
        verdict = "" if row.error <= row.peer.error else "  MISSED"
        missed += bool(verdict)
        print(
            f"{row.peer.name:<38s}{row.peer.settings:<42s}{row.speed:>9.4g}{row.first:>9.2g}"
            f"{row.error:>10.1e}{row.peer.error:>9.0e}{ratio:>10s}{verdict}"
        )
    print(f"{missed} missed")
    return missed


def document(row: Row) -> dict[str, object]:
    """Return a row as plain data."""
    peer = row.peer
    return {
        "name": peer.name, "settings": peer.settings, "side_by_side": peer.batch, "speed": row.speed,
        "first_run": row.first, "error": row.error, "claimed_error": peer.error,
    }  # fmt: skip


def main() -> int:
    """Measure and report."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--reduced", action="store_true", help="the packages of the development environment only")
    options.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to this file")
    arguments = options.parse_args()
    if hasattr(os, "sched_setaffinity"):  # JAX takes all cores that it sees when it is first used
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    rows = measure(ALWAYS, 1000, 3, 0.5) if arguments.reduced else measure(ALWAYS + OTHERS, 2000, 7, 4.0)
    if arguments.json:
        arguments.json.write_text(json.dumps([document(row) for row in rows], indent=1) + "\n", encoding="utf-8")
    return 1 if report(rows) else 0


if __name__ == "__main__":
    sys.exit(main())
