"""Hostile inputs for all parsers: studies, records, units, filters, settings, and databases to read and to merge.

Among the files are bombs that inflate, and headers that claim 10 GB and more.

python benchmarks/fuzz.py --inputs 1000000 --seed 1 prints a line for each parser, and fails where one of them raises
anything but a refusal in one line, takes more than 5 s for an input, or grows by more than 500 MB. `--parser` names
one of them. The same seed makes the same inputs.
"""

import argparse
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

from fraexp.components.registry import discover
from tests.fuzz import bombs, files, targets
from tests.fuzz.watching import Target, feed, short


def main() -> int:
    """Feed all parsers, and return 1 if there is a finding."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000, help="in total")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--parser", default="", help="part of the name of the parsers that are fed")
    parser.add_argument("--without", default="", help="part of the name of those that are not")
    given = parser.parse_args()
    with TemporaryDirectory() as folder:
        registry = discover()
        every = [one for module in (targets, files, bombs) for one in module.targets(Path(folder), registry)]
        return _feed(
            [one for one in every if given.parser in one.name and not (given.without and given.without in one.name)],
            given.inputs,
            given.seed,
        )


def _feed(chosen: list[Target], inputs: int, seed: int) -> int:
    whole = sum(target.share for target in chosen)
    total = refused = findings = 0
    print(f"{'parser':22} {'inputs':>9} {'refused':>9} {'accepted':>9} {'findings':>8} {'time [s]':>9} {'slowest':>8}")
    for target in chosen:
        started = time.monotonic()
        tally = feed(target, seed, max(round(inputs * target.share / whole), 1))
        took = time.monotonic() - started
        numbers = f"{tally.inputs:9,} {tally.refused:9,} {tally.accepted:9,} {len(tally.findings):8}"
        print(f"{target.name:22} {numbers} {took:9.1f} {tally.slowest:8.2f}", flush=True)
        for finding, made in tally.findings.items():
            print(f"  {finding}\n    {short(made)}", flush=True)
        total, refused, findings = total + tally.inputs, refused + tally.refused, findings + len(tally.findings)
    print(f"{total:,} inputs with seed {seed}: {refused:,} refused in one line, {findings} findings")
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
