"""Measure whether the sines of `excitation_design` are as informative as it predicts, and more than equal ones.

    python benchmarks/excitation_design.py                 40 seeds of each plan
    python benchmarks/excitation_design.py --seeds 100 --noise 1e-6 --time 60
    python benchmarks/excitation_design.py --reduced       10 seeds

The paper's machine with an encoder of 0.1 µm is measured at 16 frequencies from 1.5 to 150 Hz with up to 12 N, which
does not overcome friction. A short measurement gives the preliminary machine; friction is 10 % wrong at its start. The
best uniform plan and the designed one are then simulated in the loop with other noise each time, and estimated. A
scatter misses its bound if it is off its prediction by more than chance (its 99.9 % interval, and 10 %), or if the
designed plan scatters more than the uniform one.
"""

from typing import Any, NamedTuple

import numpy as np
from harness import Bench, run
from paper_machine import (
    PAPER,
    PATH,
    RESOLUTION_M,
    loop_job,
    metrics_of,
    response_of,
    results,
    scaled_friction,
    true_response,
)

from fraexp.data.results import Curve, Result

FREQUENCIES_HZ = np.geomspace(1.5, 150.0, 16).tolist()
AMPLITUDES_N = (5.0, 7.0, 9.0, 12.0)
SCALES = ("force_scale", "displacement_scale")
TOLERANCE, CHANCE_STDS = 0.1, 3.3
"""Relative error of a predicted scatter that is allowed besides chance."""


class Scatter(NamedTuple):
    """Root mean square of relative errors over the seeds: of the response at each frequency, and of both scales."""

    responses: np.ndarray
    scales: np.ndarray


def estimated(excitation: dict[str, Any], spec: dict[str, Any], noise: float, seed: int) -> Result:
    """Return what an estimator finds on the paper's machine."""
    loop = {**PAPER["loop"], "resolution": RESOLUTION_M, "noise": noise, "seed": seed}
    return results(loop_job({**PAPER, "loop": loop}, excitation, spec))[0]


def method(noise: float, friction: dict[str, Any]) -> dict[str, Any]:
    """Return the estimator."""
    return {"name": "maximum_likelihood", "friction": friction, "resolution": RESOLUTION_M, "noise": noise, **PATH}


def sines(curve: Curve) -> dict[str, Any]:
    """Return the excitation of a plan."""
    frequencies, amplitudes, counts = (curve.columns[name].tolist() for name in ("frequency", "amplitude", "periods"))
    counts = [int(count) for count in counts]
    return {"name": "sine_list", "frequencies": frequencies, "amplitudes": amplitudes, "period_counts": counts}


def scatter(bench: Bench, curve: Curve) -> Scatter:
    """Return how far estimates of a plan are off, with other noise each time."""
    responses, scales, noise = [], [], bench.options.noise
    for seed in range(bench.seed + 1000, bench.seed + 1000 + bench.options.seeds):
        result = estimated(sines(curve), method(noise, PAPER["friction"]), noise, seed)
        response = response_of(result)
        responses.append(np.abs(response.response / true_response(response.frequency) - 1))
        scales.append([metrics_of(result)[name] - 1 for name in SCALES])
    return Scatter(*(np.sqrt(np.mean(np.square(each), axis=0)) for each in (responses, scales)))


def plans(bench: Bench) -> None:
    """Predicted and actual scatter of both plans."""
    noise, seeds = bench.options.noise, bench.options.seeds
    spec = {
        "name": "excitation_design", "amplitudes": AMPLITUDES_N, "measuring_time": bench.options.time,
        "controller": PAPER["controller"], "loop": {**PAPER["loop"], "resolution": RESOLUTION_M},
        "method": method(noise, scaled_friction(1.1, 0.9)),
    }  # fmt: skip
    short = {"name": "stepped_sine", "amplitude": AMPLITUDES_N[-1], "frequencies": FREQUENCIES_HZ}
    design = estimated(short, spec, noise, seed=bench.seed)
    print(design.message)
    known, found = metrics_of(design), []
    for curve in design.curves[:2]:
        predicted, actual = curve.columns["relative standard deviation"], scatter(bench, curve)
        found.append(actual)
        pairs = [("P̂", np.sqrt(np.mean(predicted**2)), np.sqrt(np.mean(actual.responses**2)))]
        for name, each in zip(SCALES, actual.scales, strict=True):
            pairs.append((name, known[f"{curve.name}: {name}, 95 %"] / 1.96, each))
        for what, expected, is_value in pairs:
            is_met = abs(np.log(is_value / expected)) <= np.log1p(TOLERANCE) + CHANCE_STDS / np.sqrt(2 * seeds)
            text = f"predicted {expected:.3g}, is {is_value:.3g}"
            bench.row(f"{curve.name}, {known[f'{curve.name}: time']:.1f} s: {what}", text, is_met)
    uniform, designed = found
    gain = float(np.sqrt(np.mean(designed.responses**2) / np.mean(uniform.responses**2)))
    bench.bounded("designed over uniform: P̂", gain, 1.0)
    for name, ratio in zip(SCALES, designed.scales / uniform.scales, strict=True):
        bench.bounded(f"designed over uniform: {name}", float(ratio), 1.0)


if __name__ == "__main__":
    run(__doc__, plans, seeds=(40, 10), noise=3e-7, time=60.0)
