"""Draw plants in the band of a measured response, and count the unstable loops with the tuned gains.

Stability is judged by the eigenvalues of each sampled loop, which share nothing with the margins: the plant is
discretised by a matrix exponential, the controller is realised by scipy, and friction is a spring and a dashpot with
the describing function's closed form at a random amplitude.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fraexp_plugins.tuning._shared.plant_band import drawn_values, plant_of
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import tf2ss

from fraexp.components.kinds import Controller, Estimator, Excitation, Plant
from fraexp.components.registry import Registry, create
from fraexp.data.results import Fit, Result
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import build_machine

MACHINES = Path(__file__).parents[2] / "studies" / "machines"
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


def spectral_radii(
    machine: TunedMachine, controller: Controller, plants: Sequence[Plant], draws: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the greatest magnitude of a pole of each sampled loop, friction being a spring and a dashpot.

    `draws` has a factor on the plant's gain, a spring [N/m] and a dashpot [N s/m] for each plant, shape (plants, 3).
    """
    a, b = [], []
    for plant, (factor, spring, damping) in zip(plants, draws.tolist(), strict=True):
        free = plant.state_space()
        column, row = factor * free.b[:, None], free.c[None, :]
        a.append(free.a - column @ (spring * row + damping * (row @ free.a)))
        b.append(column)
    count, n = len(plants), len(free.b)
    block = np.zeros((count, n + 1, n + 1))
    block[:, :n, :n], block[:, :n, n:] = a, b
    sampled = expm(block * machine.sample_time)
    numerator, denominator = controller.transfer_function(machine.sample_time)
    size = max(numerator.size, denominator.size)
    ac, bc, cc, dc = tf2ss(*(np.pad(each, (0, size - each.size)) for each in (numerator, denominator)))
    m, position = ac.shape[0], np.array([plant.state_space().c for plant in plants])[:, None, :]
    loop = np.zeros((count, n + m + DEAD_SAMPLES, n + m + DEAD_SAMPLES))  # plant, controller, thrusts on their way
    loop[:, :n, :n], loop[:, :n, n + m + DEAD_SAMPLES - 1 :] = sampled[:, :n, :n], sampled[:, :n, n:]
    loop[:, n : n + m, :n], loop[:, n : n + m, n : n + m] = -bc @ position, ac
    loop[:, n + m : n + m + 1, :n], loop[:, n + m, n : n + m] = -dc * position, cc[0]
    loop[:, n + m + 1, n + m] = 1.0
    return np.asarray(np.abs(np.linalg.eigvals(loop)).max(axis=1))


def unstable_loops(machine: TunedMachine, controller: Controller, draws: int, seed: int = 0) -> tuple[int, float]:
    """Return the number of unstable loops among plants drawn in the band, and the greatest pole of all.

    With an odd seed all plants lie on the surface of the band's ellipsoid.
    """
    rng = np.random.default_rng(seed)
    fit: Fit = next(fit for fit in machine.result.fits if fit.kind == "plant")
    plants = [plant_of(fit, values)[0] for values in drawn_values(fit, draws, rng, bool(seed % 2))]
    friction = np.array([describing_function(machine, 10**exponent) for exponent in rng.uniform(-8, -2, draws)])
    omega = 2 * np.pi * 10 ** rng.uniform(0, 2, draws)
    factor = 1 + machine.model_error * rng.uniform(-1, 1, draws)
    drawn = np.column_stack([factor, friction.real, machine.viscous + friction.imag / omega])
    radii = spectral_radii(machine, controller, plants, drawn)
    return int(np.sum(radii >= 1.0)), float(radii.max())
