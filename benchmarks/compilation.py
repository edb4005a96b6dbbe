"""Measure the time to compile friction laws: in an empty cache, each further law, all built-in laws, after an edit.

    python benchmarks/compilation.py            all built-in laws, about two minutes
    python benchmarks/compilation.py --reduced  three of them

Times are processor seconds of fresh processes with a cache folder of their own, imports included; the bounds are given
in brackets. It also checks that adding or editing a local law compiles no other law. The exit code is 1 if not.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

FIRST_S, FURTHER_S, EDIT_S, ALL_S = 10.0, 5.0, 6.0, 60.0
"""Bounds: first law in an empty cache, each further one, a rerun after an edit, all built-in laws together [s]."""
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
        return {factor} * stiffness * z_next[0]
'''
OTHERS = {"none": {}, "composite": {"preset": "dahl_and_viscous"}}
"""Built-in laws that benchmarks/friction.py does not compare."""
STUDY = """
machine = "linear_motor_table"
friction = {{ name = "{name}", stiffness = 3.9e5, limit = 45e-6 }}
excitation = {{ name = "stepped_sine", amplitude = 12.0, points = 4 }}
grid = {{ estimator = [{{ name = "conventional" }}, {{ name = "effective_input" }}] }}
"""


def child(names: list[str]) -> None:
    """Use each law in the loop and in the observer for the first time in this process; print the processor time."""
    from friction import MODELS
    from kernel import machine, model, rolling, sweep

    from fraexp.components.kinds import Motion
    from fraexp.simulation.loop import simulate_loop

    report = {"imports": time.process_time()}
    for name in names:
        began = time.process_time()
        friction = rolling(20) if name == "rolling" else model({"name": name, **{**MODELS, **OTHERS}[name]})
        signals = simulate_loop(machine(friction, 0), sweep(4, lowest=20.0), lambda _: None)
        displacement = signals.segments[0].channels["displacement"][0]
        friction.forces([Motion(displacement, 5e-4, periodic=True)] * 2)
        report[name] = time.process_time() - began
    print(json.dumps(report))


def in_fresh_process(folder: Path, *names: str) -> dict[str, float]:
    """Return the processor time of each law's first use, and of the imports before [s]."""
    done = subprocess.run(
        [sys.executable, __file__, "--child", *names],
        env=environment(folder),
        check=True,
        capture_output=True,
        text=True,
    )
    report: dict[str, float] = json.loads(done.stdout)
    return report


def environment(folder: Path) -> dict[str, str]:
    """Return an environment with a cache folder of its own."""
    return {**os.environ, "FRAEXP_CACHE_DIR": str(folder / "cache")}


def kernels(folder: Path) -> dict[str, int]:
    """Return when each compiled kernel was written."""
    return {str(file): file.stat().st_mtime_ns for file in (folder / "cache").rglob("*.kernel")}


def row(what: str, seconds: float, bound: float | None = None) -> bool:
    """Print a time [s] with its bound; return whether the bound is missed."""
    missed = bound is not None and seconds > bound
    print(
        f"{what:<60s}{seconds:7.2f} s" + (f" ({bound:g})" if bound else "") + ("  MISSED" if missed else ""), flush=True
    )
    return missed


def laws(names: list[str]) -> int:
    """Compile each law in a process of its own, all with one cache; return how many bounds are missed."""
    missed, total = 0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        for number, name in enumerate(names):
            report = in_fresh_process(Path(folder), name)
            first = number == 0
            taken = report[name] + (report["imports"] if first else 0.0)
            total += taken
            text = f"{name}: first use in an empty cache, with imports" if first else f"{name}: further law"
            missed += row(text, taken, FIRST_S if first else FURTHER_S)
        missed += row(f"{len(names)} laws together", total, ALL_S)
        warm = in_fresh_process(Path(folder), *names)
        row("all of them again, from the cache", sum(warm.values()) - warm["imports"])
    return missed


def edit() -> int:
    """Run a study with a local law, edit the law, run again; return how many bounds are missed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("plugins", "studies"):
            (folder / part).mkdir()
        law = folder / "plugins" / "dropped.py"
        law.write_text(DROPPED_IN.format(name="dropped", factor="1.0"), encoding="utf-8")
        (folder / "studies" / "edited.toml").write_text(STUDY.format(name="dropped"), encoding="utf-8")
        first = run_study(folder, "edited")
        before = kernels(folder)
        law.write_text(DROPPED_IN.format(name="dropped", factor="0.9"), encoding="utf-8")
        again = run_study(folder, "edited", "--rerun", "stale")
        after = kernels(folder)
        row("a study with a local law in an empty cache", first)
        missed = row("the same after an edit of the law", again, EDIT_S)
        untouched = all(after.get(file) == moment for file, moment in before.items())
        print(
            f"{len(before)} kernels before the edit, {len(after)} after; the former {'un' if untouched else ''}changed"
        )
        return missed + (not untouched or len(after) <= len(before))


def run_study(folder: Path, *arguments: str) -> float:
    """Return the time that a run takes in a fresh process [s]: its processor time, which other work leaves alone."""
    before = os.times()
    command = [sys.executable, "-m", "fraexp", "run", "--executor", "serial", *arguments]
    subprocess.run(command, cwd=folder, env=environment(folder), check=True, capture_output=True)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def main() -> int:
    """Print all times; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--reduced", action="store_true", help="fewer laws")
    reduced = options.parse_args().reduced
    from friction import MODELS

    names = ["rolling", "gms", "lugre"] if reduced else [*MODELS, *OTHERS]
    missed = laws(names) + edit()
    print(f"{missed} missed")
    return min(missed, 1)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2:])
    else:
        sys.exit(main())
