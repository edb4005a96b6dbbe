"""Cost of the digests: storing and reading with and without them, side by side in one run.

python benchmarks/digests.py [--pairs 100] alternates between the store as it is and the store with digests that are not
computed (all are the same number, so that all comparisons are still made). It prints the processor time of each and
the share of the digests, and fails above BOUND: for a result as a run stores it, and for a sweep as it is shown. A busy
machine only adds time: the times are those that a tenth of the repetitions fall below.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from store import crossed, response

from fraexp.data.results import Curve, Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import Store, digests, shared_sections
from fraexp.store.queries import reading

BOUND = 0.02
FAST_SHARE = 0.1
SWEEPS = 200
POINTS, SAMPLES = 100, 500
BOUNDED = ("store one result", "show one sweep")


def main() -> int:
    """Print the table, and return whether a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=100)
    given = parser.parse_args()
    grid = list(crossed(SWEEPS))
    values = np.random.default_rng(1).normal(size=(2, SAMPLES))
    loop = Curve("hysteresis", dict(zip(("displacement", "force"), values, strict=True)), {"force": "N"})
    metrics = tuple(Metric(name, 1.25, "m") for name in ("stroke", "peak force", "measuring time"))
    result = Result(Outcome.OK, "", response(POINTS), metrics, (loop,), elapsed=0.25)
    print(f"{POINTS} frequencies, a curve of {SAMPLES} samples, {SWEEPS} sweeps in a run; ms of the processor")
    print(f"{'':28} {'without':>9} {'with':>9} {'digests':>9}")
    missed = False
    with (
        tempfile.TemporaryDirectory() as folder,
        Store.open(f"{folder}/plain.db", create=True) as plain,
        Store.open(f"{folder}/sealed.db", create=True) as sealed,
    ):
        for name, action in actions(grid, result).items():
            missed |= compare(name, action, (plain, sealed), given.pairs)
    return int(missed)


def actions(grid: list[Sweep], result: Result) -> dict[str, Callable[[Store], object]]:
    """Return what is measured, by name; the first action makes what the others read."""
    keys = [item.key for item in grid]
    return {
        "begin a run": lambda store: store.begin_run("a", "a.toml", "fraexp run", {}, grid),
        "store all results": lambda store: store.save(1, [(item, result, {}) for item in grid]),
        "store one result": lambda store: store.save(1, [(grid[0], result, {})]),
        "show one sweep": lambda store: (store.find(keys[5]), store.results([keys[5]])),
        "read all results": lambda store: store.results(keys),
        "list 100 sweeps": lambda store: store.page(),
        "sweeps of a run": lambda store: store.sweeps(1),
    }


@contextmanager
def no_digests() -> Iterator[None]:
    """Let every digest be 0 without looking at the values."""

    def nothing(*_: object) -> int:
        return 0

    names = ("listed_digest", "content_digest", "result_digest", "origins_digest", "run_digest", "run_sweep_digest")
    with mock.patch.multiple(digests, **dict.fromkeys((*names, "digest"), nothing)):  # type: ignore[arg-type]
        shared = {name: nothing for name in (*names, "digest") if hasattr(reading, name)}
        with (
            mock.patch.multiple(reading, **shared),  # type: ignore[arg-type]
            mock.patch.object(shared_sections, "parts_digest", nothing),
        ):
            yield


def compare(name: str, action: Callable[[Store], object], stores: tuple[Store, Store], pairs: int) -> bool:
    """Print the time of an action with and without digests; return whether a bound is missed."""
    plain, sealed = [], []
    for _ in range(pairs if name != "begin a run" else 5):
        with no_digests():
            plain.append(_time(action, stores[0]))
        sealed.append(_time(action, stores[1]))
    before, after = float(np.quantile(plain, FAST_SHARE)), float(np.quantile(sealed, FAST_SHARE))
    share = after / before - 1
    missed = name in BOUNDED and share > BOUND
    print(
        f"{name:28} {1e3 * before:9.2f} {1e3 * after:9.2f} {100 * share:8.1f}%{'  missed' if missed else ''}",
        flush=True,
    )
    return missed


def _time(action: Callable[[Store], object], store: Store) -> float:
    began = time.process_time()
    action(store)
    return time.process_time() - began


if __name__ == "__main__":
    sys.exit(main())
