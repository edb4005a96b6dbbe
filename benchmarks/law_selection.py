"""Count how often `friction_law_comparison` chooses the law of a machine, for machines and laws drawn at random.

    python benchmarks/law_selection.py                   20 machines with rolling, LuGre and Dahl friction
    python benchmarks/law_selection.py --all-laws        GMS and elastoplastic friction, too
    python benchmarks/law_selection.py --blind           from guesses
    python benchmarks/law_selection.py --seed 7 --machines 40

Records of 16 sines, one period each, are simulated with an encoder of 0.1 µm. The amplitude is 1.3 to 4 times the force
at which the machine slides. Every law is a candidate. That of the machine starts with a force and deflections wrong by
up to 30 %, damping, Stribeck velocity and attraction by up to 50 %, and the viscous coefficient by up to a factor of 2;
with `--blind` these and the static force are guesses that know nothing of the machine. Elements have the machine's
proportions. The other laws start at the same force and deflections. The dead time is given.

The exit code is 1 if the law is not the machine's in more than one of twenty.
"""

import argparse
import os
import sys
import time
from dataclasses import replace
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from drawn_machines import DrawnMachine, drawn_machine
from maximum_likelihood import RESOLUTION_M, scaled_model

from fraexp.components.kinds import Controller, Estimator, Excitation, FrictionModel, Plant
from fraexp.components.registry import create, discover
from fraexp.data.results import Result
from fraexp.data.signals import Signals
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics

REGISTRY = discover()
SEED = 20
POINTS, MIN_FREQUENCY_HZ, MAX_FREQUENCY_RATIO = 16, 2.0, 0.12
"""Frequencies: their number, the least, and the greatest over the sample rate, at most 200 Hz."""
LAWS = ("rolling", "lugre", "dahl")
SLOW_LAWS = ("gms", "elastoplastic")
"""Laws that are not replayed in lanes."""
MAX_START_ERROR, MAX_SHAPE_LOG = 0.3, 0.4
"""Largest relative error of force and deflections at the start, and largest logarithm of a factor on other numbers."""
RELATIVE_AMPLITUDES = (1.3, 4.0)
"""Amplitude over the force at which a machine slides."""
STATIC_RATIO, VELOCITY_M_S, DAMPING_TIME_S = 1.2, 2e-3, 5e-4
"""Guesses: static over Coulomb force, Stribeck velocity, bristle damping over stiffness."""
MAX_WRONG_SHARE = 0.05


def machines(count: int, laws: tuple[str, ...], seed: int) -> list[DrawnMachine]:
    """Return machines whose friction is one of these laws, in a random order of laws."""
    found: list[DrawnMachine] = []
    random, number = np.random.default_rng([seed, 1]), 0
    while len(found) < count:
        machine = drawn_machine(number, seed)
        number += 1
        if machine.law in laws:
            relative = float(np.exp(random.uniform(*np.log(RELATIVE_AMPLITUDES))))
            force = machine.amplitude / machine.relative_amplitude
            found.append(replace(machine, amplitude=force * relative, relative_amplitude=relative))
    return found


def force_and_width(machine: DrawnMachine) -> tuple[float, float]:
    """Return the Coulomb force [N] of a machine, and its presliding distance [m]."""
    force, own = machine.amplitude / machine.relative_amplitude, machine.friction
    stiffness = np.sum(own.get("stiffness", own.get("bristle_stiffness", 0.0)))
    return force, force / float(stiffness)


def candidates(
    machine: DrawnMachine, laws: tuple[str, ...], random: np.random.Generator, is_blind: bool
) -> list[dict[str, Any]]:
    """Return a model of each law, wrong at random."""
    factors = 1 + random.uniform(-MAX_START_ERROR, MAX_START_ERROR, 2)
    force, width = np.array(force_and_width(machine)) * factors
    stiffness, viscous = force / width, machine.friction["viscous_coefficient"] * random.uniform(0.5, 2)
    common = {"coulomb_force": force, "viscous_coefficient": viscous}
    stribeck = {"static_force": STATIC_RATIO * force, "stribeck_velocity": VELOCITY_M_S}
    bristles = {"bristle_stiffness": stiffness, "bristle_damping": DAMPING_TIME_S * stiffness}
    fractions = np.array([0.3, 0.3, 0.4])
    curve = {
        "shape": "exponential", "coulomb_force": force, "characteristic_displacement": width, "elements": 20,
        "min_knot": 0.01 * width, "max_knot": 2.2 * width,
    }  # fmt: skip
    models: dict[str, dict[str, Any]] = {
        "rolling": {"name": "rolling", "curve": curve, "viscous_coefficient": viscous},
        "dahl": {"name": "dahl", "stiffness": stiffness, **common},
        "lugre": {"name": "lugre", **bristles, **common, **stribeck},
        "elastoplastic": {"name": "elastoplastic", **bristles, **common, **stribeck},
        "gms": {
            "name": "gms", "stiffness": (stiffness * np.array([0.6, 0.3, 0.1])).tolist(),
            "force_fractions": fractions.tolist(), "attraction_rate": 30 * force, **common, **stribeck,
        },
    }  # fmt: skip
    if is_blind and machine.law not in ("rolling", "gms"):
        return [models[law] for law in laws]
    own = scaled_model({**machine.friction, "viscous_coefficient": viscous}, *factors)
    for name in ("bristle_damping", "stribeck_velocity", "attraction_rate"):
        if name in own:
            own[name] *= float(np.exp(random.uniform(-MAX_SHAPE_LOG, MAX_SHAPE_LOG)))
    if is_blind and machine.law == "gms":
        own.update(
            {name: value for name, value in models["gms"].items() if name in stribeck or name == "attraction_rate"}
        )
    models[machine.law] = own
    return [models[law] for law in laws]


def record(machine: DrawnMachine) -> Signals:
    """Return what an encoder records of a machine."""
    own = machine.sections()
    simulated = Machine(
        create(REGISTRY, Plant, own["plant"]),
        create(REGISTRY, FrictionModel, own["friction"]),
        create(REGISTRY, Controller, own["controller"]),
        ControlLoop.parse({**own["loop"], "resolution": RESOLUTION_M}, "loop"),
        Numerics(),
    )
    highest = min(200.0, MAX_FREQUENCY_RATIO / machine.reference.sample_time)
    frequencies = np.geomspace(MIN_FREQUENCY_HZ, highest, POINTS).tolist()
    sine = {"name": "stepped_sine", "amplitude": machine.amplitude, "frequencies": frequencies}
    return simulate_loop(simulated, create(REGISTRY, Excitation, sine), lambda _: None)


def choose(machine: DrawnMachine, signals: Signals, models: list[dict[str, Any]]) -> Result:
    """Return the comparison of laws on the records of a machine."""
    spec = {
        "name": "friction_law_comparison", "candidates": models, "resolution": RESOLUTION_M, "noise": 0.0,
        **machine.delays(),
    }  # fmt: skip
    return create(REGISTRY, Estimator, spec).estimate(signals)


def main() -> int:
    """Print what is chosen for each machine, and the count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=20, help="number of machines (20)")
    parser.add_argument("--seed", type=int, default=SEED, help=f"seed of the draws ({SEED})")
    parser.add_argument("--all-laws", action="store_true", help="GMS and elastoplastic friction, too")
    parser.add_argument("--blind", action="store_true", help="guesses of damping, Stribeck velocity and static force")
    parser.add_argument("--reduced", action="store_true", help="4 machines")
    arguments = parser.parse_args()
    laws = LAWS + SLOW_LAWS if arguments.all_laws else LAWS
    count, right, silent = 4 if arguments.reduced else arguments.machines, 0, 0
    for machine in machines(count, laws, arguments.seed):
        random = np.random.default_rng([arguments.seed, machine.number])
        signals = record(machine)
        began = time.process_time()
        result = choose(machine, signals, candidates(machine, laws, random, arguments.blind))
        seconds = time.process_time() - began
        known = {each.name: each.value for each in result.metrics}
        left = {law: known[f"{law}: held-out residual"] for law in laws if f"{law}: held-out residual" in known}
        chosen = result.message.split(" ", 1)[0]
        is_right = chosen == machine.law
        right, silent = right + is_right, silent + (chosen == "none")
        texts = ", ".join(f"{law} {ratio:.3g}" for law, ratio in left.items())
        verdict = "right" if is_right else f"WRONG ({chosen})"
        what = f"{machine.number} {machine.law}, {machine.relative_amplitude:.2g} of sliding"
        print(f"{what:36s} {verdict:18s} {texts}; {seconds:.0f} CPU-s", flush=True)
    print(f"\nright: {right} of {count}; 'none fits': {silent}; a wrong law called right: {count - right - silent}")
    return int(count - right > MAX_WRONG_SHARE * count)


if __name__ == "__main__":
    sys.exit(main())
