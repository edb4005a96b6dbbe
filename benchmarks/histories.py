"""Run seeded histories of schedulers and their store, with faults at every statement; replay one by its seed.

    python benchmarks/histories.py                 100,000 histories on two cores
    python benchmarks/histories.py --quick         2,000
    python benchmarks/histories.py --count 500     any other number
    python benchmarks/histories.py --seed 166      one, with the faults that it suffers

What a history is, and what must hold at its end, is in tests/execution/simulation/history.py. Prints the number of
histories, those that break an invariant with their seeds, and the time; exit code 1 if there are any.
"""

import argparse
import multiprocessing
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.execution.simulation.world import BrokenHistory, World

CHUNK = 500
QUICK_COUNT = 2000
MAX_SHOWN = 10


def broken_in(seeds: range) -> list[BrokenHistory]:
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        return list(World(Path(folder)).broken(seeds))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--quick", action="store_true", help="2,000 histories")
    parser.add_argument("--first", type=int, default=0, help="seed of the first one")
    parser.add_argument("--seed", type=int, help="the only one")
    parser.add_argument("--cores", type=int, default=2)
    arguments = parser.parse_args()
    if arguments.seed is not None:
        chunks = [range(arguments.seed, arguments.seed + 1)]
    else:
        end = arguments.first + (QUICK_COUNT if arguments.quick else arguments.count)
        chunks = [range(start, min(start + CHUNK, end)) for start in range(arguments.first, end, CHUNK)]
    began, found, done = time.monotonic(), 0, 0
    with multiprocessing.Pool(arguments.cores) as pool:
        for seeds, broken in zip(chunks, pool.imap(broken_in, chunks), strict=True):
            done += len(seeds)
            found += len(broken)
            for history in broken[:MAX_SHOWN]:
                print(f"seed {history.seed}: {'; '.join(history.findings)}", *history.log, sep="\n    ", flush=True)
    minutes = (time.monotonic() - began) / 60
    print(f"{done} histories, {found} broken, {minutes:.1f} min on {arguments.cores} cores")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
