"""Measure the errors of `modal_fit` for eq (1) with its dead time, and the coverage of its 95 % intervals.

    python benchmarks/plant_fit.py                 500 noisy responses each, and the paper's machine at 12 N
    python benchmarks/plant_fit.py --reduced       60 noisy responses each

200 frequencies from 1 to 200 Hz on a logarithmic grid, a dead time of 1.25 ms, and complex noise with a root mean
square of 1 % of the response; its covariance is known, unknown, or measured from six periods. The errors are judged
by what 95 % of them do not exceed. The exit code is 1 if a bound is missed.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from calibrate_machine import MACHINE, PRINTED, fitted, sections_of

from fraexp.analysis.confidence import CONFIDENCE_LEVEL, interval_factor
from fraexp.components.kinds import Estimator, Plant
from fraexp.components.registry import create, discover
from fraexp.data.results import FrequencyResponse

REGISTRY = discover()
TRUTH = {
    "rigid_body_gain": 0.132, "frequencies": [38.8, 81.2],
    "damping_ratios": [0.03, 0.012], "modal_gain_ratios": [0.342, 0.3],
}  # fmt: skip
DEAD_TIME, NOISE, PERIODS = 1.25e-3, 0.01, 6
FREQUENCY = np.geomspace(1.0, 200.0, 200)
BOUNDS = {
    "rigid_body_gain": 1e-3,
    "frequencies": 0.02,
    "damping_ratios": 0.01,
    "modal_gain_ratios": np.inf,
    "dead_time": 1e-5,
}
RELATIVE = ("rigid_body_gain", "damping_ratios", "modal_gain_ratios")
TOLERANCE = 0.02
"""Of the coverage of all intervals of a case; that of a single parameter may scatter by chance as well."""
FULL = 500
"""Runs to which it applies; fewer scatter more."""
SCATTER = 3.0
"""Standard deviations that a single coverage may lie off besides."""


def true_response() -> np.ndarray:
    """Return G(jω)."""
    omega = 2 * np.pi * FREQUENCY
    plant = create(REGISTRY, Plant, {"name": "modal", **TRUTH})
    return plant.response(omega) * np.exp(-1j * omega * DEAD_TIME)


TRUE_RESPONSE = true_response()
POWER = np.abs(TRUE_RESPONSE) ** 2


def noise(generator: np.random.Generator, *shape: int) -> np.ndarray:
    """Return complex noise with a root mean square of 1."""
    return (generator.standard_normal(shape) + 1j * generator.standard_normal(shape)) / np.sqrt(2)


def given(response: np.ndarray, covariance: np.ndarray, freedom: float | None) -> FrequencyResponse:
    """Return a response as an estimator gives it."""
    size = response.size
    unknown = np.full(size, np.nan)
    degrees = None if freedom is None else np.full(size, freedom)
    return FrequencyResponse(
        FREQUENCY, response, covariance, "m/N", "u", "y", np.ones(size), np.abs(response), np.ones(size, dtype=bool),
        unknown, unknown, np.full((size, 6), np.nan), degrees,
    )  # fmt: skip


def known(generator: np.random.Generator) -> FrequencyResponse:
    response = TRUE_RESPONSE * (1 + NOISE * noise(generator, FREQUENCY.size))
    return given(response, POWER[:, None, None] * (NOISE**2 / 2) * np.eye(2), None)


def unknown(generator: np.random.Generator) -> FrequencyResponse:
    response = TRUE_RESPONSE * (1 + NOISE * noise(generator, FREQUENCY.size))
    return given(response, np.full((FREQUENCY.size, 2, 2), np.nan), None)


def measured(generator: np.random.Generator) -> FrequencyResponse:
    periods = TRUE_RESPONSE * (1 + NOISE * np.sqrt(PERIODS) * noise(generator, PERIODS, FREQUENCY.size))
    mean = periods.mean(axis=0)
    parts = np.stack([(periods - mean).real, (periods - mean).imag])
    covariance = np.einsum("ipk,jpk->kij", parts, parts) / (PERIODS * (PERIODS - 1))
    return given(mean, covariance, 2.0 * (PERIODS - 1))


CASES: dict[str, Callable[[np.random.Generator], FrequencyResponse]] = {
    "noise known": known,
    "noise unknown": unknown,
    f"noise from {PERIODS} periods": measured,
}


def true_value(name: str) -> float:
    """Return the true value of a parameter, such as frequencies.0."""
    head, _, number = name.partition(".")
    if head == "dead_time":
        return DEAD_TIME
    return TRUTH[head][int(number)] if number else TRUTH[head]  # type: ignore[index]


def runs(case: Callable[[np.random.Generator], FrequencyResponse], count: int) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the names of the parameters, and the errors and standard deviations of each run, (runs, 2, p)."""
    fit: Any = create(REGISTRY, Estimator, {"name": "modal_fit", "method": {"name": "conventional"}, "modes": 2})
    generator = np.random.default_rng(6)
    found, names = [], ()
    for _ in range(count):
        result = fit.fit_response(case(generator)).fits[0]
        names = result.parameters
        truth = np.array([true_value(name) for name in names])
        found.append([result.values - truth, result.standard_deviation])
    return names, np.array(found)


def monte_carlo(count: int) -> Iterator[bool]:
    """Print errors and coverage of each case and parameter; yield whether a bound is missed."""
    print(f"{count} runs each                               error that 95 % do not exceed     bound   coverage [%]")
    for what, case in CASES.items():
        began = time.perf_counter()
        names, found = runs(case, count)
        held = np.abs(found[:, 0]) <= interval_factor(np.inf) * found[:, 1]
        for place, name in enumerate(names):
            head = name.partition(".")[0]
            scale = true_value(name) if head in RELATIVE else 1.0
            error = float(np.quantile(np.abs(found[:, 0, place]), CONFIDENCE_LEVEL)) / scale
            share = float(held[:, place].mean())
            off = abs(share - CONFIDENCE_LEVEL) > TOLERANCE + SCATTER * np.sqrt(
                CONFIDENCE_LEVEL * (1 - CONFIDENCE_LEVEL) / count
            )
            missed = bool(error > BOUNDS[head] * slack(count) or off)
            verdict = "MISSED" if missed else "ok"
            print(f"{what:<24s} {name:<18s} {error:28.3g} {BOUNDS[head]:13.3g} {100 * share:11.1f}  {verdict}")
            yield missed
        all_held = float(held.mean())
        missed = abs(all_held - CONFIDENCE_LEVEL) > TOLERANCE * max(np.sqrt(FULL / count), 1.0)
        taken = (time.perf_counter() - began) / count
        verdict = "MISSED" if missed else "ok"
        print(f"{what:<24s} {'all':<18s} {100 * all_held:54.1f}  {verdict}   {taken:.2f} s a fit", flush=True)
        yield missed


def slack(count: int) -> float:
    """Return the factor by which a quantile of so many runs may be too large by chance."""
    return 1 + SCATTER * 0.5 / np.sqrt(count)


def machine(points: int) -> Iterator[bool]:
    """Print the fits to both methods' responses at 12 N; yield whether a bound is missed."""
    found = fitted(sections_of(MACHINE), 12.0, points)
    bounds = {"conventional": (1e-2, 5e-3 * PRINTED["conventional"][1]), "effective_input": (1e-3, 0.02)}
    for method, (gain, frequency) in found.items():
        wanted, bound = PRINTED[method], bounds[method]
        errors = abs(gain / wanted[0] - 1), abs(frequency - wanted[1])
        missed = errors[0] > bound[0] or errors[1] > bound[1]
        print(
            f"{method} at 12 N: k0 = {gain * 1e3:.2f} mm/(N s²), off by {errors[0]:.2%} (bound {bound[0]:.1%}); "
            f"f1 = {frequency:.3f} Hz, off by {errors[1]:.3f} Hz (bound {bound[1]:.2f} Hz)"
            f"  {'MISSED' if missed else 'ok'}"
        )
        yield missed


def main() -> int:
    """Print all rows; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--reduced", action="store_true", help="60 noisy responses each")
    options.add_argument("--runs", type=int, default=FULL, help="noisy responses each")
    chosen = options.parse_args()
    missed = int(sum(machine(100)) + sum(monte_carlo(60 if chosen.reduced else chosen.runs)))
    print(f"{missed} missed")
    return min(missed, 1)


if __name__ == "__main__":
    sys.exit(main())
