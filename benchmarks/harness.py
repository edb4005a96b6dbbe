"""What all benchmarks share: a command line, draws from a seed, turns, bounds, and a table that is printed as it grows.

A benchmark is a module of parts, which are functions of a `Bench`, and ends with ``run(__doc__, part, …)``. Its command
takes the names of parts (all by default) and

    --reduced         smaller sizes, for a quick look
    --seed N          the draws of an earlier run; by default a fresh seed, which is printed
    --json FILE       also write all rows to a file
    --against COMMIT  compare the work that the benchmark names with that of a commit, in turns
"""

import argparse
import json
import os
import secrets
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
Action = Callable[[], object]
Part = Callable[["Bench"], None]
CONFIDENCE_STDS = 3.0
"""Binomial standard deviations by which a counted share may miss its bound by chance."""
WORKER = """
import sys, time
tree, benchmarks, module, name = sys.argv[1:]
sys.path[:0] = [tree, tree + "/plugins", benchmarks]
import fraexp
from importlib import import_module
assert fraexp.__file__.startswith(tree), fraexp.__file__
action = import_module(module).WORKS[name]()
for line in sys.stdin:
    began = time.process_time()
    action()
    print(time.process_time() - began, flush=True)
"""
"""Does a work of a benchmark with the fraexp of a tree, once for each line, and prints its processor time."""


class Bench:
    """The options of a run, its seed, and the rows that it has printed."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.reduced: bool = options.reduced
        self.rows: list[dict[str, Any]] = []

    @cached_property
    def seed(self) -> int:
        """The seed of all draws, printed when it is first used."""
        seed = secrets.randbelow(1_000_000) if self.options.seed is None else self.options.seed
        print(f"seed {seed}", flush=True)
        return int(seed)

    def generator(self, *key: int) -> np.random.Generator:
        """Return a random generator of its own for each key."""
        return np.random.default_rng([self.seed, *key])

    def row(self, what: str, text: str, is_met: bool = True, **figures: float) -> None:
        """Print a row, whose figures also go to the JSON file, and count it if it misses its bound."""
        self.rows.append({"what": what, "text": text, "is_met": bool(is_met), **figures})
        print(f"{what:<64s} {text}{'' if is_met else '  MISSED'}", flush=True)

    def bounded(self, what: str, value: float, bound: float, unit: str = "", shortfall: str = "") -> None:
        """Print a value with the bound that it must not exceed; a shortfall says why it cannot be met."""
        is_within = value <= bound
        text = f"{value:10.4g} {unit:<5s} (at most {bound:g}){'' if is_within else f'  {shortfall}'}"
        self.row(what, text, is_within or bool(shortfall), value=float(value), bound=float(bound))

    def share(self, what: str, share: float, count: int, target: float = 0.95, tolerance: float = 0.02) -> None:
        """Print a counted share that must be within a tolerance of a target, but for the scatter of the count."""
        slack = tolerance + chance(target, count)
        text = f"{100 * share:6.1f} % of {count} ({100 * target:g} ± {100 * slack:.1f})"
        self.row(what, text, abs(share - target) <= slack, share=float(share), count=count)

    @property
    def missed(self) -> int:
        """Number of rows that miss their bound."""
        return sum(not row["is_met"] for row in self.rows)


def chance(share: float, count: int) -> float:
    """Return by how much a share that is counted so often is off by chance."""
    return CONFIDENCE_STDS * float(np.sqrt(share * (1 - share) / count))


def in_turns(*actions: Action, turns: int, clock: Callable[[], float] = time.perf_counter) -> np.ndarray:
    """Return the times [s] of actions, shape (actions, turns).

    They take turns in alternating order, so that what disturbs one disturbs the others. A first turn is not counted.
    """
    times = np.empty((len(actions), turns + 1))
    for turn in range(turns + 1):
        order = range(len(actions)) if turn % 2 else reversed(range(len(actions)))
        for place in order:
            began = clock()
            actions[place]()
            times[place, turn] = clock() - began
    return times[:, 1:]


def run(doc: str, *parts: Part, works: Mapping[str, Callable[[], Action]] | None = None, **options: Any) -> NoReturn:
    """Run the parts that the command line names, print how many bounds are missed, and exit with 1 if there are any.

    Args:
        doc: the benchmark's docstring, which is its help
        parts: by default all of them are run
        works: what `--against` compares, by name: each makes an action, ready to be timed
        options: defaults of further options; a pair is a default and the one of `--reduced`, a list takes words, and
            False is a flag
    """
    known = {part.__name__.replace("_", "-"): part for part in parts}
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if len(known) > 1:
        parser.add_argument("parts", nargs="*", metavar="PART", help=f"any of {', '.join(known)}")
    parser.add_argument("--reduced", "--quick", action="store_true", help="smaller sizes")
    parser.add_argument("--seed", type=int, help="seed of the draws")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write all rows to this file")
    for name, default in options.items():
        _add_option(parser, name, default)
    if works:
        parser.add_argument("--against", metavar="COMMIT", help="compare with a commit, in turns")
        parser.add_argument("--against-turns", type=int, default=20)
    given = parser.parse_args()
    chosen = getattr(given, "parts", None) or list(known)
    if unknown := [name for name in chosen if name not in known]:
        parser.error(f"no part {unknown[0]!r}; known: {', '.join(known)}")
    for name, default in options.items():
        if isinstance(default, tuple) and getattr(given, name) is None:
            setattr(given, name, default[given.reduced])
    bench = Bench(given)
    if works and given.against:
        compare_with_commit(bench, Path(sys.argv[0]).stem, works)
    else:
        for name in chosen:
            if len(known) > 1:
                print(f"\n{name}: {(known[name].__doc__ or '').partition(chr(10))[0]}", flush=True)
            known[name](bench)
    if given.json:
        given.json.write_text(json.dumps(bench.rows, indent=1) + "\n", encoding="utf-8")
    print(f"{bench.missed} missed")
    raise SystemExit(min(bench.missed, 1))


def _add_option(parser: argparse.ArgumentParser, name: str, default: Any) -> None:
    flag = f"--{name.replace('_', '-')}"
    if isinstance(default, bool):
        parser.add_argument(flag, action="store_true")
    elif isinstance(default, tuple):
        parser.add_argument(flag, type=type(default[0]), help=f"{default[0]}, or {default[1]} with --reduced")
    elif isinstance(default, list):
        parser.add_argument(flag, nargs="+", default=default)
    else:
        parser.add_argument(flag, type=type(default), default=default, help=f"default {default!r}")


def compare_with_commit(bench: Bench, module: str, works: Mapping[str, Callable[[], Action]]) -> None:
    """Print the processor time of each work over that with the fraexp of a commit: the median of their turns."""
    with checked_out(bench.options.against) as former:
        for name in works:
            processes = [_start_worker(tree, module, name) for tree in (former, ROOT)]
            before, now = in_turns_of(processes, bench.options.against_turns)
            for process in processes:
                process.communicate()
            ratio = statistics.median(now / before)
            text = f"{1e3 * np.median(now):8.1f} ms over {1e3 * np.median(before):8.1f}: {ratio:.2f} times"
            bench.row(name, text, seconds=float(np.median(now)), ratio=ratio)


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """Check a commit out into a temporary worktree, and yield its folder."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git = ["git", "-C", str(ROOT), "worktree"]
        done = subprocess.run([*git, "add", "--quiet", "--detach", str(tree), commit], check=False)
        if done.returncode:
            raise SystemExit(f"--against {commit}: cannot be checked out; name a commit of this repository")
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=False)


def _start_worker(tree: Path, module: str, name: str) -> "subprocess.Popen[str]":
    """Return a process that does a work with the fraexp of a tree, whose compiled laws a former tree does not share."""
    own = {} if tree == ROOT else {"FRAEXP_CACHE_DIR": str(tree / "cache")}
    command = [sys.executable, "-c", WORKER, str(tree), str(ROOT / "benchmarks"), module, name]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    return subprocess.Popen(command, cwd=tree, env={**os.environ, **own}, text=True, **pipes)  # type: ignore[call-overload, no-any-return]


def in_turns_of(processes: list["subprocess.Popen[str]"], turns: int) -> np.ndarray:
    """Return the processor times [s] of workers that take turns, shape (workers, turns); a first turn compiles."""
    times = np.empty((len(processes), turns + 1))
    for turn in range(turns + 1):
        for place, process in enumerate(processes):
            assert process.stdin
            assert process.stdout
            process.stdin.write("\n")
            process.stdin.flush()
            answer = process.stdout.readline()
            if not answer:
                raise SystemExit("a version ended before it answered; its error is above")
            times[place, turn] = float(answer)
    return times[:, 1:]
