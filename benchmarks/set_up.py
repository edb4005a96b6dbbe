"""Measure what `make run` installs, as a share of what all packages with the tools of development take.

    python benchmarks/set_up.py

It sums the packages of this environment that each lock names: their files, and the bytecode that pip writes by
default; `make run` switches that off. The bound is given in brackets, and the exit code is 1 if it is missed.
"""

import argparse
import re
import sys
from importlib.metadata import distribution
from importlib.util import cache_from_source
from pathlib import Path

ROOT = Path(__file__).parents[1]
BOUND = 0.6
MEGABYTE = 1e6


def names_in(lock: Path) -> set[str]:
    """Return the packages that a lock names."""
    return set(re.findall(r"^([\w.-]+)==", lock.read_text("utf-8"), re.MULTILINE))


def sizes(name: str) -> tuple[int, int]:
    """Return the bytes of an installed package: its files, and their bytecode."""
    try:
        files = [Path(str(file.locate())) for file in distribution(name).files or []]
    except ModuleNotFoundError:  # of another platform
        return 0, 0
    sources = [file for file in files if file.suffix != ".pyc"]
    compiled = [Path(cache_from_source(file)) for file in sources if file.suffix == ".py"]
    return _total(sources), _total(compiled)


def _total(files: list[Path]) -> int:
    return sum(file.stat().st_size for file in files if file.is_file())


def main() -> int:
    """Print the table; return 1 if the bound is missed."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_known_args()
    totals = {}
    print(f"{'packages of':<28s}{'number':>8s}{'files [MB]':>12s}{'bytecode [MB]':>15s}")
    for lock in ("requirements-dev.lock", "requirements.lock"):
        found = [sizes(name) for name in names_in(ROOT / lock)]
        totals[lock] = [sum(column) for column in zip(*found, strict=True)]
        files, bytecode = (total / MEGABYTE for total in totals[lock])
        print(f"{lock:<28s}{sum(files > 0 for files, _ in found):>8d}{files:>12.1f}{bytecode:>15.1f}")
    share = totals["requirements.lock"][0] / sum(totals["requirements-dev.lock"])
    missed = share > BOUND
    print(f"files to run over all files with bytecode: {share:.3f} ({BOUND:g}){' MISSED' if missed else ''}")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
