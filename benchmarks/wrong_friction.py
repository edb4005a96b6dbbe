"""Does the proposed method notice a wrong friction model, and leave a right one alone? A row for each model.

    python benchmarks/wrong_friction.py                        the paper's machine, and 20 machines drawn at random
    python benchmarks/wrong_friction.py drawn --machines 40    drawn machines alone

On the paper's machine a model 5 % wrong, in force or deflections, must not be ok at 12, 25 and 75 N, by any of three
encoders and at three spacings of the frequencies; the right one must never be contradicted. Drawn machines (every kind
of friction, every second one with an encoder of 0.1 µm) show how often a model 1 % and 5 % wrong is noticed; a right
one must not be contradicted either.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from drawn_machines import drawn_machine
from harness import Bench, run
from paper_machine import PAPER, REGISTRY, decibel, machine_of, simulated

from fraexp.components.kinds import Estimator
from fraexp.components.registry import create
from fraexp.data.signals import Signals
from fraexp.simulation.machine import Machine

ENCODERS = ((0.0, 0.0, 1), (1e-7, 0.0, 1), (1e-7, 30e-9, 8))
"""Resolution [m], noise [m], periods."""
GRIDS = {"100": (1.0, 200.0, 100), "30": (1.5, 150.0, 30), "16": (2.0, 150.0, 16)}
SCALES = ((1.0, 1.0), (1.01, 1.0), (1.05, 1.0), (0.95, 1.0), (1.0, 1.05), (1.0, 0.95))
"""Factors on force and deflections of the model."""
MATERIAL_ERROR = 0.01
"""Error of the response from which a wrong model must be noticed."""
DRAWN_POINTS = 24
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
    machine = machine_of({**sections, "loop": loop}, sections.get("numerics"))
    sine = {"name": "stepped_sine", "amplitude": amplitude, "frequencies": frequencies, "recorded_periods": periods}
    signals = simulated(machine, sine)
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
    error, decibels = np.abs(ratio - 1).max(initial=0.0), np.abs(decibel(ratio)).max(initial=0.0)
    return Verdict(found.outcome.name == "OK", SAID in found.message, float(error), float(decibels))


def paper(bench: Bench) -> None:
    """Not ok (x) or ok (.), and the error of the response [dB], for each factor on force and deflections."""
    heads = " ".join(f"{force:g}/{width:g}".rjust(10) for force, width in SCALES)
    print(f"{'':<64s} {heads}")
    for amplitude in (12.0, 25.0, 75.0):
        for encoder in ENCODERS:
            for name, (low, high, count) in list(GRIDS.items())[-1 if bench.reduced else 0 :]:
                found = verdicts(PAPER, amplitude, tuple(np.geomspace(low, high, count)), encoder, SCALES)
                cells = " ".join(f"{'.' if v.is_ok else 'x'} {v.decibel:8.2f}" for v in found)
                kind = f"{encoder[0] * 1e6:g} µm, {encoder[1] * 1e9:g} nm, {encoder[2]} periods"
                is_met = not found[0].is_contradicted and not any(each.is_ok for each in found[2:])
                bench.row(f"{amplitude:.0f} N, {kind}, {name} frequencies", cells, is_met)


def drawn(bench: Bench) -> None:
    """Models right, 1 % and 5 % wrong: not ok (x) or ok (.), and the relative error of the response."""
    noticed, total = np.zeros(2, dtype=int), np.zeros(2, dtype=int)
    for number in range(bench.options.machines):
        machine = drawn_machine(number, bench.seed)
        grid = tuple(np.geomspace(machine.frequencies[0], machine.frequencies[-1], DRAWN_POINTS))
        found = verdicts(machine.sections(), machine.amplitude, grid, ENCODERS[number % 2], SCALES[:3])
        is_material = np.array([machine.law != "none" and each.error > MATERIAL_ERROR for each in found[1:]])
        noticed += is_material & [not each.is_ok for each in found[1:]]
        total += is_material
        cells = " ".join(f"{'.' if each.is_ok else 'x'} {each.error:8.1e}" for each in found)
        what = f"{number} {machine.law}, {machine.relative_amplitude:.1f} of the friction force"
        bench.row(what, cells, not found[0].is_contradicted)
    for name, size, of in zip(("1 %", "5 %"), noticed, total, strict=True):
        bench.row(
            f"a model {name} wrong that moves the response by more than {MATERIAL_ERROR:g}", f"{size} of {of} not ok"
        )


if __name__ == "__main__":
    run(__doc__, paper, drawn, machines=(20, 4))
