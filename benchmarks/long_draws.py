"""Draw what tests draw, as many times as one likes: the same seed makes the same inputs and histories.

    python benchmarks/long_draws.py fuzz --inputs 1000000              hostile inputs for all parsers
    python benchmarks/long_draws.py fuzz --parser record               for those whose name contains a word
    python benchmarks/long_draws.py histories --count 100000           histories of schedulers and their store
    python benchmarks/long_draws.py histories --seed 166 --count 1     one of them, with the faults that it suffers

fuzz       Studies, records, units, filters, settings and databases, bombs that inflate and headers that claim 10 GB. A
           parser may only refuse in one line, within 5 s and 500 MB (`tests/fuzz/watching.py`)
histories  Schedulers and workers on one store, with faults at every statement; what must hold at the end is in
           `tests/execution/simulation/history.py`
"""

import multiprocessing
import os
import sys
import tempfile
import time
from pathlib import Path

from harness import ROOT, Bench, run
from paper_machine import REGISTRY

sys.path.insert(0, str(ROOT))
from tests.execution.simulation.world import BrokenHistory, World
from tests.fuzz import bombs, files, targets
from tests.fuzz.watching import feed, short

CHUNK, MAX_SHOWN = 500, 10


def fuzz(bench: Bench) -> None:
    """Refused and accepted inputs of each parser, findings, and the slowest input."""
    with tempfile.TemporaryDirectory() as folder:
        every = [one for module in (targets, files, bombs) for one in module.targets(Path(folder), REGISTRY)]
        chosen = [one for one in every if bench.options.parser in one.name]
        whole = sum(target.share for target in chosen)
        for target in chosen:
            began = time.monotonic()
            tally = feed(target, bench.seed, max(round(bench.options.inputs * target.share / whole), 1))
            text = f"{tally.refused:9,} refused {tally.accepted:9,} accepted {len(tally.findings):6} findings"
            text += f" in {time.monotonic() - began:.1f} s, slowest {tally.slowest:.2f} s"
            bench.row(target.name, text, not tally.findings)
            for finding, made in tally.findings.items():
                print(f"  {finding}\n    {short(made)}", flush=True)


def broken_in(seeds: range) -> list[BrokenHistory]:
    """Return the histories that break an invariant."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        return list(World(Path(folder)).broken(seeds))


def histories(bench: Bench) -> None:
    """Histories that break an invariant."""
    end = bench.seed + bench.options.count
    chunks = [range(start, min(start + CHUNK, end)) for start in range(bench.seed, end, CHUNK)]
    found = 0
    with multiprocessing.Pool(os.cpu_count()) as pool:
        for broken in pool.imap(broken_in, chunks):
            found += len(broken)
            for history in broken[:MAX_SHOWN]:
                print(f"seed {history.seed}: {'; '.join(history.findings)}", *history.log, sep="\n    ", flush=True)
    bench.bounded(f"of {bench.options.count} histories broken", found, 0)


if __name__ == "__main__":
    run(__doc__, fuzz, histories, inputs=(20_000, 2_000), count=(100_000, 500), parser="")
