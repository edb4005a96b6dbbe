"""Measure what `maximum_likelihood` finds, and print a table for each part.

    python benchmarks/maximum_likelihood.py                           all parts
    python benchmarks/maximum_likelihood.py accuracy starts           these
    python benchmarks/maximum_likelihood.py --reduced                 fewer points, starts, machines and seeds
    python benchmarks/maximum_likelihood.py coverage --seed 9000000   the seeds of the noise begin there

accuracy     paper's machine at 12 N, 0.1 µm: error of P̂ at 100 frequencies, of one period and of 8 with 30 nm of noise
starts       the same at 30 frequencies from ΣF_m and Y_m wrong by every pair of factors
laws         each law seen by each: which of them fit
strangers    records of an independent fine simulation (`reference_loop`) of machines drawn at random, friction's scales
             drawn too
times        CPU time of the fit alone: 100 frequencies, and 20 with four parameters of friction and dead time free
coverage     how often the band (ellipse, magnitude, phase) covers P at 16 frequencies, and the intervals of the scales
             their values; the error over the bound that the information sets. The records are simulated with 60 steps
             per sample: with the 7 that are chosen, their own error is as large as that by noise from 12 Hz on, and the
             band contains both. The fit to the first record is where the others start
agreement    how often responses at 12 and 75 N agree within the bands of both
loop-noise   20 sines of one period at 45 N with 0.2 µm of noise in the loop of
             `tests/identification/test_record_start.py`: how often intervals of a LuGre law and of the plant miss, from
             the true machine as start
"""

import sys
import time
from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from drawn_machines import DrawnMachine, drawn_machine
from fraexp_plugins.identification._law_numbers import scaled_friction as scaled_law
from fraexp_plugins.identification._machine_fit import FitReport, fit_machine, joint_fit
from fraexp_plugins.identification.maximum_likelihood import MaximumLikelihood
from friction_bands import squared_distance, within_limits
from harness import ROOT, Bench, run
from paper_machine import (
    CURVE,
    NOISE_M,
    PAPER,
    PATH,
    REGISTRY,
    RESOLUTION_M,
    decibel,
    loop_job,
    machine_of,
    metrics_of,
    response_of,
    results,
    scaled_friction,
    simulated,
    true_response,
)
from reference_loop import FINE_CLOCK, ReferenceRun

sys.path.insert(0, str(ROOT))
from fraexp.analysis.confidence import circle_factor
from fraexp.components.kinds import Estimator, FrictionModel, Plant
from fraexp.components.registry import create
from fraexp.data.results import Outcome, Result
from fraexp.data.signals import Segment, Signals
from tests.identification import test_record_start as noisy_loop

PERIODS = 8
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
COVERAGE_STEPS = 60
"""Steps per sample of the records whose bands are counted."""
COVERED_HZ = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 16.0, 22.0, 30.0, 40.0, 50.0, 65.0, 80.0, 120.0, 170.0)


SCALES = ("force_scale", "displacement_scale")
MAX_MISSED_SHARE = 0.1
"""Of intervals and bands in a noisy loop."""


def specification(friction: Mapping[str, Any] = PAPER["friction"], noise: float = 0.0, **more: Any) -> dict[str, Any]:
    """Return the estimator for the paper's machine."""
    spec = {"name": "maximum_likelihood", "friction": friction, "resolution": RESOLUTION_M, "noise": noise}
    return {**spec, **PATH, **more}


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
    machine = {**PAPER, "friction": friction, "loop": loop}
    (result,) = results(loop_job(machine, excitation, specification(model or friction, noise)))
    response = response_of(result)
    return result, response.response / true_response(response.frequency)


def greatest_errors(ratio: np.ndarray) -> tuple[float, float]:
    """Return the greatest error in dB and in degrees."""
    return np.abs(decibel(ratio)).max(), np.degrees(np.abs(np.angle(ratio))).max()


def errors_text(ratio: np.ndarray) -> str:
    """Return the greatest errors as text."""
    magnitude, phase = greatest_errors(ratio)
    return f"{magnitude:.4f} dB {phase:.3f}°"


def bound_text(result: Result, ratio: np.ndarray) -> str:
    """Return where the greatest error is, and the standard deviation that the information in the samples allows."""
    response, worst = response_of(result), int(np.argmax(np.abs(np.log(ratio))))
    bound = response.standard_deviation[worst] / np.abs(response.response[worst])
    decibels, degrees = 20 * np.log10(np.e) * bound / np.sqrt(2), np.degrees(bound) / np.sqrt(2)
    return f"bound at {response.frequency[worst]:.3g} Hz, one standard deviation: {decibels:.4f} dB {degrees:.3f}°"


def scales_of(result: Result) -> np.ndarray:
    """Return the scales of force and deflection; NaN for one that was held."""
    return np.array([metrics_of(result).get(name, np.nan) for name in SCALES])


def accuracy(bench: Bench) -> None:
    """Greatest errors from 1 to 200 Hz."""
    for amplitude, noise, bounds in ((12.0, 0.0, (0.1, 1.0)), (12.0, NOISE_M, (0.05, 1.5)), (75.0, 0.0, (0.1, 1.0))):
        points, began = (30 if bench.reduced or noise else 100), time.process_time()
        result, ratio = estimated(points, amplitude=amplitude, noise=noise)
        seconds, (magnitude, phase) = time.process_time() - began, greatest_errors(ratio)
        is_met = magnitude <= bounds[0] and phase <= bounds[1] and result.outcome is Outcome.OK
        above = errors_text(ratio[response_of(result).frequency >= 1.5])
        text = f"{errors_text(ratio)}, from 1.5 Hz {above}, {seconds:.1f} CPU-s; {bound_text(result, ratio)}"
        bench.row(f"{amplitude:g} N, {points} frequencies, {noise * 1e9:g} nm of noise", text, is_met)


def starts(bench: Bench) -> None:
    """Errors and scales from wrong starts."""
    pairs = list(product(FACTORS, FACTORS))
    for force, displacement in pairs[::5] if bench.reduced else pairs:
        result, ratio = estimated(30, scaled_friction(force, displacement))
        ratio = ratio[response_of(result).frequency >= 1.5]
        (magnitude, phase), scales = greatest_errors(ratio), scales_of(result) * [force, displacement] - 1
        is_right = bool(magnitude <= 0.1 and phase <= 1 and np.abs(scales).max() <= 5e-4)
        text = f"{errors_text(ratio)}, scales {scales[0]:+.1e} {scales[1]:+.1e}, {result.outcome.name}"
        bench.row(f"ΣF_m × {force:g}, Y_m × {displacement:g}", text, is_right)


def laws(bench: Bench) -> None:
    """Which law fits which."""
    names = list(LAWS)[:3] if bench.reduced else list(LAWS)
    for true, model in product(names, names):
        result, ratio = estimated(20, LAWS[model], friction=LAWS[true])
        is_right = any(found.kind == "misfit" for found in result.findings) == (true != model)
        residual = metrics_of(result)["residual over expectation"]
        text = f"{result.outcome.name}, residual {residual:.4g}, {errors_text(ratio)}"
        bench.row(f"{true} seen by {model}", text, is_right)


def stranger_signals(machine: DrawnMachine, resolution: float, points: int) -> Signals:
    """Return the record of a machine from the independent simulation, its position rounded."""
    own, segments = machine.reference, []
    highest = min(200.0, 0.12 / own.sample_time)
    for frequency in np.geomspace(2.0, highest, points):
        samples = round(1 / (frequency * own.sample_time))
        fine = ReferenceRun(own, 1 / (samples * own.sample_time), machine.amplitude, FINE_STEPS)
        fine.periodic_response(30.0)
        u, y = fine.advance(fine.block)
        channels = {"u": u[None, :], "y": (np.round(y / resolution) * resolution)[None, :]}
        segments.append(Segment(own.sample_time, channels, np.array([fine.line])))
    return Signals(tuple(segments), {"u": "N", "y": "m"})


def paper_signals(sine: Mapping[str, Any], steps: int = 0, **loop: float) -> Signals:
    """Return the record of the paper's machine at 12 N, 0.1 µm, simulated with these steps per sample."""
    machine = machine_of(PAPER, {"steps_per_sample": steps}, resolution=RESOLUTION_M, **loop)
    return simulated(machine, {"name": "stepped_sine", "amplitude": 12.0, **sine})


def times(bench: Bench) -> None:
    """CPU time of a fit without the simulation of its record, the least of some repetitions."""
    four = (*SCALES, "viscous_coefficient", "input_dead_time")
    for points, free, bound in ((100, four[:2], 3.0), (20, four, 1.0)):
        signals, taken = paper_signals({"points": points}), []
        estimator = create(REGISTRY, Estimator, specification(free=free))
        for _ in range(3 if bench.reduced else 7):  # the first one compiles
            began = time.process_time()
            estimator.estimate(signals)
            taken.append(time.process_time() - began)
        bench.bounded(f"{points} frequencies, {len(free)} parameters free", min(taken[1:]), bound, "CPU-s")


def strangers(bench: Bench) -> None:
    """Errors on records of an independent simulation, from scales of friction that are wrong at random."""
    random, inside, refused = bench.generator(), [], []
    for number in range(8 if bench.reduced else 40):
        machine, factors = drawn_machine(number, bench.seed), np.exp(random.uniform(-0.5, 0.5, 2))
        if machine.law not in STRANGERS:
            continue
        friction = scaled_model(machine.friction, *factors)
        factors = factors if friction != dict(machine.friction) else np.ones(2)
        spec = {"name": "maximum_likelihood", "friction": friction, "resolution": RESOLUTION_M, **machine.delays()}
        signals, began = stranger_signals(machine, RESOLUTION_M, 12), time.process_time()
        result = create(REGISTRY, Estimator, spec).estimate(signals)
        seconds, response = time.process_time() - began, response_of(result)
        plant = machine.reference.plant(response.frequency)
        held = is_covered(result, plant)[0]
        if result.outcome is Outcome.OK:
            inside.append(held)
        else:
            refused.append(number)
        scales = [f"{found * given - 1:+.1e}" for found, given in zip(scales_of(result), factors, strict=True)]
        text = f"{errors_text(response.response / plant)}, scales {' '.join(scales)}, {held.mean():4.0%} in the band, "
        text += f"{result.outcome.name}, {seconds:.0f} s"
        bench.row(f"{number} {machine.law}, {machine.relative_amplitude:.2g} of sliding", text)
    held = np.concatenate(inside)
    text = f"{held.sum()} of {held.size}; machines that are not ok: {refused}"
    bench.row("points of those called ok in their band", text, bool(held.mean() >= 0.93))


def scaled_model(spec: Mapping[str, Any], force: float, displacement: float) -> dict[str, Any]:
    """Return a friction model whose force and deflections are wrong by these factors."""
    model = create(REGISTRY, FrictionModel, spec)
    return dict((scaled_law(model, (force, displacement), 1e-4) or model).spec())


def is_covered(result: Result, plant: np.ndarray) -> np.ndarray:
    """Return whether the ellipse of 95 % holds P, and the limits of magnitude and phase do, shape (3, n).

    The ellipse moves outwards by the numerical error, as the limits do. A circle of the same mean square would hold
    92 % of errors that have one direction, as those by friction's scales nearly have.
    """
    response = response_of(result)
    numerical = np.zeros(plant.size) if response.numerical_error is None else response.numerical_error
    ellipse = _in_ellipse(response.response - plant, response.covariance, numerical * np.abs(plant))
    return np.vstack([ellipse, within_limits(response, plant)])


def _in_ellipse(error: np.ndarray, covariance: np.ndarray, numerical: np.ndarray) -> np.ndarray:
    error = error * np.maximum(1 - numerical / np.abs(error), 0)
    return np.asarray(squared_distance(error, covariance) <= 2 * circle_factor(np.full(error.size, np.inf)) ** 2)


def coverage(bench: Bench) -> None:
    """How often band and intervals cover, and the error over the bound."""
    seeds = 60 if bench.reduced else 300
    held, errors, bounds, scales = [], [], [], []
    estimator, known = create(REGISTRY, Estimator, specification(noise=NOISE_M)), None
    assert isinstance(estimator, MaximumLikelihood)
    sine = {"frequencies": COVERED_HZ, "recorded_periods": PERIODS}
    for seed in range(bench.seed, bench.seed + seeds):
        signals = paper_signals(sine, COVERAGE_STEPS, noise=NOISE_M, seed=seed)
        problem = estimator.problem(signals, NOISE_M, estimator.law)
        known = known or joint_fit(problem)[0]
        result = FitReport(signals, *fit_machine(problem, known)).result()
        response = response_of(result)
        plant = true_response(response.frequency)
        held.append(is_covered(result, plant))
        errors.append(np.abs(response.response / plant - 1))
        bounds.append(response.standard_deviation / np.abs(plant))
        intervals = [metrics_of(result)[f"{name}, 95 %"] for name in SCALES]
        scales.append(np.abs(scales_of(result) - 1) <= intervals)
    share = np.mean(held, axis=0)
    error, bound = (np.sqrt(np.mean(np.square(each), axis=0)) for each in (errors, bounds))
    for place, frequency in enumerate(COVERED_HZ):
        over = error[place] / bound[place]
        shares = " ".join(f"{each:.1%}" for each in share[:, place])
        text = f"{shares} of {seeds}, error {error[place]:.2g}, over the bound {over:.2f}"
        is_met = bench.reduced or (np.abs(share[:, place] - 0.95).max() <= 0.02 and over <= 1.5)
        bench.row(f"{frequency:g} Hz", text, is_met)
    for name, each in zip(("ΣF_m", "Y_m"), np.mean(scales, axis=0), strict=True):
        bench.row(f"interval of {name}", f"{each:.1%} of {seeds}", bool(each >= 0.93) or bench.reduced)


def agreement(bench: Bench) -> None:
    """How often responses at 12 and 75 N agree within the bands of both."""
    estimator, held = create(REGISTRY, Estimator, specification(noise=NOISE_M)), []
    for seed in range(bench.seed, bench.seed + (10 if bench.reduced else 40), 2):
        pair = []
        for place, amplitude in enumerate((12.0, 75.0)):
            sine = {"frequencies": COVERED_HZ, "recorded_periods": PERIODS, "amplitude": amplitude}
            signals = paper_signals(sine, COVERAGE_STEPS, noise=NOISE_M, seed=seed + place)
            pair.append(response_of(estimator.estimate(signals)))
        small, large = pair
        numerical = sum(each.numerical_error * np.abs(each.response) for each in pair)  # type: ignore[operator]
        held.append(_in_ellipse(small.response - large.response, small.covariance + large.covariance, numerical))
    share = float(np.mean(held))
    text = f"{share:.1%} of {np.size(held)}"
    bench.row("12 and 75 N agree", text, bench.reduced or abs(share - 0.95) <= 0.02)


def loop_noise(bench: Bench) -> None:
    """Errors over the half-widths of the 95 % intervals of law and plant."""
    errors, held = [], []
    for seed in range(bench.seed, bench.seed + (2 if bench.reduced else 10)):
        signals = noisy_loop.record_sines(REGISTRY, seed, min_frequency=1.5, max_frequency=150, points=20)
        free = (*SCALES, *noisy_loop.SHAPE)
        scale = {"resolution": noisy_loop.RESOLUTION, "noise": noisy_loop.NOISE}
        dead_time = noisy_loop.LOOP["input_dead_time"]
        spec = specification(noisy_loop.FRICTION, **scale, free=free, input_dead_time=dead_time)
        result = create(REGISTRY, Estimator, spec).estimate(signals)
        errors.append(_interval_errors(result, free))
        plant = create(REGISTRY, Plant, noisy_loop.PLANT).response(2 * np.pi * response_of(result).frequency)
        held.append(is_covered(result, plant)[0])
        texts = " ".join(f"{each:+.2f}" for each in errors[-1])
        bench.row(f"seed {seed}", f"{result.outcome.name} {texts}  P {held[-1].sum()} of {held[-1].size}")
    missed, outside = np.abs(errors) > 1, ~np.array(held)
    print(f"the worst interval misses by {np.abs(errors).max():.2f} half-widths")
    bench.bounded(f"intervals of {missed.size} that miss", missed.sum(), MAX_MISSED_SHARE * missed.size)
    bench.bounded(f"points of {outside.size} with P outside of its ellipse", outside.sum(), 0.1 * outside.size)


def _interval_errors(result: Result, free: tuple[str, ...]) -> np.ndarray:
    """Return the errors of law and plant over the half-widths of their intervals, shape (n,)."""
    known, true = metrics_of(result), {**dict.fromkeys(SCALES, 1.0), **noisy_loop.FRICTION}
    errors = [(known[name] - true[name]) / known[f"{name}, 95 %"] for name in free]
    plant = next(fit for fit in result.fits if fit.kind == "plant")
    for name, value, std in zip(plant.parameters, plant.values, np.sqrt(np.diag(plant.covariance)), strict=True):
        number, _, place = name.partition(".")
        right: Any = noisy_loop.PLANT[number]
        errors.append((value - (right[int(place)] if place else right)) / (1.96 * std))
    return np.array(errors)


if __name__ == "__main__":
    run(__doc__, accuracy, starts, laws, strangers, times, coverage, agreement, loop_noise)
