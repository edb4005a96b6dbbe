"""Compare the Coulomb force that two methods find on machines drawn at random, of which the dead time is given.

    python benchmarks/coulomb_force.py                  6 machines, two each with rolling, LuGre and Dahl friction
    python benchmarks/coulomb_force.py --reduced        the first two
    python benchmarks/coulomb_force.py --blind          maximum likelihood gets no law either: minutes for each machine
    python benchmarks/coulomb_force.py --seed 7

Both get the same record: sines at 20 frequencies and two amplitudes, 1.3 and 2.6 times the force at which the machine
slides, 4 periods each, with an encoder of 0.1 µm and 30 nm of noise. Two amplitudes (`plant_and_friction`) finds
elements that make y'/û_e the same at both, and is told nothing of friction. Maximum likelihood is told the law, from a
force and deflections wrong by up to 30 %, damping and Stribeck velocity by up to 50 %, the viscous coefficient by up to
a factor of 2, as in `law_selection.py`; so the two are no equals. With `--blind` it is `friction_law_comparison`
without candidates. A row has the error relative to the force, the half width of the 95 % interval, and what the method
says of itself.

The exit code is 1 if a force that its method calls right is more than 1 % wrong.
"""

import argparse
import os
import sys
import time
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from drawn_machines import DrawnMachine
from law_selection import LAWS, MAX_FREQUENCY_RATIO, MIN_FREQUENCY_HZ, candidates, machines
from maximum_likelihood import NOISE_M, RESOLUTION_M

from fraexp.components.kinds import Controller, Estimator, Excitation, FrictionModel, Plant
from fraexp.components.registry import create, discover
from fraexp.data.signals import Signals
from fraexp.errors import RecordError
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics

REGISTRY = discover()
SEED = 20
POINTS, PERIODS, RELATIVE_AMPLITUDES = 20, 4, (1.3, 2.6)
TWO_AMPLITUDES, LIKELIHOOD = "two amplitudes", "maximum likelihood"
MAX_ERROR = 0.01
"""Relative error of a force that is called right."""


def coulomb_force(friction: dict[str, Any]) -> float:
    """Return the force of gross sliding at speed [N], without viscous friction."""
    return float(friction["coulomb_force"] if "coulomb_force" in friction else sum(friction["limit_force"]))


def drawn(count: int, seed: int) -> list[DrawnMachine]:
    """Return machines in turn of each law."""
    pool = {law: machines(-(-count // len(LAWS)), (law,), seed) for law in LAWS}
    return [pool[LAWS[place % len(LAWS)]][place // len(LAWS)] for place in range(count)]


def record(machine: DrawnMachine) -> Signals:
    """Return what an encoder records of a machine at both amplitudes."""
    own, force = machine.sections(), machine.amplitude / machine.relative_amplitude
    simulated = Machine(
        create(REGISTRY, Plant, own["plant"]),
        create(REGISTRY, FrictionModel, own["friction"]),
        create(REGISTRY, Controller, own["controller"]),
        ControlLoop.parse({**own["loop"], "resolution": RESOLUTION_M, "noise": NOISE_M}, "loop"),
        Numerics(),
    )
    highest = min(200.0, MAX_FREQUENCY_RATIO / machine.reference.sample_time)
    grid = np.geomspace(MIN_FREQUENCY_HZ, highest, POINTS).tolist()
    sine = {"name": "stepped_sine", "frequencies": grid, "recorded_periods": PERIODS}
    parts = [{**sine, "amplitude": ratio * force} for ratio in RELATIVE_AMPLITUDES]
    excitation = create(REGISTRY, Excitation, {"name": "concatenated", "parts": parts})
    return simulate_loop(simulated, excitation, lambda _: None)


def specification(method: str, machine: DrawnMachine, seed: int, is_blind: bool) -> dict[str, Any]:
    """Return the estimator of a method, which is told the law of the machine unless it is blind."""
    spec = {"resolution": RESOLUTION_M, "noise": NOISE_M, **machine.delays()}
    if method == TWO_AMPLITUDES:
        return {"name": "plant_and_friction", **spec}
    random = np.random.default_rng([seed, machine.number])
    models = () if is_blind else candidates(machine, (machine.law,), random, is_blind=False)
    return {"name": "friction_law_comparison", "candidates": models, **spec}


def estimated(spec: dict[str, Any], signals: Signals) -> tuple[float, float, bool]:
    """Return the force [N], the half width of its 95 % interval, and the method's verdict; NaN where it finds none."""
    try:
        result = create(REGISTRY, Estimator, spec).estimate(signals)
    except RecordError:
        return np.nan, np.nan, False
    known = {each.name: each.value for each in result.metrics}
    force = known.get("Coulomb force", np.nan)
    return force, known.get("Coulomb force, 95 %", np.nan), known.get("verdict", 0.0) == 1


def main() -> int:
    """Print a row for each machine and method, and the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=6, help="number of machines (6)")
    parser.add_argument("--seed", type=int, default=SEED, help=f"seed of the draws ({SEED})")
    parser.add_argument("--blind", action="store_true", help="no law is given")
    parser.add_argument("--reduced", action="store_true", help="2 machines")
    arguments = parser.parse_args()
    errors: dict[str, list[float]] = {TWO_AMPLITUDES: [], LIKELIHOOD: []}
    missed = 0
    for machine in drawn(2 if arguments.reduced else arguments.machines, arguments.seed):
        signals, true = record(machine), coulomb_force(machine.friction)
        for name, found in errors.items():
            began = time.process_time()
            spec = specification(name, machine, arguments.seed, arguments.blind)
            force, half_width, is_right = estimated(spec, signals)
            seconds, error = time.process_time() - began, force / true - 1
            found.append(abs(error) if np.isfinite(error) else np.inf)
            is_missed = is_right and not abs(error) <= MAX_ERROR
            missed += is_missed
            verdict = ("right" if is_right else "not sure") + (", MISSED" if is_missed else "")
            what = f"{machine.number} {machine.law}, {true:.4g} N, {name}"
            print(f"{what:44s} {error:+.1e} ± {half_width / true:.1e}  {verdict}; {seconds:.0f} CPU-s", flush=True)
    for name, found in errors.items():
        print(f"{name}: median error {np.median(found):.3%}, largest {max(found):.3%}")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
