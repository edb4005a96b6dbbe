"""Measure the kernel of the loop: against the same algorithm by hand in C, law by law, and its accuracy over its cost.

    python benchmarks/kernel.py            some minutes
    python benchmarks/kernel.py --reduced  fewer sizes and laws, half a minute
    python benchmarks/kernel.py --json F   writes all figures to the file F as well

Each comparison runs in one process on one thread; what is compared takes turns, and a ratio is the median of those of
each turn. Both sides get the same constants, and their channels must agree to 1e-9. In lanes the sizes of one machine
are compiled into the C program. The exit code is 1 if a bound, given in brackets, is missed.
"""

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import twins
from accuracy import PLANT, REGISTRY, SECTIONS
from friction import MODELS
from loops import Loops

from fraexp.components.kinds import Controller, Excitation, FrictionModel
from fraexp.components.registry import create, discover
from fraexp.errors import FraexpError
from fraexp.simulation.experiments import Setup
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.loop_setup import prepare_setup
from fraexp.simulation.machine import ControlLoop, Machine, Numerics

LANES, SCALAR, DROPPED = 1.15, 1.2, 1.2
"""Bounds of time: lanes and scalar over C, a local law over the same one built in."""
AGREEMENT = 1e-9
TURNS, LEAST, PLACES = 20, 0.02, 5
"""Turns of a comparison, the least time of each [s], and fresh places in memory, on which times depend by a tenth."""
REFERENCE = 40
"""Steps per sample that accuracy is measured against."""
DROP_IN = '''"""Laws in a file of their own."""

import math

from fraexp.api import FrictionModel, param


class Sliders(FrictionModel, name="dropped_rolling", version=1):
    """The rolling law without damped elements."""

    stiffness: tuple[float, ...] = param("N/m", "stiffness of the elements")
    limit: tuple[float, ...] = param("m", "deflections at which they slip")

    @property
    def state_size(self):
        """Deflections [m]."""
        return len(self.stiffness)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        """Friction force [N]."""
        force = 0.0
        for i in range(stiffness.size):
            z_next[i] = min(max(z[i] + dy, -limit[i]), limit[i])
            force += stiffness[i] * z_next[i]
        return force


class Dahl(FrictionModel, name="dropped_dahl", version=1):
    """Dahl's law."""

    states = ("force [N]",)
    stiffness: float = param("N/m", "presliding stiffness", above=0)
    coulomb_force: float = param("N", "Coulomb friction force", above=0)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, coulomb_force):
        """Friction force [N]."""
        limit = math.copysign(coulomb_force, dy)
        z_next[0] = limit + (z[0] - limit) * math.exp(-stiffness * abs(dy) / coulomb_force)
        return z_next[0]
'''


@dataclass
class Figures:
    """Prints rows, keeps their numbers, and counts the bounds that are missed."""

    found: dict[str, dict[str, float]] = field(default_factory=dict)
    missed: int = 0
    slack: float = 1.0
    """Factor on the bounds."""

    def row(self, what: str, text: str, numbers: dict[str, float], *bounded: tuple[float, float]) -> None:
        """Print a row; `bounded` are numbers with their bounds."""
        missed = [value for value, bound in bounded if not value <= bound * self.slack]
        self.found[what], self.missed = numbers, self.missed + len(missed)
        print(f"{what:<44s} {text}{'  MISSED' if missed else ''}", flush=True)


def model(spec: dict[str, Any], registry: Any = REGISTRY) -> FrictionModel:
    """Return a friction model."""
    return create(registry, FrictionModel, spec)


def rolling(elements: int) -> FrictionModel:
    """Return the paper's friction with this number of elements."""
    spec = SECTIONS["friction"]
    return model({**spec, "curve": {**spec["curve"], "elements": elements}})


def machine(friction: FrictionModel, steps: int, **loop: float) -> Machine:
    """Return the paper's machine with this friction."""
    controller = create(REGISTRY, Controller, SECTIONS["controller"])
    settings = ControlLoop.parse({**SECTIONS["loop"], **loop}, "loop")
    return Machine(PLANT, friction, controller, settings, Numerics(steps_per_sample=steps))


def setup_of(friction: FrictionModel, steps: int, is_vectorised: bool) -> Setup:
    """Return the paper's machine with this friction made ready, in lanes or not."""
    return replace(prepare_setup(machine(friction, steps)), is_vectorised=is_vectorised)


def in_turns(*actions: Callable[[], object], turns: int = TURNS) -> np.ndarray:
    """Return times [s], shape (actions, turns): they take turns, so that what disturbs one disturbs the others."""
    times = np.empty((len(actions), turns))
    for turn in range(turns):
        order = range(len(actions)) if turn % 2 else reversed(range(len(actions)))
        for i in order:
            began = time.perf_counter()
            actions[i]()
            times[i, turn] = time.perf_counter() - began
    return times


def ratio(times: np.ndarray, over: int) -> float:
    """Return how many times longer the first action takes than another."""
    return float(np.median(times[0] / times[over]))


def distance(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the greatest difference of any channel, relative to the channel's greatest number."""
    return float(np.max(np.abs(found - expected).max(axis=1) / np.abs(expected).max(axis=1)))


def long_enough(setup: Setup) -> Loops:
    """Return loops that take about the least time of a turn."""
    loops = Loops.of(setup, 1)
    loops.run()
    taken = min(in_turns(loops.run, turns=3)[0])
    return Loops.of(setup, int(np.ceil(1.2 * LEAST / taken)))


def over_c(elements: int, steps: int, is_vectorised: bool, folder: Path, figures: Figures) -> None:
    """Compare fraexp's kernel with its twins."""
    loops, kind = long_enough(setup_of(rolling(elements), steps, is_vectorised)), "lanes" if is_vectorised else "scalar"
    run = twins.compiled(kind, folder, elements, loops.sizes if is_vectorised else None)
    parts_of_times, apart = [], 0.0
    for _ in range(PLACES):
        loops = Loops.of(loops.setup, loops.batches)
        pool = np.zeros_like(loops.pool)
        actions = [loops.run, twins.prepared(run, loops, pool)]
        in_turns(*actions, turns=1)
        apart = max(apart, distance(loops.channels(pool), loops.channels()))
        parts_of_times.append(in_turns(*actions, turns=TURNS // PLACES))
    times = np.hstack(parts_of_times)
    (cost, twin_cost), times_over = np.median(times, axis=1) / loops.steps * 1e9, ratio(times, 1)
    bound = (LANES if is_vectorised else SCALAR) if elements == 20 else np.inf
    told = f" ({bound:g})" if elements == 20 else ""
    text = f"{cost:6.2f} ns, C {twin_cost:5.2f}: {times_over:.2f} times{told}; channels apart {apart:.1e}"
    numbers = {"fraexp_ns": cost, "C_ns": twin_cost, "over_C": times_over, "apart": apart}
    what = f"{kind}, {elements} elements, {steps} steps per sample"
    figures.row(what, text, numbers, (times_over, bound), (apart, AGREEMENT))


def whole_sweeps(figures: Figures) -> None:
    """Measure a whole simulation, with all that is done in Python, per step of one frequency."""
    for steps in (1, 2, 5):
        made, excitation = machine(rolling(20), steps), sweep(100)
        signals = simulate_loop(made, excitation, lambda _: None)
        samples = sum(
            segment.settling.time / SECTIONS["loop"]["sample_time"] + segment.channels["y"].size
            for segment in signals.segments
            if segment.settling
        )
        taken = statistics.median(
            in_turns(lambda m=made, e=excitation: simulate_loop(m, e, lambda _: None), turns=15)[0]
        )
        cost = taken / (samples * steps) * 1e9
        text = f"{cost:6.2f} ns per step; {taken * 1e3:.1f} ms for 100 frequencies, 1 to 200 Hz"
        figures.row(f"simulate_loop, 20 elements, {steps} steps per sample", text, {"ns": cost, "seconds": taken})


def sweep(points: int, **changes: float) -> Excitation:
    """Return a stepped sine."""
    spec = {"name": "stepped_sine", "amplitude": 12.0, "points": points, **changes}
    return create(REGISTRY, Excitation, spec)


def dropped_in(folder: Path, figures: Figures, reduced: bool) -> None:
    """Compare local laws with the same ones built in."""
    (folder / "dropped.py").write_text(DROP_IN, encoding="utf-8")
    registry, built_in = discover(folder), rolling(20)
    numbers = {"stiffness": built_in.element_stiffness.tolist(), "limit": built_in.limit_deflection.tolist()}  # type: ignore[attr-defined]
    dahl = {"stiffness": 3.9e5, "coulomb_force": 17.9}
    pairs = {
        "rolling": (model({"name": "dropped_rolling", **numbers}, registry), built_in),
    }
    if not reduced:
        pairs["dahl"] = model({"name": "dropped_dahl", **dahl}, registry), model({"name": "dahl", **dahl})
    for name, (stranger, own) in pairs.items():
        first = setup_of(own, 2, is_vectorised=True)
        theirs = long_enough(first)
        mine = Loops.of(replace(first, frictions={"table": stranger}), theirs.batches)
        mine.run()
        theirs.run()
        times, apart = in_turns(mine.run, theirs.run), distance(mine.channels(), theirs.channels())
        found, cost = ratio(times, 1), np.median(times, axis=1) / mine.steps * 1e9
        text = (
            f"{cost[0]:6.2f} ns, built in {cost[1]:5.2f}: {found:.2f} times ({DROPPED:g}); channels apart {apart:.1e}"
        )
        row = {"ns": cost[0], "ratio": found, "apart": apart}
        figures.row(f"{name} as a local plugin, lanes", text, row, (found, DROPPED), (apart, AGREEMENT))


def laws(names: list[str], figures: Figures) -> None:
    """Measure what each law costs, in lanes where it can be computed so, and alone."""
    for name in names:
        friction = model({"name": name, **MODELS[name]})
        chosen = prepare_setup(machine(friction, 0))
        steps, numbers, said = chosen.discrete.compliance.shape[0], {}, []
        for is_vectorised in (True, False) if friction.is_vectorisable else (False,):
            loops = long_enough(replace(chosen, is_vectorised=is_vectorised))
            cost = statistics.median(in_turns(loops.run, turns=7)[0]) / loops.steps * 1e9
            kind = "lanes" if is_vectorised else "scalar"
            left = "" if loops.stayed else ", diverged"
            numbers[kind] = cost
            said.append(f"{kind}{'*' if is_vectorised == chosen.is_vectorised else ' '} {cost:7.2f} ns{left}")
        if not friction.is_vectorisable:
            said.insert(0, "lanes        none")
        figures.row(f"{name}, {steps} steps per sample", ", ".join(said), numbers)
    print("* what fraexp chooses on the paper's machine; per step of one lane, with the steps that it chooses")


def accuracy(names: list[str], figures: Figures, reduced: bool) -> None:
    """Measure how far U/Y is from that at `REFERENCE` steps per sample, and what it takes to compute."""
    excitation = sweep(4 if reduced else 12, lowest=5.0, highest=150.0, tolerance=1e-7)
    for name in names:
        friction, cells, numbers = model({"name": name, **MODELS[name]}), [], {}
        reference, _ = response(friction, REFERENCE, excitation)
        for steps in (1, 2, 4, 8):
            try:
                found, taken = response(friction, steps, excitation)
            except FraexpError:
                cells.append(f"{steps}: too long a step".ljust(34))
                continue
            error = np.abs(found / reference[: found.size] - 1) if found.size == reference.size else np.array([np.inf])
            cells.append(f"{steps}: {np.max(error):.1e} {np.median(error):.1e} {taken * 1e3:6.1f} ms".ljust(34))
            numbers |= {f"greatest_{steps}": float(np.max(error)), f"seconds_{steps}": taken}
        figures.row(f"{name}, error", " ".join(cells), numbers)


def response(friction: FrictionModel, steps: int, excitation: Excitation) -> tuple[np.ndarray, float]:
    """Return Y/U [m/N] of each frequency, and the time that its simulation took once compiled [s]."""
    made = machine(friction, steps, resolution=0.0)
    taken, signals = np.inf, None
    for _ in range(3 if steps < REFERENCE else 1):
        began = time.perf_counter()
        signals = simulate_loop(made, excitation, lambda _: None)
        taken = min(taken, time.perf_counter() - began)
    assert signals is not None
    spectra = [
        tuple(np.fft.rfft(segment.channels[key][-1])[segment.lines[0]] for key in ("y", "u"))
        for segment in signals.segments
    ]
    return np.array([y / u for y, u in spectra]), taken


def parts(reduced: bool, folder: Path, figures: Figures) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield the tables with their titles."""
    names = ["rolling"] if reduced else list(MODELS)
    if twins.compiler() is None:
        print("gcc is not there: no comparison with C", flush=True)
    else:
        sizes = [(20, 1), (20, 2)] if reduced else [(20, 1), (20, 2), (20, 5), (5, 2), (80, 2)]
        pairs = [(*size, is_vectorised) for is_vectorised in (True, False) for size in sizes]
        yield "time per step of one lane, over C", lambda: [over_c(*each, folder, figures) for each in pairs] and None
    yield "with what is done around it", lambda: whole_sweeps(figures)
    yield "a law in a file of its own", lambda: dropped_in(folder, figures, reduced)
    yield "law by law", lambda: laws(names, figures)
    yield (
        f"error of Y/U over steps per sample, against {REFERENCE}: greatest, median, time",
        lambda: accuracy(names, figures, reduced),
    )


def main() -> int:
    """Print all tables; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--reduced", action="store_true", help="fewer sizes and laws")
    options.add_argument("--slack", type=float, default=1.0, help="factor on the bounds, for machines with other work")
    options.add_argument("--json", type=Path, metavar="FILE", help="write all figures to this file")
    given = options.parse_args()
    figures = Figures(slack=given.slack)
    with tempfile.TemporaryDirectory() as name:
        for title, table in parts(given.reduced, Path(name), figures):
            print(f"\n{title}", flush=True)
            table()
    if given.json:
        given.json.write_text(json.dumps(figures.found, indent=1) + "\n", encoding="utf-8")
    print(f"\n{figures.missed} missed")
    return min(figures.missed, 1)


if __name__ == "__main__":
    sys.exit(main())
