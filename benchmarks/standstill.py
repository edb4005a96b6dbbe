"""Compare what the proposed method says of standstill with its true error, on machines drawn at random.

    python benchmarks/standstill.py                 60 machines, a minute or two
    python benchmarks/standstill.py --machines 12   a quick look
    python benchmarks/standstill.py --seed 7        other machines

A machine has one of four kinds of friction whose force a record may hide (Coulomb, Stribeck, unequal directions, a
composite with a Coulomb part), rolling elements from 20 nm up, or one of two kinds that the motion shows (rolling from
1 µm up, Dahl). The observer has the machine's own friction model, so that P is known: "error" is the greatest distance
of the response from P in dB over the settled frequencies, "stated" is what the message says. A miss is a sweep that is
called ok and is more than 0.2 dB off with an ideal encoder; a false alarm is one that is called inaccurate and is
within 0.05 dB. With an encoder of 0.1 µm rounding errors count as well, which standstill does not explain: those sweeps
are listed only. The exit code is 1 if there is a miss, or more false alarms than a tenth.
"""

import argparse
import os
import re
import sys
import time
from typing import NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.excitations.stepped_sine import SteppedSine
from fraexp_plugins.friction.composite import Composite
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.modal import Modal

from fraexp.components.kinds import FrictionModel
from fraexp.data.results import Outcome
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics

KINDS = ("coulomb", "stribeck", "unequal", "composite", "narrow", "rolling", "dahl")
HIDING = ("coulomb", "stribeck", "unequal", "composite")
MISS_DB, FALSE_ALARM_DB, MAX_FALSE_ALARMS = 0.2, 0.05, 0.1
POINTS, SETTLING_TIMEOUT_S = 10, 6.0


class Drawn(NamedTuple):
    """A machine drawn at random, and the amplitude of its excitation [N]."""

    kind: str
    machine: Machine
    amplitude: float


def draw(kind: str, rng: np.random.Generator) -> Drawn:
    """Return a machine with this kind of friction: 0.5 to 20 kg, two modes, crossover at 3 to 7 Hz."""
    mass, force, first = 10 ** rng.uniform(-0.3, 1.3), 10 ** rng.uniform(0, 1.5), rng.uniform(15, 60)
    plant = Modal(
        rigid_body_gain=1 / mass,
        frequencies=(first, first * rng.uniform(1.8, 4)),
        damping_ratios=tuple(10 ** rng.uniform(-2, -1, 2)),
        modal_gain_ratios=tuple(rng.uniform(0.05, 0.4, 2)),
    )
    omega = 2 * np.pi * rng.uniform(3, 7)
    controller = Pid(proportional=0.64 * mass * omega**2, derivative_time=2.2 / omega, filter_time=0.25 / omega)
    sample_time = float(rng.choice([2.5e-4, 5e-4, 1e-3]))
    loop = ControlLoop(
        sample_time=sample_time,
        input_dead_time=sample_time * float(rng.choice([0, 1, 1.5, 2.3])),
        resolution=float(rng.choice([0.0, 1e-7])),
    )
    friction = draw_friction(kind, float(force), rng)
    return Drawn(
        kind, Machine(plant, friction, controller, loop, Numerics()), float(force * rng.choice([1.4, 2.0, 4.0]))
    )


def draw_friction(kind: str, force: float, rng: np.random.Generator) -> FrictionModel:
    """Return a friction model of this kind with a greatest force [N]."""
    viscous = float(rng.uniform(0, 10))
    coulomb = Coulomb(coulomb_force=force, viscous_coefficient=viscous)
    if kind == "stribeck":
        velocity = float(10 ** rng.uniform(-3, -2))
        ratio = float(rng.uniform(1.05, 1.5))
        return coulomb.model_copy(update={"static_force": force * ratio, "stribeck_velocity": velocity})
    if kind == "unequal":
        return coulomb.model_copy(update={"negative_ratio": float(rng.uniform(0.6, 1.0))})
    if kind == "composite":
        spring = Rolling(stiffness=(force * 0.7 / 3e-5,), limit_force=(force * 0.7,))
        return Composite(parts=(coulomb.model_copy(update={"coulomb_force": 0.3 * force}), spring))
    if kind in ("narrow", "rolling"):
        deflections = np.geomspace(2e-8 if kind == "narrow" else 1e-6, 1e-4, 7)
        forces = rng.dirichlet(np.ones(7)) * force
        return Rolling(stiffness=tuple(forces / deflections), limit_force=tuple(forces), viscous_coefficient=viscous)
    if kind == "dahl":
        stiffness = force / float(10 ** rng.uniform(-5, -4))
        return Dahl(stiffness=stiffness, coulomb_force=force, viscous_coefficient=viscous)
    return coulomb


class Verdict(NamedTuple):
    """What is said of a machine, and what is true."""

    outcome: Outcome
    error: float
    """Greatest error of the response [dB] over the settled frequencies; NaN if there is none."""
    stated: float
    """Error that the message states [dB]; 0 if it says nothing."""
    cost: float
    """Time of the check over that of experiment and estimate."""


def judge(drawn: Drawn) -> Verdict:
    """Simulate a machine, estimate its plant, and compare."""
    machine, loop = drawn.machine, drawn.machine.loop
    grid = tuple(np.geomspace(2, 0.1 / loop.sample_time, POINTS))
    excitation = SteppedSine(amplitude=drawn.amplitude, frequencies=grid, settling_timeout=SETTLING_TIMEOUT_S)
    begin = time.process_time()
    signals = simulate_loop(machine, excitation, lambda _: None)
    given = {"input_dead_time": loop.input_dead_time, "resolution": loop.resolution}
    estimator = EffectiveInput(friction=machine.friction, **given).resolve_oversampling(signals.segments)
    plain = estimator._estimate_with_model(signals)
    middle = time.process_time()
    found = estimator._check_standstill(signals, plain)
    cost = (time.process_time() - middle) / (middle - begin)
    if found.response is None or not found.response.settled.any():
        return Verdict(found.outcome, np.nan, 0.0, cost)
    settled = found.response.settled
    ratio = found.response.response / machine.plant.response(2 * np.pi * found.response.frequency)
    stated = re.findall(r"off by about ([\d.e+-]+) dB", found.message)
    error = float(np.abs(20 * np.log10(np.abs(ratio[settled]))).max())
    return Verdict(found.outcome, error, float(stated[0]) if stated else 0.0, cost)


def main() -> int:
    """Print a line for each machine, and how many were missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    misses, alarms, costs, counted = 0, 0, [], 0
    print("kind        encoder  amplitude/force  outcome       error dB  stated dB")
    for number in range(arguments.machines):
        drawn = draw(KINDS[number % len(KINDS)], rng)
        verdict = judge(drawn)
        loop, bound = drawn.machine.loop, drawn.machine.friction.force_bound or np.nan
        is_ideal, costs = loop.resolution == 0, [*costs, verdict.cost]
        is_miss = verdict.outcome is Outcome.OK and verdict.error > MISS_DB and (is_ideal or drawn.kind in HIDING)
        is_alarm = verdict.outcome is Outcome.INACCURATE and verdict.error < FALSE_ALARM_DB
        misses, alarms, counted = misses + is_miss, alarms + is_alarm, counted + np.isfinite(verdict.error)
        mark = "  missed" if is_miss else "  false alarm" if is_alarm else ""
        print(
            f"{drawn.kind:10s}  {'ideal ' if is_ideal else '0.1 µm'}   {drawn.amplitude / bound:14.2f}   "
            f"{verdict.outcome.name:13s}{verdict.error:9.3g}{verdict.stated:11.3g}{mark}",
            flush=True,
        )
    print(
        f"{counted} of {arguments.machines} machines with settled frequencies: {misses} missed, {alarms} false alarms"
    )
    print(f"cost of the check over experiment and estimate: median {np.median(costs):.1%}, greatest {max(costs):.1%}")
    return int(misses > 0 or alarms > MAX_FALSE_ALARMS * counted)


if __name__ == "__main__":
    sys.exit(main())
