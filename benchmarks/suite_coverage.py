"""Measure how much of the code `make test` runs, and how much the whole suite, `make test-all`, does.

    python benchmarks/suite_coverage.py           both, about an hour: tracing is slow
    python benchmarks/suite_coverage.py --quick   `make test` alone

Lines and branches are those of the packages fraexp and fraexp_plugins, in all processes that the tests start. What is
compiled is traced nowhere: the laws' own tests run them in plain Python as well. Exit code 1 if a suite fails, or if
`make test` covers less than 90 % of what the whole suite does.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
LEAST_RATIO = 0.9
TEST = ["-n", "auto", "--dist", "worksteal"]
TEST_ALL = [*TEST, "-m", "", "--hypothesis-profile", "thorough"]


@dataclass(frozen=True)
class Coverage:
    """Fractions of lines and branches that are covered."""

    lines: float
    branches: float


def main() -> int:
    """Print a table, and return 1 if a suite fails or covers too little."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="make test alone")
    quick = parser.parse_args().quick
    print(f"{'suite':16} {'lines [%]':>10} {'branches [%]':>13} {'time [min]':>11}")
    passed, test = measure("make test", TEST)
    if quick:
        return int(not passed)
    all_passed, whole = measure("make test-all", TEST_ALL)
    lines, branches = test.lines / whole.lines, test.branches / whole.branches
    print(f"{'ratio':16} {lines:10.3f} {branches:13.3f}   at least {LEAST_RATIO}")
    return int(not (passed and all_passed and min(lines, branches) >= LEAST_RATIO))


def measure(name: str, options: list[str]) -> tuple[bool, Coverage]:
    """Run a suite, print its row, and return whether it has passed and what it covers."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.monotonic()
        code = run(folder, "run", "-m", "pytest", *options)
        minutes = (time.monotonic() - began) / 60
        run(folder, "combine", "--quiet")
        run(folder, "json", "--quiet", "-o", str(Path(folder) / "report.json"))
        found = read(Path(folder) / "report.json")
    print(f"{name:16} {100 * found.lines:10.2f} {100 * found.branches:13.2f} {minutes:11.1f}", flush=True)
    return code == 0, found


def run(folder: str, *arguments: str) -> int:
    """Run coverage with its data in a folder, and return its exit code."""
    environment = {**os.environ, "COVERAGE_FILE": str(Path(folder) / "data")}
    return subprocess.run(
        [sys.executable, "-m", "coverage", *arguments], cwd=ROOT, env=environment, stdout=sys.stderr, check=False
    ).returncode


def read(report: Path) -> Coverage:
    """Return the fractions in a report."""
    totals = json.loads(report.read_text("utf-8"))["totals"]
    return Coverage(
        totals["covered_lines"] / totals["num_statements"], totals["covered_branches"] / totals["num_branches"]
    )


if __name__ == "__main__":
    sys.exit(main())
