"""Machines drawn at random, each in fraexp's description and in that of the fine simulation (`reference_loop`)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from paper_machine import REGISTRY
from reference_laws import BRISTLE, COULOMB, ELEMENTS, FORCE_SLIDERS, GMS, NONE
from reference_loop import FINE_CLOCK, ReferenceMachine, is_stable

from fraexp.components.kinds import Controller, FrictionModel, Plant
from fraexp.components.registry import create

POINTS = 6
TOLERANCE = 1e-4
"""`numerics.tolerance`, as it is by default."""
LAWS = (
    "rolling", "rolling, D_i", "lugre", "rolling_force_slider", "gms", "elastoplastic", "dahl", "coulomb",
    "rolling", "rolling_force_slider, D_i",
)  # fmt: skip
"""Kinds of friction, in turn; every twentieth machine has none."""
SAMPLE_TIMES = (1e-4, 1.25e-4, 2e-4, 2.5e-4, 4e-4, 5e-4, 8e-4, 1e-3)
"""Sample times that are drawn from [s]."""


@dataclass(frozen=True)
class DrawnMachine:
    """One machine in both descriptions, and its experiment."""

    number: int
    law: str
    friction: dict[str, Any]
    reference: ReferenceMachine
    amplitude: float
    """Amplitude [N]."""
    relative_amplitude: float
    """Amplitude over the force at which the machine slides."""
    frequencies: tuple[float, ...]

    def sections(self) -> dict[str, Any]:
        """Return the experiment as a study would state it."""
        own, (kp, ti, td, tf) = self.reference, self.reference.pid
        frequencies, ratios, gains = zip(*own.modes, strict=True) if own.modes else ((), (), ())
        plant = {
            "name": "modal", "rigid_body_gain": own.gain, "frequencies": frequencies, "damping_ratios": ratios,
            "modal_gain_ratios": gains,
        }  # fmt: skip
        pid = {"name": "pid", "proportional": kp, "integral_time": ti, "derivative_time": td, "filter_time": tf}
        return {
            "source": "loop",
            "plant": create(REGISTRY, Plant, plant).spec(),
            "friction": create(REGISTRY, FrictionModel, self.friction).spec(),
            "controller": create(REGISTRY, Controller, pid).spec(),
            "loop": {"sample_time": own.sample_time, "divergence_limit": 100.0, **self.delays()},
            "numerics": {"tolerance": TOLERANCE},
            "excitation": {"name": "stepped_sine", "amplitude": self.amplitude, "frequencies": self.frequencies},
        }

    def delays(self) -> dict[str, Any]:
        """Return dead times and lags of the loop."""
        step = self.reference.sample_time / FINE_CLOCK
        (dead_in, dead_out), (lags_in, lags_out) = self.reference.dead_times, self.reference.lags
        return {
            "input_dead_time": dead_in * step, "input_time_constants": lags_in,
            "output_dead_time": dead_out * step, "output_time_constants": lags_out,
        }  # fmt: skip


def drawn_machine(number: int, seed: int, law: str = "", sample_times: Sequence[float] = SAMPLE_TIMES) -> DrawnMachine:
    """Return a machine that a PID controller stabilises, stuck and sliding: the first one of those drawn.

    Its law is the one that is given, or the next one in turn.
    """
    draws = (np.random.default_rng([seed, number, attempt]) for attempt in range(100))
    attempts = (stable_machine_or_none(number, random, law, sample_times) for random in draws)
    return next(machine for machine in attempts if machine)


def stable_machine_or_none(
    number: int, random: np.random.Generator, law: str, sample_times: Sequence[float]
) -> DrawnMachine | None:
    """Return a machine, or None if no controller that is tried stabilises it."""
    law = law or ("none" if number % 20 == 19 else LAWS[number % len(LAWS)])
    mass = _log(random, 0.5, 30)
    modes = _modes(random)
    sample_time = float(random.choice(sample_times))
    dead_times = (int(random.integers(0, 3 * FINE_CLOCK)), int(random.integers(0, 2 * FINE_CLOCK)))
    lags = tuple(
        tuple(_log(random, 0.1, 1.0) * sample_time for _ in range(random.integers(0, most))) for most in (3, 2)
    )
    damping_ratio = _log(random, 0.005, 0.1)
    force, width = _log(random, 1, 40), _log(random, 4e-6, 120e-6)
    friction, kind, parameters, states, stiffness = _friction(random, law, force, width, mass)
    viscous = friction["viscous_coefficient"] = 2 * damping_ratio * mass * max(np.sqrt(stiffness / mass), 30.0)
    relative_amplitude = _log(random, 0.3, 8)
    highest = min(200.0, 0.12 / sample_time)
    grid = np.geomspace(_log(random, 1.5, 4), highest * random.uniform(0.6, 1), POINTS)
    machine = ReferenceMachine(
        1 / mass, modes, viscous, kind, parameters, states, (0, 0, 0, 0), sample_time, dead_times, (lags[0], lags[1])
    )
    controlled = _with_controller(machine, random, stiffness)
    if controlled is None:
        return None
    frequencies = tuple(float(f) for f in grid)
    return DrawnMachine(number, law, friction, controlled, force * relative_amplitude, relative_amplitude, frequencies)


def _log(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _modes(random: np.random.Generator) -> tuple[tuple[float, float, float], ...]:
    """Return up to two modes, of either sign; together they leave the table's compliance positive."""
    count, modes, sum_of_gains = int(random.integers(0, 3)), [], 1.0
    for low, high in ((18, 60), (70, 250))[:count]:
        gain = _log(random, 0.05, 0.6) * (1 if random.random() < 0.6 else -1)
        gain = gain if sum_of_gains + gain > 0.3 else -gain
        sum_of_gains += gain
        damping = _log(random, 0.01, 0.3) if gain > 0 else _log(random, 0.1, 0.4)
        modes.append((_log(random, low, high), damping, gain))
    return tuple(modes)


def _with_controller(
    machine: ReferenceMachine, random: np.random.Generator, stiffness: float
) -> ReferenceMachine | None:
    """Return the machine with a PID controller whose loop is stable: free, and held by a share of the stiffness.

    The controller is slowed down until it is; None if that does not help.
    """
    lags = sum(machine.lags[0]) + sum(machine.lags[1])
    late = (sum(machine.dead_times) / FINE_CLOCK + 1) * machine.sample_time + lags
    crossover = min(_log(random, 2, 12), 0.04 / late, *(mode[0] / 3 for mode in machine.modes))
    integral, filtered = (12.0 if random.random() < 0.5 else 0.0), random.uniform(5, 10)
    for _ in range(6):
        omega = 2 * np.pi * crossover
        td = 2.5 / omega
        shape = 1 + 1j * omega * td / (1j * omega * td / filtered + 1)
        kp = 1 / abs(machine.plant(np.array([crossover]))[0] * shape)
        found = replace(machine, pid=(float(kp), integral / omega, td, td / filtered))
        if all(is_stable(found, share * stiffness) for share in (1, 0, 0.003, 0.03, 0.1, 0.3)):
            return found
        crossover *= 0.7
    return None


Drawn = tuple[dict[str, Any], int, tuple[float, ...], int, float]
"""Friction as fraexp takes it; kind, parameters and number of states of the reference's law; greatest stiffness."""


def _friction(random: np.random.Generator, law: str, force: float, width: float, mass: float) -> Drawn:
    """Return friction of a force [N] and a presliding distance [m] in both descriptions."""
    name = law.split(",", maxsplit=1)[0]
    if name == "none":
        return {"name": "none"}, NONE, (), 0, 0.0
    if name in ("rolling", "rolling_force_slider"):
        return _elements(random, name, force, width, mass, "D_i" in law)
    if name == "coulomb":
        static, velocity = force * random.choice([1.0, 1.25]), _log(random, 5e-4, 5e-3)
        spec = {"name": name, "coulomb_force": force, "static_force": static, "stribeck_velocity": velocity}
        return spec, COULOMB, (force, static, velocity, 2.0), 0, 0.0
    if name == "dahl":
        return {"name": name, "stiffness": force / width, "coulomb_force": force}, BRISTLE, (
            force / width, 0.0, force, force, 1.0, 0.0), 1, 2 * force / width  # fmt: skip
    static, velocity = force * random.uniform(1, 1.4), _log(random, 5e-4, 5e-3)
    curve = {"coulomb_force": force, "static_force": static, "stribeck_velocity": velocity}
    if name == "gms":
        return _gms(random, force, width, curve)
    damping = 2 * _log(random, 0.01, 0.3) * np.sqrt(force / width * mass)
    spec = {"name": name, "bristle_stiffness": force / width, "bristle_damping": damping, **curve}
    elastic = 0.0
    if name == "elastoplastic":
        spec["elastic_limit_ratio"] = random.uniform(0.4, 0.9)
        elastic = spec["elastic_limit_ratio"] * width
    return spec, BRISTLE, (force / width, damping, force, static, velocity, elastic), 1, 2 * force / width


def _element_widths(random: np.random.Generator, width: float) -> NDArray[np.float64]:
    return np.sort(width * np.exp(random.uniform(np.log(0.02), np.log(2.0), random.integers(2, 31))))


def _elements(
    random: np.random.Generator, name: str, force: float, width: float, mass: float, is_damped: bool
) -> Drawn:
    """Return 2 to 30 elements of random widths, each with a random share of the force; their damping is random too."""
    widths = _element_widths(random, width)
    shares = random.uniform(0.3, 1, widths.size) * np.sqrt(widths / width)
    limits = force * shares / shares.sum()
    stiffness = limits / widths
    relaxation = 2 * _log(random, 0.01, 0.3) * np.sqrt(mass / stiffness.sum())  # D/K [s]
    damping = stiffness * relaxation * random.uniform(0.5, 2, widths.size) * is_damped
    spec = {"name": name, "stiffness": tuple(stiffness.tolist()), "limit_force": tuple(limits.tolist())}
    if is_damped:
        spec["damping"] = tuple(damping.tolist())
    kind = FORCE_SLIDERS if name == "rolling_force_slider" else ELEMENTS
    parameters = np.column_stack([stiffness, damping, widths]).ravel()
    return spec, kind, tuple(parameters.tolist()), widths.size, float(stiffness.sum())


def _gms(random: np.random.Generator, force: float, width: float, curve: dict[str, float]) -> Drawn:
    widths = _element_widths(random, width)[:12]
    fractions = random.uniform(0.3, 1, widths.size)
    fractions /= fractions.sum()
    stiffness, rate = fractions * force / widths, force * _log(random, 10, 100)
    spec = {
        "name": "gms", "stiffness": tuple(stiffness.tolist()), "force_fractions": tuple(fractions.tolist()),
        "attraction_rate": rate, **curve,
    }  # fmt: skip
    parameters = (*curve.values(), 2.0, rate, *np.column_stack([stiffness, fractions]).ravel().tolist())
    return spec, GMS, parameters, 2 * widths.size, float(stiffness.sum())
