"""A small sweep whose response is known: whether this machine computes the numbers that it ought to."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fraexp.components.registry import discover
from fraexp.errors import FraexpError
from fraexp.execution.job import run_job
from fraexp.execution.sent_jobs import Failure, Job
from fraexp.study.study_file import resolve

STUDY: Mapping[str, object] = {
    "plant": {
        "name": "modal",
        "rigid_body_gain": 0.132,
        "frequencies": [38.8],
        "damping_ratios": [0.046],
        "modal_gain_ratios": [0.342],
    },
    "friction": {
        "name": "rolling",
        "curve": {"shape": "exponential", "coulomb_force": 17.9, "characteristic_displacement": 45e-6, "elements": 10},
        "viscous_coefficient": 4.69,
    },
    "controller": {"name": "pid", "proportional": 6000.0, "derivative_time": 0.0566, "filter_time": 0.0063},
    "loop": {"sample_time": 5e-4, "input_dead_time": 1e-3},
    "excitation": {
        "name": "stepped_sine",
        "amplitude": 12.0,
        "frequencies": [20.0, 40.0, 80.0],
        "settling_timeout": 5.0,
    },
    "numerics": {"steps_per_sample": 6},  # fixed, as the truth is what these steps give
    "estimator": {"name": "effective_input", "oversampling": 4},
}
TRUTH: Mapping[float, complex] = {
    20.0: -7.328491324e-06 - 6.6804203e-08j,
    40.0: -5.775796946e-06 - 5.565582429e-06j,
    80.0: -7.552381755e-07 - 1.3588506e-08j,
}
"""Response Y/U [m/N] of the plant as it is found; the keys are frequencies in Hz."""
TOLERANCE = 1e-6
"""Relative difference that is allowed: processors round differently, and friction remembers it."""


@dataclass(frozen=True)
class SelfTest:
    """Result of the self-test."""

    sound: bool
    error: str
    """What is wrong; empty if nothing is."""
    difference: float
    """Greatest relative difference from the truth; NaN where there is no response."""
    seconds: float
    """Time that it took [s], the compiler's included."""
    kernel: str
    """How the loop was computed."""


def run_self_test() -> SelfTest:
    """Simulate the sweep and compare its response with the truth."""
    began = time.perf_counter()
    try:
        (sweep,) = resolve("self-test", Path("self-test.toml"), STUDY, Path(), discover()).sweeps
    except FraexpError as error:
        return SelfTest(False, str(error), float("nan"), time.perf_counter() - began, "")
    (found,) = run_job(Job(sweep.experiment, (sweep.estimator,)), lambda _: None)
    seconds = time.perf_counter() - began
    if isinstance(found, Failure):
        return SelfTest(False, found.message, float("nan"), seconds, "")
    if found.response is None or found.response.frequency.tolist() != list(TRUTH):
        return SelfTest(False, f"no response: {found.message}", float("nan"), seconds, found.numerics)
    truth = np.array(list(TRUTH.values()))
    difference = float(np.abs(found.response.response / truth - 1).max())
    sound = difference <= TOLERANCE
    message = "" if sound else f"the response differs by {difference:.1e} of the truth; the limit is {TOLERANCE:.0e}"
    return SelfTest(sound, message, difference, seconds, found.numerics)
