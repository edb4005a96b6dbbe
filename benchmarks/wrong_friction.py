"""Does the proposed method notice a wrong friction model, and leave a right one alone? A row for each model.

    python benchmarks/wrong_friction.py                  the paper's machine
    python benchmarks/wrong_friction.py --machines 20    and 20 machines drawn at random
    python benchmarks/wrong_friction.py --only-drawn --machines 20 --seed 7    20 others alone

On the paper's machine a model 5 % wrong, in force or deflections, must not be ok at 12, 25 and 75 N, by any of three
encoders and at three spacings of the frequencies; the right one must never be contradicted. Drawn machines (every kind
of friction, every second one with an encoder of 0.1 µm) show how often a model 1 % and 5 % wrong is noticed; a right
one must not be contradicted either. The exit code is 1 if a bound is missed.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from calibrate_machine import MACHINE, sections_of
from drawn_machines import drawn_machine

from fraexp.components.kinds import Estimator, Excitation
from fraexp.components.registry import create, discover
from fraexp.data.signals import Signals
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import Machine, build_machine

REGISTRY = discover()
PAPER = sections_of(MACHINE)
ENCODERS = ((0.0, 0.0, 1), (1e-7, 0.0, 1), (1e-7, 30e-9, 8))
"""Resolution [m], noise [m], periods."""
GRIDS = {"100": (1.0, 200.0, 100), "30": (1.5, 150.0, 30), "16": (2.0, 150.0, 16)}
SCALES = ((1.0, 1.0), (1.01, 1.0), (1.05, 1.0), (0.95, 1.0), (1.0, 1.05), (1.0, 0.95))
"""Factors on force and deflections of the model."""
MATERIAL_ERROR = 0.01
"""Error of the response from which a wrong model must be noticed."""
DRAWN_POINTS, DRAWN_SEED = 24, 20261
SAID = "contradict the friction model"


class Verdict(NamedTuple):
    """What a sweep says of its friction model."""

    is_ok: bool
    is_contradicted: bool
    error: float
    """Greatest relative error of the response at settled frequencies."""
    decibel: float
    """Greatest error of its magnitude there [dB]."""


def verdicts(
    sections: Mapping[str, Any],
    amplitude: float,
    frequencies: Sequence[float],
    encoder: tuple[float, float, int],
    scales: Sequence[tuple[float, float]],
) -> list[Verdict]:
    """Return what sweeps say whose friction models are the machine's, but for factors on force and deflections."""
    resolution, noise, periods = encoder
    loop = {**sections["loop"], "resolution": resolution, "noise": noise, "seed": 1}
    machine = build_machine({"numerics": {}, **sections, "loop": loop}, REGISTRY)
    excitation = {
        "name": "stepped_sine", "amplitude": amplitude, "frequencies": frequencies, "recorded_periods": periods,
    }  # fmt: skip
    signals = simulate_loop(machine, create(REGISTRY, Excitation, excitation), lambda _: None)
    paths = [key for key in loop if key.endswith(("dead_time", "time_constants"))]
    given = {key: loop[key] for key in paths} | {"resolution": resolution, "noise": noise}
    own = {"name": "effective_input", "friction": sections["friction"], **given}
    return [
        _verdict(
            create(REGISTRY, Estimator, {**own, "force_scale": force, "displacement_scale": width}), signals, machine
        )
        for force, width in scales
    ]


def _verdict(method: Estimator, signals: Signals, machine: Machine) -> Verdict:
    found = method.estimate(signals)
    if found.response is None:
        return Verdict(False, False, 0.0, 0.0)
    ratio = found.response.response / machine.response(2 * np.pi * found.response.frequency)
    ratio = ratio[found.response.settled]
    error, decibel = np.abs(ratio - 1).max(initial=0.0), 20 * np.abs(np.log10(np.abs(ratio))).max(initial=0.0)
    return Verdict(found.outcome.name == "OK", SAID in found.message, float(error), float(decibel))


def papers_machine() -> int:
    """Print a row for each amplitude, encoder and spacing; return how many bounds are missed."""
    missed = 0
    heads = " ".join(f"{force:g}/{width:g}".rjust(10) for force, width in SCALES)
    print(f"not ok (x), ok (.), error of the response [dB]; force/deflections   {heads}")
    for amplitude in (12.0, 25.0, 75.0):
        for encoder in ENCODERS:
            for name, (low, high, count) in GRIDS.items():
                found = verdicts(PAPER, amplitude, tuple(np.geomspace(low, high, count)), encoder, SCALES)
                missed += found[0].is_contradicted + sum(each.is_ok for each in found[2:])
                cells = " ".join(f"{'.' if v.is_ok else 'x'} {v.decibel:8.2f}" for v in found)
                kind = f"{encoder[0] * 1e6:g} µm, {encoder[1] * 1e9:g} nm, {encoder[2]} periods"
                print(f"{amplitude:3.0f} N, {kind:24s} {name:>4s} frequencies {'':14s}{cells}", flush=True)
    return missed


def drawn_machines(count: int, seed: int) -> int:
    """Print how often wrong models of drawn machines are noticed; return how many right ones are contradicted."""
    false, noticed, total = 0, np.zeros(2, dtype=int), np.zeros(2, dtype=int)
    for number in range(count):
        drawn = drawn_machine(number, seed)
        grid = tuple(np.geomspace(drawn.frequencies[0], drawn.frequencies[-1], DRAWN_POINTS))
        found = verdicts(drawn.sections(), drawn.amplitude, grid, ENCODERS[number % 2], SCALES[:3])
        is_material = np.array([drawn.law != "none" and each.error > MATERIAL_ERROR for each in found[1:]])
        noticed += is_material & [not each.is_ok for each in found[1:]]
        total += is_material
        false += found[0].is_contradicted
        cells = " ".join(f"{'.' if each.is_ok else 'x'} {each.error:8.1e}" for each in found)
        text = f"{number:3d} {drawn.law:26s} amplitude {drawn.relative_amplitude:4.1f} of the friction force: {cells}"
        print(text + "  right model contradicted" * found[0].is_contradicted, flush=True)
    for name, size, of in zip(("1 %", "5 %"), noticed, total, strict=True):
        print(f"a model {name} wrong that moves the response by more than {MATERIAL_ERROR:g}: {size} of {of} not ok")
    print(f"{false} right models contradicted")
    return false


def main() -> int:
    """Print all rows; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--machines", type=int, default=0, help="machines drawn at random")
    options.add_argument("--seed", type=int, default=DRAWN_SEED, help="of the drawn machines")
    options.add_argument("--only-drawn", action="store_true", help="leave the paper's machine out")
    chosen = options.parse_args()
    missed = 0 if chosen.only_drawn else papers_machine()
    missed += drawn_machines(chosen.machines, chosen.seed)
    print(f"{missed} missed")
    return min(missed, 1)


if __name__ == "__main__":
    sys.exit(main())
