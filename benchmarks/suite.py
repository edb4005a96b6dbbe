"""Measure the test suite: how much of the code it runs, and whether it passes again and again beside other work.

    python benchmarks/suite.py coverage             `make test` and `make test-all`, about an hour: tracing is slow
    python benchmarks/suite.py coverage --reduced   `make test` alone
    python benchmarks/suite.py endurance            `make test` 10 times, and 3 times with every core kept busy
    python benchmarks/suite.py endurance --target test-all --quiet 0 --load 1

coverage   Lines and branches of fraexp and fraexp_plugins, in all processes that the tests start. What is compiled is
           traced nowhere: the laws' own tests run them in plain Python as well. `make test` must cover 90 % of what the
           whole suite does
endurance  How often a target passes, and how long it takes

`benchmarks/suite_defects.py` counts the seeded defects that the suite finds.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from harness import ROOT, Bench, run

MIN_RATIO = 0.9
TEST = ["-n", "auto", "--dist", "worksteal"]
TEST_ALL = [*TEST, "-m", "", "--hypothesis-profile", "thorough"]


def coverage(bench: Bench) -> None:
    """Lines and branches [%]."""
    found = [_covered(bench, "make test", TEST)]
    if not bench.reduced:
        found.append(_covered(bench, "make test-all", TEST_ALL))
        ratio = min(test / whole for test, whole in zip(*found, strict=True))
        bench.row("make test over make test-all", f"{ratio:.3f} (at least {MIN_RATIO})", ratio >= MIN_RATIO)


def _covered(bench: Bench, name: str, options: list[str]) -> tuple[float, float]:
    """Run a suite; return the fractions of lines and branches that it covers."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.monotonic()
        code = _coverage(folder, "run", "-m", "pytest", *options)
        minutes = (time.monotonic() - began) / 60
        _coverage(folder, "combine", "--quiet")
        _coverage(folder, "json", "--quiet", "-o", str(Path(folder) / "report.json"))
        totals = json.loads((Path(folder) / "report.json").read_text("utf-8"))["totals"]
    lines = totals["covered_lines"] / totals["num_statements"]
    branches = totals["covered_branches"] / totals["num_branches"]
    text = f"lines {100 * lines:6.2f}  branches {100 * branches:6.2f}  in {minutes:.1f} min"
    bench.row(name, text, code == 0, lines=lines, branches=branches)
    return lines, branches


def _coverage(folder: str, *arguments: str) -> int:
    """Run coverage with its data in a folder, and return its exit code."""
    environment = {**os.environ, "COVERAGE_FILE": str(Path(folder) / "data")}
    command = [sys.executable, "-m", "coverage", *arguments]
    return subprocess.run(command, cwd=ROOT, env=environment, stdout=sys.stderr, check=False).returncode


def endurance(bench: Bench) -> None:
    """How often a target passes, on the machine as it is and beside other work."""
    busy = os.cpu_count() or 1
    for name, times, processes in (("quiet", bench.options.quiet, 0), ("load", bench.options.load, busy)):
        minutes, failed = [], 0
        for _ in range(times):
            with ExitStack() as stack:
                for _ in range(processes):
                    process = stack.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
                    stack.callback(process.kill)
                began = time.monotonic()
                command = ["make", "--silent", bench.options.target]
                done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
            minutes.append((time.monotonic() - began) / 60)
            failed += done.returncode != 0
            print(f"  {minutes[-1]:.1f} min{': ' + done.stdout + done.stderr if done.returncode else ''}", flush=True)
        if minutes:
            text = f"{times - failed} of {times} passed, median {statistics.median(minutes):.1f} min"
            bench.row(f"make {bench.options.target}, {name}", f"{text}, longest {max(minutes):.1f} min", failed == 0)


if __name__ == "__main__":
    run(__doc__, coverage, endurance, quiet=(10, 1), load=(3, 0), target="test")
