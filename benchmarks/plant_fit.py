"""Measure the errors of `modal_fit` for eq (1) with its dead time, and the coverage of its 95 % intervals.

    python benchmarks/plant_fit.py                 500 noisy responses each
    python benchmarks/plant_fit.py --reduced       60 noisy responses each

200 frequencies from 1 to 200 Hz on a logarithmic grid, a dead time of 1.25 ms, and complex noise with a root mean
square of 1 % of the response; its covariance is known, unknown, or measured from six periods. The errors are judged
by what 95 % of them do not exceed. `benchmarks/accuracy.py fits` has the fit to the paper's machine.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from harness import Bench, run
from paper_machine import REGISTRY

from fraexp.analysis.confidence import CONFIDENCE_LEVEL, interval_factor
from fraexp.components.kinds import Estimator, Plant
from fraexp.components.registry import create
from fraexp.data.results import FrequencyResponse

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
FULL = 500
"""Runs to which the bounds apply; fewer scatter more."""


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


def fits(case: Callable[[np.random.Generator], FrequencyResponse], bench: Bench) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the names of the parameters, and the errors and standard deviations of each run, (runs, 2, p)."""
    fit: Any = create(REGISTRY, Estimator, {"name": "modal_fit", "method": {"name": "conventional"}, "modes": 2})
    generator, found, names = bench.generator(), [], ()
    for _ in range(bench.options.runs):
        result = fit.fit_response(case(generator)).fits[0]
        names = result.parameters
        truth = np.array([true_value(name) for name in names])
        found.append([result.values - truth, result.standard_deviation])
    return names, np.array(found)


def noisy(bench: Bench) -> None:
    """Error that 95 % of the fits do not exceed, and coverage of the intervals."""
    count = bench.options.runs
    slack = 1 + 1.5 / np.sqrt(count)  # a quantile of so many runs is too large by chance
    for what, case in CASES.items():
        names, found = fits(case, bench)
        held = np.abs(found[:, 0]) <= interval_factor(np.inf) * found[:, 1]
        for place, name in enumerate(names):
            head = name.partition(".")[0]
            scale = true_value(name) if head in RELATIVE else 1.0
            error = float(np.quantile(np.abs(found[:, 0, place]), CONFIDENCE_LEVEL)) / scale
            bench.bounded(f"{what}: {name}", error, BOUNDS[head] * slack)
            bench.share(f"{what}: interval of {name}", float(held[:, place].mean()), count)
        share, tolerance = float(held.mean()), 0.02 * max(np.sqrt(FULL / count), 1.0)
        is_met = abs(share - CONFIDENCE_LEVEL) <= tolerance
        bench.row(f"{what}: all intervals", f"{100 * share:6.1f} %", is_met, share=share)


if __name__ == "__main__":
    run(__doc__, noisy, runs=(FULL, 60))
