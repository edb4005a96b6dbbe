"""Measure what maximum likelihood finds of the friction of machines and laws drawn at random.

    python benchmarks/law_selection.py                        all parts
    python benchmarks/law_selection.py chosen --all-laws      GMS and elastoplastic friction, too
    python benchmarks/law_selection.py chosen --blind         from guesses
    python benchmarks/law_selection.py coulomb --seed 7 --machines 40

Records of 16 sines, one period each, are simulated with an encoder of 0.1 µm. The amplitude is 1.3 to 4 times the force
at which the machine slides. The machine's law starts with a force and deflections wrong by up to 30 %, damping,
Stribeck velocity and attraction by up to 50 %, and the viscous coefficient by up to a factor of 2; with `--blind` these
and the static force are guesses that know nothing of the machine. Elements have the machine's proportions. The dead
time is given.

chosen        `maximum_likelihood` with every law to choose from: it must choose the machine's in 19 of 20
slow-sliding  LuGre machines whose Stribeck velocity is 1.25 times the largest of their records, so that Coulomb force
              and Stribeck velocity are extrapolated: nine of ten 95 % intervals of what is called right must hold
coulomb       The Coulomb force from sines at 20 frequencies and two amplitudes, 4 periods, 30 nm of noise, by
              `plant_and_friction`, which is given nothing, and by maximum likelihood, which is given the law (or
              nothing, with `--blind`): a force that is called right must be within 1 %
"""

import time
from dataclasses import replace
from typing import Any

import numpy as np
from drawn_machines import DrawnMachine, drawn_machine
from harness import Bench, run
from maximum_likelihood import scaled_model
from paper_machine import NOISE_M, REGISTRY, RESOLUTION_M, is_sure, machine_of, metrics_of, simulated

from fraexp.components.kinds import Estimator
from fraexp.components.registry import create
from fraexp.data.results import Outcome, Result
from fraexp.data.signals import Signals
from fraexp.errors import RecordError

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
SLOW_RATIO, MIN_STATIC_RATIO = 1.25, 1.1
"""Of slow machines: Stribeck velocity over the largest velocity, and least static over Coulomb force."""
SLOW_NAMES = ("coulomb_force", "static_force", "stribeck_velocity", "viscous_coefficient", "bristle_stiffness")
TWO_AMPLITUDES = (1.3, 2.6)
MAX_FORCE_ERROR = 0.01
"""Relative error of a Coulomb force that is called right."""


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


def record(machine: DrawnMachine, *excitations: dict[str, Any], points: int = POINTS, noise: float = 0.0) -> Signals:
    """Return what an encoder records of a machine: one sine of each frequency, or as each excitation says."""
    simulation = machine_of(machine.sections(), resolution=RESOLUTION_M, noise=noise)
    highest = min(200.0, MAX_FREQUENCY_RATIO / machine.reference.sample_time)
    frequencies = np.geomspace(MIN_FREQUENCY_HZ, highest, points).tolist()
    sine = {"name": "stepped_sine", "amplitude": machine.amplitude, "frequencies": frequencies}
    parts = [{**sine, **excitation} for excitation in excitations]
    return simulated(simulation, {"name": "concatenated", "parts": parts} if parts else sine)


def choose(machine: DrawnMachine, signals: Signals, models: Any, noise: float = 0.0) -> Result:
    """Return the comparison of laws on the records of a machine."""
    spec = {"name": "maximum_likelihood", "starts": models, "resolution": RESOLUTION_M, "noise": noise}
    return create(REGISTRY, Estimator, {**spec, **machine.delays()}).estimate(signals)


def chosen(bench: Bench) -> None:
    """Chosen law, and the held-out residuals of all."""
    laws, right, silent = LAWS + SLOW_LAWS if bench.options.all_laws else LAWS, 0, 0
    drawn = machines(bench.options.machines, laws, bench.seed)
    for machine in drawn:
        signals, began = record(machine), time.process_time()
        models = candidates(machine, laws, bench.generator(machine.number), bench.options.blind)
        result = choose(machine, signals, models)
        seconds, known, law = time.process_time() - began, metrics_of(result), result.findings[0].place or "none"
        right, silent = right + (law == machine.law), silent + (law == "none")
        left = {law: known[f"{law}: held-out residual"] for law in laws if f"{law}: held-out residual" in known}
        texts = ", ".join(f"{law} {ratio:.3g}" for law, ratio in left.items())
        what = f"{machine.number} {machine.law}, {machine.relative_amplitude:.2g} of sliding"
        bench.row(what, f"{'right' if law == machine.law else f'wrong ({law})'}: {texts}; {seconds:.0f} CPU-s")
    wrong = len(drawn) - right
    print(f"right: {right} of {len(drawn)}; 'none fits': {silent}; a wrong law called right: {wrong - silent}")
    bench.bounded("machines whose law is not chosen", wrong, MAX_WRONG_SHARE * len(drawn))


def slow_machine(machine: DrawnMachine) -> DrawnMachine:
    """Return a machine whose Stribeck velocity is above all velocities of its records."""
    own = {**machine.friction}
    own["static_force"] = max(own["static_force"], MIN_STATIC_RATIO * own["coulomb_force"])
    speed = max(
        float(np.abs(np.gradient(segment.channels["displacement"].ravel(), segment.sample_time)).max())
        for segment in record(replace(machine, friction=own)).segments
    )
    return replace(machine, friction={**own, "stribeck_velocity": SLOW_RATIO * speed})


def slow_sliding(bench: Bench) -> None:
    """Errors over the half-width of the 95 % interval, and that half-width over the value."""
    missed = judged = 0
    for drawn in machines(max(bench.options.machines // 2, 1), ("lugre",), bench.seed):
        machine = slow_machine(drawn)
        start = candidates(machine, ("lugre",), bench.generator(machine.number), is_blind=False)
        result = choose(machine, record(machine), start)
        fit, texts = next(fit for fit in result.fits if fit.kind == "friction"), []
        for name in SLOW_NAMES:
            place = fit.parameters.index(name)
            value, half_width = float(fit.values[place]), 1.96 * float(np.sqrt(fit.covariance[place, place]))
            ratio = (value - float(machine.friction[name])) / half_width
            texts.append(f"{name} {ratio:+.2f} (± {100 * half_width / value:.2g} %)")
            if result.outcome is Outcome.OK:
                judged, missed = judged + 1, missed + (abs(ratio) > 1)
        bench.row(f"{machine.number} {result.outcome.value or 'ok'}", ", ".join(texts))
    bench.bounded(f"intervals of {judged} that miss the true value", missed, 0.1 * judged)


def coulomb(bench: Bench) -> None:
    """Error of the Coulomb force, and half the width of its 95 % interval."""
    count = max(bench.options.machines // 3, 1)
    pool = {law: machines(-(-count // len(LAWS)), (law,), bench.seed) for law in LAWS}
    for place in range(count):
        machine = pool[LAWS[place % len(LAWS)]][place // len(LAWS)]
        sliding, own = machine.amplitude / machine.relative_amplitude, machine.friction
        true = float(own["coulomb_force"] if "coulomb_force" in own else sum(own["limit_force"]))
        levels = [{"amplitude": ratio * sliding, "recorded_periods": 4} for ratio in TWO_AMPLITUDES]
        signals = record(machine, *levels, points=20, noise=NOISE_M)
        scale = {"resolution": RESOLUTION_M, "noise": NOISE_M, **machine.delays()}
        models = candidates(machine, (machine.law,), bench.generator(machine.number), is_blind=False)
        methods = {
            "two amplitudes": lambda scale=scale, signals=signals: create(
                REGISTRY, Estimator, {"name": "plant_and_friction", **scale}
            ).estimate(signals),
            "maximum likelihood": lambda machine=machine, signals=signals, models=models: choose(
                machine, signals, () if bench.options.blind else models, NOISE_M
            ),
        }
        for name, estimate in methods.items():
            began = time.process_time()
            try:
                found = estimate()
                known, sure = metrics_of(found), is_sure(found)
            except RecordError:
                known, sure = {}, False
            error = known.get("Coulomb force", np.nan) / true - 1
            half_width = known.get("Coulomb force, 95 %", np.nan) / true
            text = f"{error:+.1e} ± {half_width:.1e}  {'right' if sure else 'not sure'}"
            text += f"; {time.process_time() - began:.0f} CPU-s"
            is_met = not sure or abs(error) <= MAX_FORCE_ERROR
            bench.row(f"{machine.number} {machine.law}, {true:.4g} N, {name}", text, is_met, error=float(error))


if __name__ == "__main__":
    run(__doc__, chosen, slow_sliding, coulomb, machines=(20, 4), all_laws=False, blind=False)
