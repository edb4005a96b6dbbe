"""Measure what `maximum_likelihood` finds, and print a table for each question.

    python benchmarks/maximum_likelihood.py                     all questions
    python benchmarks/maximum_likelihood.py accuracy starts     these
    python benchmarks/maximum_likelihood.py --reduced           fewer points, starts, machines and seeds
    python benchmarks/maximum_likelihood.py coverage --first-seed 9000    seeds of the noise from there on

accuracy     paper's machine at 12 N, 0.1 µm: error of P̂ at 100 frequencies, of one period and of 8 with 30 nm of noise
starts       the same at 30 frequencies from ΣF_m and Y_m wrong by every pair of factors
laws         each law seen by each law: which of them fit
strangers    records of an independent fine simulation (`reference_loop`) of machines drawn at random, friction's scales
             drawn too
times        CPU time of the fit alone: 100 frequencies, and 20 with four parameters of friction and dead time free
coverage     how often the band (ellipse, magnitude, phase) covers P at 16 frequencies, and the intervals of the scales
             their values; the error over the bound that the information sets. The records are simulated with 60 steps
             per sample: with the 7 that are chosen, their own error is as large as that by noise from 12 Hz on, and the
             band contains both. The fit to the first record is where the others start
agreement    how often responses at 12 and 75 N agree within the bands of both

The exit code is 1 if a bound is missed.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from calibrate_machine import MACHINE, sections_of
from drawn_machines import DrawnMachine, drawn_machine
from fraexp_plugins.identification.whole_record._shared.fit_report import FitReport
from fraexp_plugins.identification.whole_record.maximum_likelihood import MaximumLikelihood
from reference_loop import FINE_CLOCK, ReferenceRun

from fraexp.analysis.confidence import circle_factor, confidence_limits
from fraexp.components.kinds import Controller, Estimator, Excitation, FrictionModel, Plant
from fraexp.components.registry import create, discover
from fraexp.data.results import Outcome, Result
from fraexp.data.signals import Segment, Signals
from fraexp.execution.job import Job, run_job
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics

REGISTRY = discover()
PAPER = sections_of(MACHINE)
CURVE = PAPER["friction"]["curve"]
RESOLUTION_M, NOISE_M, PERIODS = 1e-7, 3e-8, 8
FACTORS = (0.5, 0.8, 0.9, 1.1, 1.2, 2.0)
"""Factors by which ΣF_m and Y_m are wrong at the start."""
FINE_STEPS = 4 * FINE_CLOCK
"""Steps per sample of the independent simulation."""
FORCE_N, STIFFNESS_N_M = CURVE["coulomb_force"], 1.5e5
STRIBECK = {"coulomb_force": FORCE_N, "static_force": 1.2 * FORCE_N, "stribeck_velocity": 5e-3}
LAWS: dict[str, dict[str, Any]] = {
    "rolling": PAPER["friction"],
    "dahl": {"name": "dahl", "stiffness": STIFFNESS_N_M, "coulomb_force": FORCE_N, "viscous_coefficient": 10.0},
    "lugre": {
        "name": "lugre", "bristle_stiffness": STIFFNESS_N_M, "bristle_damping": 50.0, "viscous_coefficient": 10.0,
        **STRIBECK,
    },
    "elastoplastic": {
        "name": "elastoplastic", "bristle_stiffness": STIFFNESS_N_M, "bristle_damping": 50.0,
        "viscous_coefficient": 10.0, **STRIBECK,
    },
    "gms": {
        "name": "gms", "stiffness": [2e5, 1e5, 5e4], "force_fractions": [0.3, 0.3, 0.4], "attraction_rate": 500.0,
        "viscous_coefficient": 10.0, **STRIBECK,
    },
}  # fmt: skip
STRANGERS = ("rolling", "rolling, D_i", "lugre", "dahl", "gms", "elastoplastic")
"""Laws of the drawn machines; those whose force is not a function of motion and state alone are left out."""


REPORTED_SEEDS = 20
"""Seeds after which the coverage so far is printed."""
COVERAGE_STEPS = 60
"""Steps per sample of the records whose bands are counted."""
COVERED_HZ = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 16.0, 22.0, 30.0, 40.0, 50.0, 65.0, 80.0, 120.0, 170.0)


class Table:
    """Rows of figures with their bounds, printed as they come."""

    def __init__(self) -> None:
        self.missed = 0

    def row(self, what: str, figure: str, is_met: bool = True) -> None:
        """Print a figure, and whether its bound is met."""
        self.missed += not is_met
        print(f"{what:58s} {figure}{'' if is_met else '   MISSED'}", flush=True)


def scaled_paper(force: float, displacement: float) -> dict[str, Any]:
    """Return the paper's friction with ΣF_m and Y_m wrong by these factors."""
    widths = {key: CURVE[key] * displacement for key in ("characteristic_displacement", "min_knot", "max_knot")}
    return {**PAPER["friction"], "curve": {**CURVE, **widths, "coulomb_force": FORCE_N * force}}


def estimated(
    points: int,
    model: Mapping[str, Any] | None = None,
    *,
    friction: Mapping[str, Any] = PAPER["friction"],
    amplitude: float = 12.0,
    noise: float = 0.0,
) -> tuple[Result, np.ndarray]:
    """Return the result on the paper's machine, and P̂/P."""
    loop = {**PAPER["loop"], "resolution": RESOLUTION_M, "noise": noise}
    excitation = {
        "name": "stepped_sine", "amplitude": amplitude, "recorded_periods": PERIODS if noise else 1,
        "frequencies": np.geomspace(1, 200, points).tolist(),
    }  # fmt: skip
    experiment = {
        **PAPER,
        "source": "loop",
        "friction": friction,
        "loop": loop,
        "excitation": excitation,
        "numerics": {},
    }
    spec = {
        "name": "maximum_likelihood", "friction": model or friction, "resolution": RESOLUTION_M, "noise": noise,
        "input_dead_time": loop.get("input_dead_time", 0.0), "output_dead_time": loop.get("output_dead_time", 0.0),
    }  # fmt: skip
    (result,) = run_job(Job(experiment, (spec,)), lambda _: None)
    if not isinstance(result, Result) or result.response is None:
        raise SystemExit(result.message)
    plant = create(REGISTRY, Plant, PAPER["plant"]).response(2 * np.pi * result.response.frequency)
    return result, result.response.response / plant


def errors_text(ratio: np.ndarray) -> tuple[float, float, str]:
    """Return the greatest error in dB and in degrees, and both as text."""
    magnitude, phase = np.abs(20 * np.log10(np.abs(ratio))).max(), np.degrees(np.abs(np.angle(ratio))).max()
    return magnitude, phase, f"{magnitude:.4f} dB {phase:.3f} deg"


def bound_text(result: Result, ratio: np.ndarray) -> str:
    """Return where the greatest error is, and the standard deviation that the information in the samples allows."""
    response = result.response
    assert response is not None
    worst = int(np.argmax(np.abs(np.log(ratio))))
    bound = response.standard_deviation[worst] / np.abs(response.response[worst])
    decibel, degree = 20 * np.log10(np.e) * bound / np.sqrt(2), np.degrees(bound) / np.sqrt(2)
    return f"bound at {response.frequency[worst]:.3g} Hz, one standard deviation: {decibel:.4f} dB {degree:.3f} deg"


def scales_of(result: Result) -> np.ndarray:
    """Return the scales of force and deflection; NaN for one that was held."""
    known = {each.name: each.value for each in result.metrics}
    return np.array([known.get("force_scale", np.nan), known.get("displacement_scale", np.nan)])


def metric(result: Result, name: str) -> float:
    """Return one number of a result."""
    return next(each.value for each in result.metrics if each.name == name)


def accuracy(table: Table, reduced: bool) -> None:
    """Print the greatest errors from 1 to 200 Hz."""
    for amplitude, noise, bounds in ((12.0, 0.0, (0.1, 1.0)), (12.0, NOISE_M, (0.05, 1.5)), (75.0, 0.0, (0.1, 1.0))):
        points, began = (30 if reduced or noise else 100), time.process_time()
        result, ratio = estimated(points, amplitude=amplitude, noise=noise)
        seconds = time.process_time() - began
        magnitude, phase, text = errors_text(ratio)
        is_met = magnitude <= bounds[0] and phase <= bounds[1] and result.outcome is Outcome.OK
        what = f"{amplitude:g} N, {points} frequencies, {noise * 1e9:g} nm of noise"
        text += f", from 1.5 Hz {errors_text(ratio[result.response.frequency >= 1.5])[2]}"  # type: ignore[union-attr]
        table.row(what, f"{text}, {seconds:.1f} CPU-s", is_met)
        table.row("", bound_text(result, ratio))


def starts(table: Table, reduced: bool) -> None:
    """Print the errors and the scales from wrong starts."""
    pairs = list(product(FACTORS, FACTORS))
    for force, displacement in pairs[::5] if reduced else pairs:
        result, ratio = estimated(30, scaled_paper(force, displacement))
        magnitude, phase, text = errors_text(ratio[result.response.frequency >= 1.5])  # type: ignore[union-attr]
        scales = scales_of(result) * [force, displacement] - 1
        is_right = magnitude <= 0.1 and phase <= 1 and np.abs(scales).max() <= 5e-4
        figure = f"{text}, scales {scales[0]:+.1e} {scales[1]:+.1e}, {result.outcome.name}"
        table.row(f"ΣF_m × {force:g}, Y_m × {displacement:g}", figure, is_right)


def laws(table: Table, reduced: bool) -> None:
    """Print which law fits which."""
    names = list(LAWS)[:3] if reduced else list(LAWS)
    for true, model in product(names, names):
        result, ratio = estimated(20, LAWS[model], friction=LAWS[true])
        is_right = ("the model does not fit" in result.message) == (true != model)
        figure = f"{result.outcome.name}, residual {metric(result, 'residual over expectation'):.4g}, "
        table.row(f"{true} seen by {model}", figure + errors_text(ratio)[2], is_right)


def stranger_signals(machine: DrawnMachine, resolution: float, points: int) -> Signals:
    """Return the record of a machine from the independent simulation, its position rounded."""
    own, segments = machine.reference, []
    highest = min(200.0, 0.12 / own.sample_time)
    for frequency in np.geomspace(2.0, highest, points):
        samples = round(1 / (frequency * own.sample_time))
        run = ReferenceRun(own, 1 / (samples * own.sample_time), machine.amplitude, FINE_STEPS)
        run.periodic_response(30.0)
        u, y = run.advance(run.block)
        channels = {"u": u[None, :], "y": (np.round(y / resolution) * resolution)[None, :]}
        segments.append(Segment(own.sample_time, channels, np.array([run.line])))
    return Signals(tuple(segments), {"u": "N", "y": "m"})


def paper_signals(sine: Mapping[str, Any], steps: int = 0, **loop: float) -> Signals:
    """Return the record of the paper's machine at 12 N, 0.1 µm, simulated with these steps per sample."""
    machine = Machine(
        create(REGISTRY, Plant, PAPER["plant"]),
        create(REGISTRY, FrictionModel, PAPER["friction"]),
        create(REGISTRY, Controller, PAPER["controller"]),
        ControlLoop.parse({**PAPER["loop"], "resolution": RESOLUTION_M, **loop}, "loop"),
        Numerics(steps_per_sample=steps),
    )
    stepped = {"name": "stepped_sine", "amplitude": 12.0, **sine}
    return simulate_loop(machine, create(REGISTRY, Excitation, stepped), lambda _: None)


def times(table: Table, reduced: bool) -> None:
    """Print the CPU time of a fit without the simulation of its record, the least of some repetitions."""
    four = ("force_scale", "displacement_scale", "viscous_coefficient", "input_dead_time")
    for points, free, bound in ((100, four[:2], 3.0), (20, four, 1.0)):
        signals, taken = paper_signals({"points": points}), []
        spec = {
            "name": "maximum_likelihood", "friction": PAPER["friction"], "free": free, "resolution": RESOLUTION_M,
            "noise": 0.0, "input_dead_time": PAPER["loop"]["input_dead_time"],
        }  # fmt: skip
        estimator = create(REGISTRY, Estimator, spec)
        for _ in range(3 if reduced else 7):  # the first one compiles
            began = time.process_time()
            estimator.estimate(signals)
            taken.append(time.process_time() - began)
        least = min(taken[1:])
        what = f"{points} frequencies, {len(free)} parameters free"
        table.row(what, f"{least:.2f} CPU-s, median {np.median(taken[1:]):.2f}", least <= bound)


def strangers(table: Table, reduced: bool) -> None:
    """Print the errors on records of an independent simulation, from scales of friction that are wrong at random."""
    random, inside, points_ok, refused = np.random.default_rng(1), 0, 0, []
    for number in range(8 if reduced else 40):
        machine = drawn_machine(number, seed=5)
        factors = np.exp(random.uniform(-0.5, 0.5, 2))
        if machine.law not in STRANGERS:
            continue
        signals = stranger_signals(machine, RESOLUTION_M, 12)
        friction = scaled_model(machine.friction, *factors)
        factors = factors if friction != dict(machine.friction) else np.ones(2)
        spec = {"name": "maximum_likelihood", "friction": friction, "resolution": RESOLUTION_M, **machine.delays()}
        began = time.process_time()
        result = create(REGISTRY, Estimator, spec).estimate(signals)
        assert result.response is not None
        plant = machine.reference.plant(result.response.frequency)
        ratio = result.response.response / plant
        is_ok = result.outcome is Outcome.OK
        held = is_covered(result, plant)[0]
        if is_ok:
            inside, points_ok = inside + int(held.sum()), points_ok + held.size
        else:
            refused.append(number)
        scales = [f"{found * given - 1:+.1e}" for found, given in zip(scales_of(result), factors, strict=True)]
        figure = f"{errors_text(ratio)[2]}, scales {' '.join(scales)}, {held.mean():4.0%} in the band, "
        figure += f"{result.outcome.name}, {time.process_time() - began:.0f} s"
        table.row(f"{number} {machine.law}, {machine.relative_amplitude:.2g} of sliding", figure)
        if not is_ok:
            print("     ", result.message)
    table.row("points of those called ok in their band", f"{inside} of {points_ok}", inside >= 0.93 * points_ok)
    table.row("machines that are not ok", f"{refused}")


def scaled_model(spec: Mapping[str, Any], force: float, displacement: float) -> dict[str, Any]:
    """Return a friction model whose force and deflections are wrong by these factors."""
    from fraexp_plugins.identification.whole_record._shared.scaled_friction import scaled_friction

    model = create(REGISTRY, FrictionModel, spec)
    changed = scaled_friction(model, (force, displacement), 1e-4)
    return dict((changed or model).spec())


def is_covered(result: Result, plant: np.ndarray) -> np.ndarray:
    """Return whether the ellipse of 95 % holds P, and the limits of magnitude and phase do, shape (3, n).

    The ellipse moves outwards by the numerical error, as the limits do. A circle of the same mean square would hold
    92 % of errors that have one direction, as those by friction's scales nearly have.
    """
    response = result.response
    assert response is not None
    numerical = np.zeros(plant.size) if response.numerical_error is None else response.numerical_error
    limits, ratio = confidence_limits(response), plant / response.response
    within = [_between(np.abs(ratio), limits.magnitude), _between(np.angle(ratio), limits.phase)]
    return np.array([_in_ellipse(response.response - plant, response.covariance, numerical * np.abs(plant)), *within])


def _in_ellipse(error: np.ndarray, covariance: np.ndarray, numerical: np.ndarray) -> np.ndarray:
    error = error * np.maximum(1 - numerical / np.abs(error), 0)
    parts = np.stack([error.real, error.imag], axis=1)
    distance = np.einsum("ni,nij,nj->n", parts, np.linalg.inv(covariance), parts)
    return np.asarray(distance <= 2 * circle_factor(np.full(error.size, np.inf)) ** 2)


def _between(value: np.ndarray, limits: np.ndarray) -> np.ndarray:
    return np.asarray((value >= limits[0]) & (value <= limits[1]))


def coverage(table: Table, reduced: bool, first_seed: int = 0) -> None:
    """Print how often the band covers P, and intervals the scales, and the error over the bound."""
    seeds = 60 if reduced else 300
    held, errors, bounds, scales = [], [], [], []
    spec = {
        "name": "maximum_likelihood", "friction": PAPER["friction"], "resolution": RESOLUTION_M, "noise": NOISE_M,
        "input_dead_time": PAPER["loop"]["input_dead_time"],
    }  # fmt: skip
    estimator, known = create(REGISTRY, Estimator, spec), None
    assert isinstance(estimator, MaximumLikelihood)
    for done, seed in enumerate(range(first_seed, first_seed + seeds)):
        if done and done % REPORTED_SEEDS == 0:
            print(f"{done} seeds: {' '.join(f'{each:.1%}' for each in np.mean(held, axis=0)[0])}", flush=True)
        sine = {"frequencies": COVERED_HZ, "recorded_periods": PERIODS}
        signals = paper_signals(sine, COVERAGE_STEPS, noise=NOISE_M, seed=seed)
        fit = estimator.staged_fit(signals, NOISE_M, estimator.free)
        known = known or fit.joint()
        result = FitReport(signals, *fit.run(known)).result()
        assert result.response is not None
        plant = create(REGISTRY, Plant, PAPER["plant"]).response(2 * np.pi * result.response.frequency)
        held.append(is_covered(result, plant))
        errors.append(np.abs(result.response.response / plant - 1))
        bounds.append(result.response.standard_deviation / np.abs(plant))
        intervals = [metric(result, f"{name}, 95 %") for name in ("force_scale", "displacement_scale")]
        scales.append(np.abs(scales_of(result) - 1) <= intervals)
    share, error = np.mean(held, axis=0), np.sqrt(np.mean(np.square(errors), axis=0))
    bound = np.sqrt(np.mean(np.square(bounds), axis=0))
    for place, frequency in enumerate(COVERED_HZ):
        over = error[place] / bound[place]
        shares = " ".join(f"{each:.1%}" for each in share[:, place])
        figure = f"{shares} of {seeds}, error {error[place]:.2g}, over the bound {over:.2f}"
        is_met = reduced or (np.abs(share[:, place] - 0.95).max() <= 0.02 and over <= 1.5)
        table.row(f"{frequency:g} Hz", figure, is_met)
    for name, each in zip(("ΣF_m", "Y_m"), np.mean(scales, axis=0), strict=True):
        table.row(f"interval of {name}", f"{each:.1%} of {seeds}", bool(each >= 0.93) or reduced)


def agreement(table: Table, reduced: bool, first_seed: int = 0) -> None:
    """Print how often responses at 12 and 75 N agree within the bands of both."""
    spec = {
        "name": "maximum_likelihood", "friction": PAPER["friction"], "resolution": RESOLUTION_M, "noise": NOISE_M,
        "input_dead_time": PAPER["loop"]["input_dead_time"],
    }  # fmt: skip
    estimator, held, seeds = create(REGISTRY, Estimator, spec), [], 5 if reduced else 20
    for seed in range(first_seed, first_seed + 2 * seeds, 2):
        pair = []
        for place, amplitude in enumerate((12.0, 75.0)):
            sine = {"frequencies": COVERED_HZ, "recorded_periods": PERIODS, "amplitude": amplitude}
            pair.append(estimator.estimate(paper_signals(sine, COVERAGE_STEPS, noise=NOISE_M, seed=seed + place)))
        small, large = (result.response for result in pair)
        numerical = sum(each.numerical_error * np.abs(each.response) for each in (small, large))
        held.append(_in_ellipse(small.response - large.response, small.covariance + large.covariance, numerical))
    share = float(np.mean(held))
    table.row("12 and 75 N agree", f"{share:.1%} of {np.size(held)}", reduced or abs(share - 0.95) <= 0.02)


QUESTIONS: dict[str, Callable[..., None]] = {
    "accuracy": accuracy,
    "starts": starts,
    "laws": laws,
    "strangers": strangers,
    "times": times,
    "coverage": coverage,
    "agreement": agreement,
}


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("questions", nargs="*", choices=[*QUESTIONS, []], help="which to answer; all by default")
    parser.add_argument("--reduced", action="store_true", help="fewer points, starts, machines and seeds")
    parser.add_argument("--first-seed", type=int, default=0, help="first seed of the noise (0)")
    arguments = parser.parse_args()
    table = Table()
    for name in arguments.questions or QUESTIONS:
        print(f"\n{name}: {(QUESTIONS[name].__doc__ or '').strip()}")
        seeds = {"first_seed": arguments.first_seed} if name in ("coverage", "agreement") else {}
        QUESTIONS[name](table, arguments.reduced, **seeds)
    print(f"\n{table.missed} missed")
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main())
