"""Measure how positioning depends on its plant model: a step of 1.5 mm as in the paper's Fig 8, into ±4 µm.

    python benchmarks/positioning.py             plant models that are identified from 100 frequencies
    python benchmarks/positioning.py --reduced   from 30

Study `robustness/positioning` moves machines drawn at random.
"""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from harness import Bench, run
from paper_machine import (
    MACHINES,
    PAPER,
    PATH,
    PRINTED,
    REGISTRY,
    fitted_plants,
    loop_job,
    metrics_of,
    results,
    sections_of,
)

from fraexp.components.kinds import Estimator, Excitation
from fraexp.components.registry import create

WINDOW_M = 4e-6
METRICS = create(
    REGISTRY, Estimator, {"name": "positioning_metrics", "settling_window": WINDOW_M, "resolution": 1e-7}
).spec()
TOLERANCE = (1e-3, 0.02)
"""Of k0 (relative) and f1 [Hz] that the proposed method keeps to."""
INTEGRAL = sections_of(MACHINES / "linear_motor_table_integral.toml")


def design(sections: dict[str, Any], gain: float, frequency: float) -> dict[str, Any]:
    """Return P_d with this k0 [m/(N s²)] and f1 [Hz]; the rest is that of P."""
    plant = sections["plant"]
    return {**plant, "rigid_body_gain": gain, "frequencies": [frequency, *plant["frequencies"][1:]]}


def moved(sections: dict[str, Any], plant: dict[str, Any]) -> dict[str, float]:
    """Return the metrics of a machine, moved by a feedforward that is designed on a plant."""
    motion = {
        "name": "point_to_point", "targets": [1.5e-3], "duration": 0.04, "dwell_time": 0.16, "plant": plant,
        "friction": sections["friction"], **PATH,
    }  # fmt: skip
    return metrics_of(results(loop_job(sections, create(REGISTRY, Excitation, motion).spec(), METRICS))[0])


def models(points: int) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Yield name and P_d, and whether the position must stay within the window after it has entered it."""
    (k0, f1), (gain, frequency) = PRINTED["effective_input"], PRINTED["conventional"]
    yield "nominal, P_d = P", design(PAPER, k0, f1), True
    yield "identification error as printed, 177 and 41.9 Hz", design(PAPER, gain, frequency), False
    for method, plant in fitted_plants(PAPER, 12.0, points).items():
        numbers = f"{1e3 * plant['rigid_body_gain']:.2f} and {plant['frequencies'][0]:.2f} Hz"
        yield f"all of P_d by {method} at 12 N, {numbers}", plant, method == "effective_input"
    for relative, absolute in itertools.product((-1, 1), repeat=2):
        name = f"P_d off by {1e2 * relative * TOLERANCE[0]:+.1f} % and {absolute * TOLERANCE[1]:+.2f} Hz"
        yield name, design(PAPER, k0 * (1 + relative * TOLERANCE[0]), f1 + absolute * TOLERANCE[1]), True


def figure_8(bench: Bench) -> None:
    """Overshoot, first entry into the window, and when the position stays in it."""
    for name, plant, stays in models(bench.options.points):
        found = moved(PAPER, plant)
        is_settled = bool(found["departures"] == 0 and np.isfinite(found["settling time"]))
        is_right = is_settled if stays else not is_settled and found["overshoot"] > WINDOW_M
        _row(bench, name, found, is_right)
    found = moved(INTEGRAL, design(INTEGRAL, *PRINTED["conventional"]))
    is_right = bool(found["overshoot"] > WINDOW_M and np.isfinite(found["settling time"]))
    _row(bench, "identification error as printed, with integral action", found, is_right)


def _row(bench: Bench, name: str, found: dict[str, float], is_right: bool) -> None:
    text = f"{1e6 * found['overshoot']:7.2f} µm {1e3 * found['first entry']:8.1f} ms "
    bench.row(name, f"{text}{1e3 * found['settling time']:8.1f} ms", is_right, overshoot=found["overshoot"])


if __name__ == "__main__":
    run(__doc__, figure_8, points=(100, 30))
