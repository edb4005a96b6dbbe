"""Measure what it costs that a friction law is a plugin: running time, and compiling.

    python benchmarks/plugin_cost.py

The loop with the rolling law as a plugin, and with a Dahl law in a dropped-in file, is timed against kernels written
by hand with the same loop and the law inside; their signals must be equal to the last bit. Then, in fresh processes
with a compiler cache of their own, another law is dropped in: the compiled files of the others must stay as they are,
and their first call must come from the cache. The exit code is 1 if one of it fails.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from accuracy import PLANT, SECTIONS
from numba import njit

from fraexp.components import Controller, FrictionModel
from fraexp.discretisation import discretise
from fraexp.kernels import loop as kernels
from fraexp.kernels.law import specialised
from fraexp.plugins import create, discover

BOUND, REPEATS, SAMPLES = 1.2, 31, 20_000
SAMPLE_TIME, STEPS = 5e-4, 5
DROPPED_IN = '''"""A law in a file of its own."""

import math

from fraexp.api import FrictionModel, param


class Dropped(FrictionModel, name="{name}", version=1):
    """Dahl friction, P. R. Dahl, 1968."""

    states = ("force [N]",)
    stiffness: float = param("N/m", "presliding stiffness", above=0)
    coulomb: float = param("N", "Coulomb friction force", above=0)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, coulomb):
        """Friction force [N]."""
        limit = math.copysign(coulomb, dy)
        z_next[0] = limit + (z[0] - limit) * math.exp(-stiffness * abs(dy) / coulomb)
        return z_next[0]
'''
SPECS = {
    "rolling": {"name": "rolling", "preset": "linear_motor_table"},
    "first": {"name": "first", "stiffness": 3.9e5, "coulomb": 17.9},
    "second": {"name": "second", "stiffness": 3.9e5, "coulomb": 17.9},
}


@njit
def solve_rolling(a, gain, step, z, contact, arguments):  # type: ignore[no-untyped-def]
    """The implicit step with the rolling law written into it."""
    stiffness, _, limit = arguments
    now = int(contact[3])
    old, new = z[now], z[1 - now]
    y, slope = a - gain * (2.0 * contact[0] - contact[4]), 1.0 + gain * contact[2]
    low, high, last, before, force = -np.inf, np.inf, 0.0, 0.0, 0.0
    for count in range(61):
        dy = y - contact[1]
        force = 0.0
        for i in range(stiffness.size):
            new[i] = min(max(old[i] + dy, -limit[i]), limit[i])
            force += stiffness[i] * new[i]
        residual = y - a + gain * force
        if count > 0:
            slope = max((residual - before) / (y - last), 1.0)
        if abs(residual) <= 1e-7 * abs(dy) + 1e-17:
            break
        if residual > 0.0:
            high = y
        else:
            low = y
        trial = y - residual / slope
        if not low < trial < high:
            trial = 0.5 * (low + high)
        if trial == y:
            break
        last, before, y = y, residual, trial
    if y != contact[1]:
        contact[2] = max((force - contact[0]) / (y - contact[1]), 0.0)
    contact[4], contact[0], contact[1], contact[3] = contact[0], force, y, 1 - now
    return force


@njit
def solve_dahl(a, gain, step, z, contact, arguments):  # type: ignore[no-untyped-def]
    """The implicit step with Dahl's law written into it."""
    stiffness, coulomb = arguments
    now = int(contact[3])
    old, new = z[now], z[1 - now]
    y, slope = a - gain * (2.0 * contact[0] - contact[4]), 1.0 + gain * contact[2]
    low, high, last, before, force = -np.inf, np.inf, 0.0, 0.0, 0.0
    for count in range(61):
        dy = y - contact[1]
        limit = np.copysign(coulomb, dy)
        new[0] = limit + (old[0] - limit) * np.exp(-stiffness * abs(dy) / coulomb)
        force = new[0]
        residual = y - a + gain * force
        if count > 0:
            slope = max((residual - before) / (y - last), 1.0)
        if abs(residual) <= 1e-7 * abs(dy) + 1e-17:
            break
        if residual > 0.0:
            high = y
        else:
            low = y
        trial = y - residual / slope
        if not low < trial < high:
            trial = 0.5 * (low + high)
        if trial == y:
            break
        last, before, y = y, residual, trial
    if y != contact[1]:
        contact[2] = max((force - contact[0]) / (y - contact[1]), 0.0)
    contact[4], contact[0], contact[1], contact[3] = contact[0], force, y, 1 - now
    return force


def by_hand(solve: Any) -> Any:
    """Return fraexp's loop around a solver that has its law inside."""

    @njit
    def loop(sample, feedback, state, excitation, reference, noise, channels, arguments):  # type: ignore[no-untyped-def]
        displacement, compliance, measured, transition, step = sample
        numerator, denominator, resolution, limit = feedback
        x, z, w, inputs, outputs, contact = state
        n, m, late = x.size, displacement.shape[0], inputs.size - 1
        known = np.empty(n + 2 + m + 1)
        for k in range(excitation.size):
            position = outputs[outputs.size - 1] + noise[k]
            if resolution > 0.0:
                position = np.round(position / resolution) * resolution
            for i in range(late, 0, -1):
                inputs[i] = inputs[i - 1]
            inputs[0] = kernels.control(numerator, denominator, w, reference[k] - position) + excitation[k]
            channels[0, k], channels[1, k], channels[2, k], channels[3, k] = inputs[0], position, contact[1], contact[0]
            known[:n] = x
            known[n], known[n + 1], known[n + 2] = inputs[late], inputs[late - 1], contact[0]
            for j in range(m):
                a = 0.0
                for i in range(n + 2):
                    a += displacement[j, i] * known[i]
                for i in range(j + 1):
                    a -= compliance[j, i] * known[n + 2 + i]
                known[n + 3 + j] = solve(a, compliance[j, j + 1], step, z, contact, arguments)
            for i in range(outputs.size - 1, 0, -1):
                outputs[i] = outputs[i - 1]
            outputs[0] = 0.0
            x[:] = 0.0
            for j in range(known.size):
                outputs[0] += measured[j] * known[j]
                for i in range(n):
                    x[i] += transition[j, i] * known[j]
            if not abs(outputs[0]) < limit:
                return False
        return True

    return loop


def machine(friction: FrictionModel) -> Any:
    """Return the constants of the paper's machine with this friction, and a function that makes its state at rest."""
    registry = discover()
    controller = create(registry, Controller, SECTIONS["controller"])  # type: ignore[type-abstract]
    return discretise(
        PLANT.state_space(),
        friction,
        controller.transfer_function(SAMPLE_TIME),
        sample_time=SAMPLE_TIME,
        steps=STEPS,
        input_path=(1e-3, ()),
        output_path=(0.0, ()),
        resolution=0.0,
        stroke=1.0,
    )


def runners(friction: FrictionModel, solve: Any) -> list[Callable[[], np.ndarray]]:
    """Return the loop with the law as a plugin and by hand; each call runs it from rest and gives its channels."""
    sample, feedback, at_rest = machine(friction)
    kernel, arguments = by_hand(solve), friction.law_arguments()
    push = 12.0 * np.sin(2 * np.pi * 0.02 * np.arange(SAMPLES))  # 40 Hz
    still = np.zeros(SAMPLES)

    def plugin() -> np.ndarray:
        return kernels.run(friction.law, arguments, sample, feedback, at_rest(), push, still, still)[1]

    def written() -> np.ndarray:
        channels = np.empty((4, SAMPLES))
        kernel(tuple(sample), tuple(feedback), tuple(at_rest()), push, still, still, channels, arguments)
        return channels

    return [plugin, written]


def medians(actions: list[Callable[[], np.ndarray]]) -> list[float]:
    """Return the median times [s] of actions that take turns, so that what disturbs one disturbs the others."""
    times: list[list[float]] = [[] for _ in actions]
    for turn in range(REPEATS):
        order = range(len(actions)) if turn % 2 else reversed(range(len(actions)))
        for i in order:
            began = time.perf_counter()
            actions[i]()
            times[i].append(time.perf_counter() - began)
    return [statistics.median(each) for each in times]


def running_time(title: str, friction: FrictionModel, solve: Any) -> bool:
    """Print the times of both loops; return whether they agree and the plugin is within its bound."""
    actions = runners(friction, solve)
    same = np.array_equal(actions[0](), actions[1]())
    plugin, written = medians(actions)
    steps = SAMPLES * STEPS
    ok = same and plugin <= BOUND * written
    print(
        f"{title:<28s} plugin {plugin / steps * 1e9:6.1f} ns per step, by hand {written / steps * 1e9:6.1f}: "
        f"{plugin / written:.3f} ({BOUND:g}), signals {'equal' if same else 'DIFFERENT'}{'' if ok else '  MISSED'}",
        flush=True,
    )
    return ok


def child(folder: str, names: list[str]) -> None:
    """Call the loop with each named law for the first time in this process, and print what the compiler did."""
    registry, report = discover(Path(folder)), {}
    for name in names:
        friction = create(registry, FrictionModel, SPECS[name])
        sample, feedback, at_rest = machine(friction)
        push = np.ones(10)
        began = time.perf_counter()
        kernels.run(friction.law, friction.law_arguments(), sample, feedback, at_rest(), push, 0 * push, 0 * push)
        taken = time.perf_counter() - began
        stats = specialised(kernels._make_loop, friction.law).stats
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


def compiling(folder: Path) -> bool:
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
    """Print all figures; return 1 if one is missed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "first.py").write_text(DROPPED_IN.format(name="first"), encoding="utf-8")
        registry = discover(folder)
        laws = {key: create(registry, FrictionModel, SPECS[key]) for key in ("rolling", "first")}
        good = [
            running_time("rolling, 20 elements", laws["rolling"], solve_rolling),
            running_time("Dahl, dropped-in file", laws["first"], solve_dahl),
            compiling(folder),
        ]
    print("ok" if all(good) else "MISSED")
    return 0 if all(good) else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2], sys.argv[3:])
    else:
        sys.exit(main())
