"""Measure the kernel of the loop: against the same algorithm by hand in C, law by law, and its accuracy over its cost.

    python benchmarks/kernel.py               some minutes
    python benchmarks/kernel.py --reduced     fewer sizes and laws, half a minute
    python benchmarks/kernel.py --slack 1.5   bounds half as large again, for a machine that has other work to do
    python benchmarks/kernel.py --against C   the loops in lanes and one by one, over those of a commit

Each comparison runs in one process on one thread; what is compared takes turns, and a ratio is the median of those of
each turn. Both sides get the same constants, and their channels must agree to 1e-9. In lanes the sizes of one machine
are compiled into the C program.
"""

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import twins
from accuracy import MODELS
from harness import Bench, in_turns, run
from loops import Loops
from paper_machine import FRICTION, PAPER, REGISTRY, machine_of, simulated

from fraexp.components.kinds import FrictionModel
from fraexp.components.registry import create, discover
from fraexp.errors import FraexpError
from fraexp.simulation.experiments import Setup
from fraexp.simulation.loop_setup import prepare_setup
from fraexp.simulation.machine import Machine

LANES, SCALAR, DROPPED = 1.15, 1.2, 1.2
"""Bounds of time: lanes and scalar over C, a local law over the same one built in."""
AGREEMENT = 1e-9
TURNS, LEAST, PLACES = 20, 0.02, 5
"""Turns of a comparison, the least time of each [s], and fresh places in memory, on which times depend by a tenth."""
REFERENCE = 40
"""Steps per sample that accuracy is measured against."""
DROP_IN = '''"""A law in a file of its own."""

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
'''


def model(spec: dict[str, Any], registry: Any = REGISTRY) -> FrictionModel:
    """Return a friction model."""
    return create(registry, FrictionModel, spec)


def rolling(elements: int) -> FrictionModel:
    """Return the paper's friction with this number of elements."""
    spec = PAPER["friction"]
    return model({**spec, "curve": {**spec["curve"], "elements": elements}})


def machine(friction: FrictionModel, steps: int, **loop: float) -> Machine:
    """Return the paper's machine with this friction."""
    made = machine_of(PAPER, {"steps_per_sample": steps}, **loop)
    return replace(made, friction=friction)


def setup_of(friction: FrictionModel, steps: int, is_vectorised: bool) -> Setup:
    """Return the paper's machine with this friction made ready, in lanes or not."""
    return replace(prepare_setup(machine(friction, steps)), is_vectorised=is_vectorised)


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


def over_c(bench: Bench) -> None:
    """Time per step of one lane, over C."""
    if twins.compiler() is None:
        print("gcc is not there: no comparison with C", flush=True)
        return
    sizes = [(20, 1), (20, 2)] if bench.reduced else [(20, 1), (20, 2), (20, 5), (5, 2), (80, 2)]
    with tempfile.TemporaryDirectory() as folder:
        for is_vectorised in (True, False):
            for elements, steps in sizes:
                _compare_with_c(bench, elements, steps, is_vectorised, Path(folder))


def _compare_with_c(bench: Bench, elements: int, steps: int, is_vectorised: bool, folder: Path) -> None:
    loops, kind = long_enough(setup_of(rolling(elements), steps, is_vectorised)), "lanes" if is_vectorised else "scalar"
    twin = twins.compiled(kind, folder, elements, loops.sizes if is_vectorised else None)
    parts_of_times, apart = [], 0.0
    for _ in range(PLACES):
        loops = Loops.of(loops.setup, loops.batches)
        pool = np.zeros_like(loops.pool)
        parts_of_times.append(in_turns(loops.run, twins.prepared(twin, loops, pool), turns=TURNS // PLACES))
        apart = max(apart, distance(loops.channels(pool), loops.channels()))
    times = np.hstack(parts_of_times)
    (cost, twin_cost), over = np.median(times, axis=1) / loops.steps * 1e9, ratio(times, 1)
    bound = (LANES if is_vectorised else SCALAR) * bench.options.slack if elements == 20 else np.inf
    text = f"{cost:6.2f} ns, C {twin_cost:5.2f}: {over:.2f} times ({bound:g}); channels apart {apart:.1e}"
    what = f"{kind}, {elements} elements, {steps} steps per sample"
    bench.row(what, text, over <= bound and apart <= AGREEMENT, fraexp_ns=cost, C_ns=twin_cost, over_C=over)


def sweep(points: int, **changes: float) -> dict[str, Any]:
    """Return a stepped sine."""
    return {"name": "stepped_sine", "amplitude": 12.0, "points": points, **changes}


def dropped_in(bench: Bench) -> None:
    """A law in a file of its own, over the same one built in."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "dropped.py").write_text(DROP_IN, encoding="utf-8")
        registry, built_in = discover(Path(folder)), rolling(20)
        numbers = {"stiffness": built_in.element_stiffness.tolist(), "limit": built_in.limit_deflection.tolist()}  # type: ignore[attr-defined]
        stranger = model({"name": "dropped_rolling", **numbers}, registry)
        first = setup_of(built_in, 2, is_vectorised=True)
        theirs = long_enough(first)
        mine = Loops.of(replace(first, frictions={"table": stranger}), theirs.batches)
        times = in_turns(mine.run, theirs.run, turns=TURNS)
        over, apart = ratio(times, 1), distance(mine.channels(), theirs.channels())
        cost, bound = np.median(times, axis=1) / mine.steps * 1e9, DROPPED * bench.options.slack
        text = f"{cost[0]:6.2f} ns, built in {cost[1]:5.2f}: {over:.2f} times ({bound:g}); apart {apart:.1e}"
        bench.row("rolling as a local plugin, lanes", text, over <= bound and apart <= AGREEMENT, ratio=over)


def laws(bench: Bench) -> None:
    """Per step of one lane, with the steps that fraexp chooses; * marks whether it computes the law in lanes."""
    for name in ["rolling"] if bench.reduced else MODELS:
        friction = model({"name": name, **MODELS[name]})
        chosen = prepare_setup(machine(friction, 0))
        steps, said = chosen.discrete.compliance.shape[0], []
        for is_vectorised in (True, False) if friction.is_vectorisable else (False,):
            loops = long_enough(replace(chosen, is_vectorised=is_vectorised))
            cost = float(np.median(in_turns(loops.run, turns=7))) / loops.steps * 1e9
            kind = "lanes" if is_vectorised else "scalar"
            mark = "*" if is_vectorised == chosen.is_vectorised else " "
            said.append(f"{kind}{mark} {cost:7.2f} ns{'' if loops.stayed else ', diverged'}")
        bench.row(f"{name}, {steps} steps per sample", ", ".join(said))


def step_errors(bench: Bench) -> None:
    """Error of Y/U over steps per sample: greatest, median, and the time that it takes."""
    excitation = sweep(4 if bench.reduced else 12, min_frequency=5.0, max_frequency=150.0, settling_tolerance=1e-7)
    for name in ["rolling"] if bench.reduced else MODELS:
        friction, cells = model({"name": name, **MODELS[name]}), []
        reference, _ = response(friction, REFERENCE, excitation)
        for steps in (1, 2, 4, 8):
            try:
                found, taken = response(friction, steps, excitation)
            except FraexpError:
                cells.append(f"{steps}: too long a step".ljust(34))
                continue
            error = np.abs(found / reference - 1) if found.size == reference.size else np.array([np.inf])
            cells.append(f"{steps}: {np.max(error):.1e} {np.median(error):.1e} {taken * 1e3:6.1f} ms".ljust(34))
        bench.row(f"{name}, error", " ".join(cells))


def response(friction: FrictionModel, steps: int, excitation: Mapping[str, Any]) -> tuple[np.ndarray, float]:
    """Return Y/U [m/N] of each frequency, and the time that its simulation took once compiled [s]."""
    made = machine(friction, steps, resolution=0.0)
    taken = in_turns(lambda: simulated(made, excitation), turns=2 if steps < REFERENCE else 1).min()
    spectra = [
        [np.fft.rfft(segment.channels[key][-1])[segment.lines[0]] for key in ("y", "u")]
        for segment in simulated(made, excitation).segments
    ]
    return np.array([y / u for y, u in spectra]), float(taken)


WORKS = {
    f"{'lanes' if is_vectorised else 'one by one'}, {steps} steps per sample": lambda s=steps, v=is_vectorised: (
        Loops.of(setup_of(FRICTION, s, v), 40 if v else 80).run
    )
    for is_vectorised in (True, False)
    for steps in (1, 2)
}

if __name__ == "__main__":
    run(__doc__, over_c, dropped_in, laws, step_errors, works=WORKS, slack=1.0)
