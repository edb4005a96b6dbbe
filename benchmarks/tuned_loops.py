"""Draw plants in the band of a measured response, and count the unstable loops with the tuned gains.

Stability is judged by the eigenvalues of each sampled loop, which share nothing with the margins: the plant is
discretised by scipy, the controller is realised by scipy, and friction is a spring and a dashpot with the describing
function's closed form at a random amplitude.
"""

import argparse
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fraexp_plugins.tuning._shared.plant_band import drawn_values, plant_of
from numpy.typing import NDArray
from scipy.signal import cont2discrete, tf2ss

from fraexp.components.kinds import Controller, Estimator, Excitation
from fraexp.components.registry import Registry, create, discover
from fraexp.data.results import Fit, Result
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import build_machine

MACHINES = Path(__file__).parents[1] / "studies" / "machines"
DEAD_SAMPLES = 2


@dataclass(frozen=True)
class TunedMachine:
    """A machine that was measured with noise, and the gains that are proposed for it."""

    result: Result
    controller: Controller
    given: Controller
    model_error: float
    elements: tuple[NDArray[np.float64], NDArray[np.float64]]
    """K_i [N/m] and Y_i [m] of its friction."""
    viscous: float
    sample_time: float


def tune(registry: Registry, machine: str, noise: float, model_error: float, **settings: object) -> TunedMachine:
    """Measure a machine by a stepped sine with an encoder that is noisy [m], and tune its feedback."""
    sections = tomllib.loads((MACHINES / f"{machine}.toml").read_text("utf-8"))
    names = ("plant", "friction", "controller")
    experiment: dict[str, Any] = {name: sections[name] for name in names}
    experiment |= {"loop": {**sections["loop"], "noise": noise, "seed": 4}, "numerics": {}}
    excitation = {"name": "stepped_sine", "amplitude": 40, "points": 40, "recorded_periods": 4, "min_frequency": 8}
    build = build_machine(experiment, registry)
    signals = simulate_loop(build, registry.create(Excitation.kind, excitation, experiment), lambda _: None)  # type: ignore[arg-type]
    method = {"name": "modal_fit", "modes": 2, "method": {"name": "effective_input"}}
    tuning = {"name": "loop_tuning", "method": method, "model_error": model_error, **settings}
    estimator = registry.create(Estimator.kind, tuning, experiment)
    assert isinstance(estimator, Estimator)
    result = estimator.estimate(signals)
    fit = next(fit for fit in result.fits if fit.kind == Controller.kind)
    friction: Any = build.friction
    elements = (np.array(friction.elements[0]), np.array(friction.elements[1]) / np.array(friction.elements[0]))
    return TunedMachine(
        result,
        create(registry, Controller, fit.component),
        build.controller,
        model_error,
        elements,
        friction.viscous,
        build.loop.sample_time,
    )


def describing_function(machine: TunedMachine, amplitude: float) -> complex:
    """Return N(A) [N/m] of springs that slip, in closed form (C. Bouc's and W. D. Iwan's stop operator, 1966)."""
    stiffness, slip = machine.elements
    theta = np.arccos(np.clip(1 - 2 * slip / amplitude, -1.0, 1.0))
    return complex(np.sum(stiffness / np.pi * (theta - 0.5 * np.sin(2 * theta) + 1j * np.sin(theta) ** 2)))


def spectral_radius(
    machine: TunedMachine, controller: Controller, plant: Any, factor: float, spring: float, damping: float
) -> float:
    """Return the greatest magnitude of a pole of the sampled loop, friction being a spring and a dashpot."""
    free = plant.state_space()
    a, b, c = free.a, factor * free.b[:, None], free.c[None, :]
    a = a - b @ (spring * c + damping * (c @ free.a))
    ad, bd, cd, _, _ = cont2discrete((a, b, c, np.zeros((1, 1))), machine.sample_time)
    numerator, denominator = controller.transfer_function(machine.sample_time)
    size = max(numerator.size, denominator.size)
    ac, bc, cc, dc = tf2ss(
        np.pad(numerator, (0, size - numerator.size)), np.pad(denominator, (0, size - denominator.size))
    )
    n, m = ad.shape[0], ac.shape[0]
    loop = np.zeros((n + m + DEAD_SAMPLES, n + m + DEAD_SAMPLES))  # plant, controller, thrusts on their way
    loop[:n, :n], loop[:n, n + m + DEAD_SAMPLES - 1 :] = ad, bd
    loop[n : n + m, :n], loop[n : n + m, n : n + m] = -bc @ cd, ac
    loop[n + m, :n], loop[n + m, n : n + m] = -dc @ cd, cc
    loop[n + m + 1, n + m] = 1.0
    return float(np.abs(np.linalg.eigvals(loop)).max())


def unstable_loops(machine: TunedMachine, controller: Controller, draws: int, seed: int = 0) -> tuple[int, float]:
    """Return the number of unstable loops among plants drawn in the band, and the greatest pole of all."""
    rng = np.random.default_rng(seed)
    fit: Fit = next(fit for fit in machine.result.fits if fit.kind == "plant")
    count, worst = 0, 0.0
    for values in drawn_values(fit, draws, rng, bool(seed % 2)):
        plant, _ = plant_of(fit, values)
        factor = 1 + machine.model_error * rng.uniform(-1, 1)
        friction = describing_function(machine, 10 ** rng.uniform(-8, -2))
        omega = 2 * np.pi * 10 ** rng.uniform(0, 2)
        damping = machine.viscous + friction.imag / omega
        radius = spectral_radius(machine, controller, plant, factor, friction.real, damping)
        count += radius >= 1.0
        worst = max(worst, radius)
    return count, worst


def main() -> None:
    """Print the number of unstable loops for several bands, with the tuned gains and with thrice the gain margin."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=10_000)
    arguments = parser.parse_args()
    registry = discover()
    print("machine                     integral  noise     model error  Kp [N/m]  unstable  greatest pole")
    for name in ("linear_motor_table", "linear_motor_table_integral"):
        for noise, model_error, integral in ((0.1e-6, 0.02, True), (3e-6, 0.02, False), (3e-6, 0.02, True)):
            machine = tune(registry, name, noise, model_error, integral_action=integral)
            count, worst = unstable_loops(machine, machine.controller, arguments.draws)
            gain = machine.controller.model_dump()["proportional"]
            print(
                f"{name:27} {integral!s:9} {noise * 1e6:.1f} µm    {model_error:11.2f} {gain:9.0f} "
                f"{count:5} of {arguments.draws} {worst:.6f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
