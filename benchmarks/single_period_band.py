"""Measure how often the band of a record of one period covers what it should, with an encoder of 0.1 µm.

    python benchmarks/single_period_band.py             20 places of the machine on the scale
    python benchmarks/single_period_band.py --reduced   5 places

Rounding in a single period is not random: it depends on where on the scale the machine moves. So the loop is simulated
at random places within one quantisation step, with noise and without, and the shares are those over places and 30
frequencies from 1 to 200 Hz together. The band of the proposed method, whose friction model is right, must cover P(jω),
that of the conventional one the response with an ideal encoder. The 95 % circle and the numerical error of 1e-5, which
is drawn with it, must cover at least 91 %; the exit code is 1 if one does not.
"""

import argparse
import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from encoder_band import (
    MACHINES,
    METHODS,
    NOISE_M,
    NUMERICS,
    RESOLUTION_M,
    estimator,
    records,
    response_of,
)

from fraexp.analysis.confidence import circle_factor, degrees_of_freedom
from fraexp.components.kinds import Estimator, Plant
from fraexp.components.registry import create, discover
from fraexp.data.results import FrequencyResponse
from fraexp.data.signals import Encoder, Signals

REGISTRY = discover()
FREQUENCIES_HZ = tuple(np.geomspace(1, 200, 30).tolist())
MIN_SHARE = 0.91
CASES = (("paper", 12.0), ("paper", 25.0), ("paper", 75.0), ("other", 12.0), ("damped", 12.0))


class Coverage(NamedTuple):
    """How a method's errors and its bands agree."""

    share: float
    """Share of the points whose circle covers the true value."""
    worst: float
    """Greatest error over the radius of the circle."""
    error: float
    """Greatest relative error."""
    band: float
    """Radius of the circle there, relative."""


def signals_at(sections: Mapping[str, Any], amplitude: float, place: float, encoder: Encoder, seed: int) -> Signals:
    """Return one period of each frequency, with the machine at a place on the scale [m]."""
    loop = {"noise": encoder.noise, "resolution": encoder.resolution, "reference": place, "seed": seed}
    (signals,) = records(sections, FREQUENCIES_HZ, 1, loop, amplitude, 1)
    return replace(signals, encoder=encoder)


def measured(name: str, amplitude: float, method_name: str, noise: float, places: int) -> Coverage:
    """Return the coverage of a method on a machine at random places of the scale."""
    sections, encoder = MACHINES[name], Encoder(noise, RESOLUTION_M)
    update = {"noise": noise} if method_name == "effective_input" else {}
    method = estimator(sections, method_name).model_copy(update=update)
    truth = true_response(sections, amplitude, method)
    generator, radii, errors = np.random.default_rng(1), [], []
    for seed in range(places):
        signals = signals_at(sections, amplitude, generator.uniform(0, RESOLUTION_M), encoder, seed)
        response = response_of(method, signals)
        radii.append(radius(response) / np.abs(truth))
        errors.append(np.abs(response.response / truth - 1))
    error, band = np.array(errors), np.array(radii)
    greatest = np.unravel_index(np.argmax(error), error.shape)
    ratio = error / (band + NUMERICS["tolerance"])
    return Coverage(float(np.mean(ratio <= 1)), float(ratio.max()), float(error[greatest]), float(band[greatest]))


def true_response(sections: Mapping[str, Any], amplitude: float, method: Estimator) -> np.ndarray:
    """Return what a method should find: the plant, or what the conventional one finds with an ideal encoder."""
    ideal = signals_at(sections, amplitude, 0.0, Encoder(0.0, 0.0), 0)
    frequency = np.concatenate([segment.frequency for segment in ideal.segments])
    if method.name == "effective_input":
        return create(REGISTRY, Plant, sections["plant"]).response(2 * np.pi * frequency)
    return response_of(method.model_copy(update={"resolution": 0.0}), ideal).response


def radius(response: FrequencyResponse) -> np.ndarray:
    """Return the radius of the 95 % circle, shape (n,)."""
    return circle_factor(degrees_of_freedom(response)) * response.standard_deviation


def main() -> int:
    """Print a row for each machine, amplitude, noise and method; return 1 if a band does not hold."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--places", type=int, default=20)
    options.add_argument("--reduced", action="store_const", dest="places", const=5, help="the same as --places 5")
    places, missed = options.parse_args().places, 0
    for machine, amplitude in CASES:
        for noise in (0.0, NOISE_M):
            for name in METHODS:
                found = measured(machine, amplitude, name, noise, places)
                is_short = found.share < MIN_SHARE
                missed += is_short
                print(
                    f"{machine:<7s}{amplitude:3.0f} N {1e9 * noise:3.0f} nm  {name:<16s} covers {found.share:6.1%}; "
                    f"at most {found.worst:4.1f} radii off; greatest error {found.error:.1e}, its band {found.band:.1e}"
                    + ("  short" if is_short else ""),
                    flush=True,
                )
    print(f"{missed} missed")
    return min(missed, 1)


if __name__ == "__main__":
    sys.exit(main())
