"""Measure whether a second tone, as dither, tells more of the plant than all of the force in one sine.

    python benchmarks/dither.py              4 phases of the second tone
    python benchmarks/dither.py --phases 12

The paper's machine with an encoder of 0.1 µm and no noise is measured at seven frequencies from 1 to 12 Hz, for one
period each, which rounds the motion the same way however often it is repeated. The peak force is 12 N throughout: all
of it in a sine, or shared with a second tone. `maximum_likelihood` estimates both. Printed is how wide the bands of the
second are over those of the first, and how far the responses are off, root mean square over frequencies and phases.

The exit code is 1 if an estimate is not ok, or off by more than three half-widths of its band.
"""

import argparse
import os
import sys
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from excitation_design import estimated, method
from maximum_likelihood import PAPER, REGISTRY, Table

from fraexp.analysis.confidence import circle_factor
from fraexp.components.kinds import Plant
from fraexp.components.registry import create
from fraexp.data.results import Outcome

FREQUENCIES_HZ = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0)
HIGHER_HZ = (17.0, 23.0, 30.0, 38.0, 50.0, 65.0, 80.0, 95.0, 120.0, 170.0)
"""Sines of 12 N that tell of friction and of the plant's modes, the same in every plan."""
PEAK_N = 12.0
SECOND_TONES = ((1.0, 20.0), (2.0, 20.0), (2.0, 60.0), (3.0, 60.0), (2.0, 150.0))
"""Amplitude [N] and frequency [Hz]."""


class Precision(NamedTuple):
    """What is known of the plant at `FREQUENCIES_HZ`, relative to it."""

    bands: np.ndarray
    """Standard deviation that the estimate states, shape (n,)."""
    errors: np.ndarray
    """Distance from the plant, shape (n,)."""


def sine(frequency: float) -> dict[str, Any]:
    """Return one sine with all of the force."""
    return {"name": "stepped_sine", "amplitude": PEAK_N, "frequencies": [frequency]}


def two_tones(frequency: float, amplitude: float, second: float, seed: int) -> dict[str, Any]:
    """Return a sine and a second tone, which make the same peak force, at phases drawn at random."""
    first = PEAK_N - amplitude
    highest = round(second / frequency) * frequency
    return {
        "name": "multisine", "harmonics": "full", "points": 2, "detection_group_size": 0, "seed": seed,
        "line_spacing": frequency, "min_frequency": frequency, "max_frequency": highest,
        "amplitude_profile": [[frequency, 1.0], [second, amplitude / first]],
        "rms": np.hypot(first, amplitude) / np.sqrt(2),
    }  # fmt: skip


def precision(parts: list[dict[str, Any]]) -> Precision:
    """Return how well the plant is known from these excitations."""
    excitation = {"name": "concatenated", "parts": parts + [sine(frequency) for frequency in HIGHER_HZ]}
    result = estimated(excitation, method(0.0, PAPER["friction"]), 0.0, 0)
    response = result.response
    if result.outcome is not Outcome.OK or response is None:
        raise SystemExit(result.message)
    plant = create(REGISTRY, Plant, PAPER["plant"]).response(2 * np.pi * response.frequency)
    at = [int(np.argmin(np.abs(response.frequency - frequency))) for frequency in FREQUENCIES_HZ]
    errors = np.abs(response.response / plant - 1)
    return Precision((response.standard_deviation / np.abs(plant))[at], errors[at])


def main() -> int:
    """Print a row for each second tone."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--phases", type=int, default=4, help="random phases of each second tone (4)")
    phases, table = parser.parse_args().phases, Table()
    single = precision([sine(frequency) for frequency in FREQUENCIES_HZ])
    rms = 100 * np.sqrt(np.mean(single.errors**2))
    table.row(f"{PEAK_N:g} N in one sine", f"off by {rms:.3f} %")
    for amplitude, second in SECOND_TONES:
        found = [
            precision([two_tones(frequency, amplitude, second, seed) for frequency in FREQUENCIES_HZ])
            for seed in range(phases)
        ]
        widths = np.exp(np.mean([np.log(each.bands / single.bands) for each in found], axis=0))
        rms = 100 * np.sqrt(np.mean([each.errors**2 for each in found]))
        worst = max(float(np.max(each.errors / (circle_factor(np.inf) * each.bands))) for each in found)
        table.row(
            f"{PEAK_N - amplitude:g} N and {amplitude:g} N at {second:g} Hz",
            f"off by {rms:.3f} %, bands {np.array2string(widths, precision=2)} times, worst {worst:.2f} half-widths",
            worst <= 3,
        )
    print(f"\n{table.missed} missed")
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main())
