"""Check that adding a friction model compiles that model alone; what its law costs is in kernel.py.

    python benchmarks/plugin_cost.py

In fresh processes with a compiler cache of their own, a law is dropped in beside another: the compiled files of the
others must stay as they are, and afterwards the first call of each must come from the cache. The exit code is 1 if not.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from loops import Loops

DROPPED_IN = '''"""A law in a file of its own."""

from fraexp.api import FrictionModel, param


class Dropped(FrictionModel, name="{name}", version=1):
    """A spring that slips."""

    states = ("deflection [m]",)
    stiffness: float = param("N/m", "presliding stiffness", above=0)
    limit: float = param("m", "deflection at which it slips", above=0)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        """Friction force [N]."""
        z_next[0] = min(max(z[0] + dy, -limit), limit)
        return stiffness * z_next[0]
'''
SPRING = {"stiffness": 3.9e5, "limit": 45e-6}
SPECS = {
    "rolling": {"name": "rolling", "preset": "linear_motor_table"},
    "first": {"name": "first", **SPRING},
    "second": {"name": "second", **SPRING},
}


def child(folder: str, names: list[str]) -> None:
    """Call the loop with each named law for the first time in this process, and print what the compiler did."""
    from kernel import model, setup_of

    from fraexp.kernels.experiments import _make_advance
    from fraexp.kernels.law import specialised
    from fraexp.plugins import discover

    registry, report = discover(Path(folder)), {}
    for name in names:
        friction = model(SPECS[name], registry)
        loops = Loops.of(setup_of(friction, 2, wide=True), 1)
        began = time.perf_counter()
        loops.run()
        taken = time.perf_counter() - began
        stats = specialised(_make_advance, friction.law, friction.law).stats
        report[name] = (taken, sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
    print(json.dumps(report))


def in_fresh_process(folder: Path, *names: str) -> dict[str, tuple[float, int, int]]:
    """Return time of the first call [s], cache hits and cache misses of each law in a process of its own."""
    command = [sys.executable, __file__, "--child", str(folder), *names]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache")}
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    report: dict[str, tuple[float, int, int]] = json.loads(done.stdout)
    return report


def compiled_files(folder: Path) -> dict[str, tuple[bytes, int]]:
    """Return the content and time of change of all compiled files."""
    files = sorted((folder / "cache").rglob("*.nbc"))
    return {str(file): (file.read_bytes(), file.stat().st_mtime_ns) for file in files}


def alone(folder: Path) -> bool:
    """Drop in a second law; return whether the files of the others stay and their first call is a cache hit."""
    (folder / "first.py").write_text(DROPPED_IN.format(name="first"), encoding="utf-8")
    cold = in_fresh_process(folder, "rolling", "first")
    before = compiled_files(folder)
    (folder / "second.py").write_text(DROPPED_IN.format(name="second"), encoding="utf-8")
    added = in_fresh_process(folder, "second")
    after = compiled_files(folder)
    warm = in_fresh_process(folder, "rolling", "first", "second")
    for title, report in (("empty cache", cold), ("law added", added), ("afterwards", warm)):
        for name, (taken, hits, misses) in report.items():
            print(f"{title:<12s} first call with {name:<8s} {taken:6.3f} s, {hits} cache hits, {misses} misses")
    untouched = all(after.get(file) == content for file, content in before.items())
    print(f"{len(before)} compiled files before, {len(after)} after; the former {'un' if untouched else ''}changed")
    return untouched and len(after) > len(before) and all(hits == 1 and not misses for _, hits, misses in warm.values())


def main() -> int:
    """Print what was compiled when; return 1 if more than the added law."""
    with tempfile.TemporaryDirectory() as name:
        good = alone(Path(name))
    print("ok" if good else "MISSED")
    return 0 if good else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2], sys.argv[3:])
    else:
        sys.exit(main())
