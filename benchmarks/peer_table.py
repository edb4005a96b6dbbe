"""Simulate the paper's closed loop with fraexp and with its alternatives, side by side in one process.

    python benchmarks/peer_table.py              all packages that are installed: pip install --group bench
    python benchmarks/peer_table.py --reduced    fraexp, NumPy, scipy and python-control; some seconds
    python benchmarks/peer_table.py --figure F   also draw the table into the file F

All run on one core. Each row: simulated seconds per second of computing, the median of repetitions that take turns;
the time of the first run, which compiles; the greatest relative error of Y/U_e at 5, 36 and 150 Hz, 12 N, after half a
second from rest with an ideal encoder; and how much faster fraexp is with the same error or less. Programs that run
all frequencies side by side are timed on a sweep, the others on those three. An error must be as small as its row
claims.
"""

import os
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from harness import Bench, run
from peers.problem import Peer, Problem, Run, paper_loop
from peers.reference import reference

ALWAYS = ("with_fraexp", "reference", "numpy_loops", "with_scipy", "with_control")
OTHERS = ("with_pathsim", "with_jax")
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


def draw_figure(rows: list[Row], file: Path) -> None:
    """Draw simulated seconds per second of computing, with the error of each, fastest on top."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = sorted(rows, key=lambda row: row.speed)
    figure = Figure(figsize=(8, 0.8 + 0.26 * len(rows)), layout="constrained")
    axes = figure.subplots()
    colours = ["#1b6ca8" if row.peer.name == "fraexp" else "#b9c3cc" for row in rows]
    axes.barh(range(len(rows)), [row.speed for row in rows], color=colours, height=0.75)
    axes.set_yticks(range(len(rows)), [f"{row.peer.name}, {row.peer.settings}" for row in rows], fontsize=8)
    for place, row in enumerate(rows):
        text = f" {row.speed:,.3g}   error {row.error:.0e}"
        axes.text(row.speed, place, text, va="center", fontsize=7.5, color="#333333")
    axes.set_xscale("log")
    axes.set_xlim(right=40 * max(row.speed for row in rows))
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.set_xlabel("simulated seconds per second of computing, one core")
    axes.set_title("The paper's closed loop with 20 friction elements", loc="left", fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    FigureCanvasAgg(figure).print_figure(file, dpi=110)


def peers(bench: Bench) -> None:
    """Simulated seconds per second, first run [s], error and the one claimed, and how much faster fraexp is."""
    if hasattr(os, "sched_setaffinity"):  # JAX takes all cores that it sees when it is first used
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    rows = measure(ALWAYS, 1000, 3, 0.5) if bench.reduced else measure(ALWAYS + OTHERS, 2000, 7, 4.0)
    own = [row for row in rows if row.peer.name == "fraexp"]
    for row in sorted(rows, key=lambda row: -row.speed):
        peer = row.peer
        better = [one.speed for one in own if one.error <= EQUAL * row.error and row not in own]
        ratio = f"  fraexp is {max(better) / row.speed:,.3g} times as fast" if better else ""
        text = f"{row.speed:>9.4g} s/s {row.first:>7.2g} s {row.error:>9.1e} {peer.error:>8.0e}{ratio}"
        bench.row(f"{peer.name}, {peer.settings}", text, row.error <= peer.error, speed=row.speed, error=row.error)
    if bench.options.figure:
        draw_figure(rows, Path(bench.options.figure))


if __name__ == "__main__":
    run(__doc__, peers, figure="")
