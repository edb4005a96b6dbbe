"""Hold the intervals of a LuGre law and of the plant in a loop with noise, where no period repeats another.

    python benchmarks/loop_noise.py                         10 seeds
    python benchmarks/loop_noise.py --first-seed 5200

The machine is that of `tests/identification/test_record_start.py`: 20 sines of one period at 45 N, 0.2 µm of noise. The
start is the true machine. What is printed of each seed are errors over the half-width of the 95 % interval, and at how
many frequencies the band holds P.

The exit code is 1 if more than one of ten intervals, or of ten bands, misses.
"""

import argparse
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from maximum_likelihood import REGISTRY, is_covered

from fraexp.components.kinds import Estimator, Plant
from fraexp.components.registry import create
from fraexp.data.results import Result
from tests.identification.test_record_start import FRICTION, LOOP, NOISE, PLANT, RESOLUTION, SHAPE, record_sines

SINES = {"min_frequency": 1.5, "max_frequency": 150, "points": 20}
SCALES = ("force_scale", "displacement_scale")
HALF_WIDTH_STDS, MAX_MISSED_SHARE = 1.96, 0.1


def estimated(seed: int) -> Result:
    """Return what maximum likelihood finds in a record with noise of this seed."""
    signals = record_sines(REGISTRY, seed, **SINES)
    spec = {
        "name": "maximum_likelihood", "friction": FRICTION, "free": (*SCALES, *SHAPE), "resolution": RESOLUTION,
        "noise": NOISE, "input_dead_time": LOOP["input_dead_time"],
    }  # fmt: skip
    return create(REGISTRY, Estimator, spec).estimate(signals)


def relative_errors(result: Result) -> np.ndarray:
    """Return the errors of law and plant over the half-widths of their intervals, shape (n,)."""
    known = {metric.name: metric.value for metric in result.metrics}
    true = {**dict.fromkeys(SCALES, 1.0), **FRICTION}
    errors = [(known[name] - true[name]) / known[f"{name}, 95 %"] for name in (*SCALES, *SHAPE)]
    plant = next(fit for fit in result.fits if fit.kind == "plant")
    for name, value, std in zip(plant.parameters, plant.values, np.sqrt(np.diag(plant.covariance)), strict=True):
        number, _, place = name.partition(".")
        right = PLANT[number][int(place)] if place else PLANT[number]  # type: ignore[index]
        errors.append((value - right) / (HALF_WIDTH_STDS * std))
    return np.array(errors)


def main() -> int:
    """Print errors over half-widths, and how many intervals and bands miss."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first-seed", type=int, default=0, help="first seed of the noise (0)")
    parser.add_argument("--reduced", action="store_true", help="2 seeds")
    arguments = parser.parse_args()
    errors, held = [], []
    for seed in range(arguments.first_seed, arguments.first_seed + (2 if arguments.reduced else 10)):
        result = estimated(seed)
        assert result.response is not None
        errors.append(relative_errors(result))
        plant = create(REGISTRY, Plant, PLANT).response(2 * np.pi * result.response.frequency)
        held.append(is_covered(result, plant)[0])
        texts = " ".join(f"{each:+.2f}" for each in errors[-1])
        print(
            f"{seed:6d} {result.outcome.value or 'ok':12s} {texts}  P {held[-1].sum()} of {held[-1].size}", flush=True
        )
    missed, outside = np.abs(errors) > 1, ~np.array(held)
    print(f"\nintervals that miss: {missed.sum()} of {missed.size}, by up to {np.abs(errors).max():.2f} half-widths")
    print(f"bands that miss P: {outside.sum()} of {outside.size}")
    return int(max(missed.mean(), outside.mean()) > MAX_MISSED_SHARE)


if __name__ == "__main__":
    sys.exit(main())
