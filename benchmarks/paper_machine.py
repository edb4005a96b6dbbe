"""The paper's machine, and how the benchmarks simulate and estimate it, or another machine of the same form."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from harness import CONFIDENCE_STDS  # noqa: F401 - first of all imports: it keeps BLAS to one thread

from fraexp.components.kinds import Excitation, FrictionModel, Plant
from fraexp.components.registry import create, discover
from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.data.signals import Signals
from fraexp.execution.job import Failure, Job, run_job
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import Machine, build_machine
from fraexp.study.study_file import packaged_studies

REGISTRY = discover()
MACHINES = packaged_studies() / "machines"
RESOLUTION_M, NOISE_M = 0.1e-6, 30e-9
"""Of an encoder."""
PRINTED = {"conventional": (0.177, 41.9), "effective_input": (0.132, 38.8)}
"""k0 [m/(N s²)] and f1 [Hz] that the paper identifies at 12 N by each method; the second are those of P."""
FIT = {
    "name": "modal_fit", "modes": 2, "quantity": "magnitude", "weighting": "relative",
    "min_frequency": 20.0, "max_frequency": 150.0,
}  # fmt: skip
"""Eq (1) with two modes by least squares of log magnitude, all points alike."""


def sections_of(file: Path) -> dict[str, Any]:
    """Return the sections of a machine's file."""
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    return {key: value for key, value in data.items() if key not in ("title", "source")}


PAPER = sections_of(MACHINES / "linear_motor_table.toml")
CURVE = PAPER["friction"]["curve"]
PATH = {"input_dead_time": PAPER["loop"]["input_dead_time"]}
PLANT = create(REGISTRY, Plant, PAPER["plant"])
FRICTION = create(REGISTRY, FrictionModel, PAPER["friction"])


def machine_of(sections: Mapping[str, Any], numerics: Mapping[str, Any] | None = None, **loop: float) -> Machine:
    """Return a machine; `loop` replaces parts of its loop."""
    settings = {**sections["loop"], **loop}
    return build_machine({**sections, "loop": settings, "numerics": numerics or {}}, REGISTRY)


def simulated(machine: Machine, excitation: Mapping[str, Any]) -> Signals:
    """Return the record of an excitation."""
    return simulate_loop(machine, create(REGISTRY, Excitation, excitation), lambda _: None)


def loop_job(sections: Mapping[str, Any], excitation: Mapping[str, Any], *estimators: dict[str, Any]) -> Job:
    """Return a job of a machine in its loop."""
    return Job({"source": "loop", "numerics": {}, **sections, "excitation": excitation}, estimators)


def results(job: Job) -> list[Result]:
    """Return the results of a job; SystemExit if one of them fails."""
    answers = run_job(job, lambda _: None)
    for answer in answers:
        if isinstance(answer, Failure):
            raise SystemExit(f"no result: {answer.message}")
    return [answer for answer in answers if isinstance(answer, Result)]


def response_of(result: Result) -> FrequencyResponse:
    """Return the response of a result; SystemExit if it has none."""
    if result.response is None:
        raise SystemExit(f"no response: {result.message}")
    return result.response


def is_sure(result: Result) -> bool:
    """Return whether a result is ok, with all errors that it states within the usual accuracy."""
    from fraexp.study.accuracy import Accuracy  # not in the fraexp of former commits, which --against runs

    return result.outcome is Outcome.OK and all(each.error <= Accuracy().relative_error for each in result.findings)


def metrics_of(result: Result) -> dict[str, float]:
    """Return the metrics of a result by name."""
    return {metric.name: metric.value for metric in result.metrics}


def true_response(frequency: np.ndarray) -> np.ndarray:
    """Return P(jω) [m/N] at frequencies [Hz]."""
    return PLANT.response(2 * np.pi * frequency)


def decibel(ratio: np.ndarray) -> np.ndarray:
    """Return 20 log10 of the magnitude."""
    return 20 * np.log10(np.abs(ratio))


def scaled_friction(force: float, displacement: float) -> dict[str, Any]:
    """Return the paper's friction with ΣF_m and Y_m changed by these factors."""
    widths = {name: CURVE[name] * displacement for name in ("characteristic_displacement", "min_knot", "max_knot")}
    return {**PAPER["friction"], "curve": {**CURVE, **widths, "coulomb_force": CURVE["coulomb_force"] * force}}


def fitted_plants(sections: Mapping[str, Any], amplitude: float, points: int) -> dict[str, dict[str, Any]]:
    """Return P_d fitted to the responses of both methods at an amplitude [N], by the name of the method."""
    path = {"input_dead_time": sections["loop"]["input_dead_time"]}
    resolution = sections["loop"]["resolution"]
    methods: tuple[dict[str, Any], ...] = (
        {"name": "conventional", "refer_to_plant": True, **path},
        {"name": "effective_input", "friction": sections["friction"], "resolution": resolution, **path},
    )
    excitation = {"name": "stepped_sine", "amplitude": amplitude, "points": points}
    found = results(loop_job(sections, excitation, *({**FIT, "method": method} for method in methods)))
    if empty := next((result for result in found if not result.fits), None):
        raise SystemExit(f"no plant fitted: {empty.message}")
    return {method["name"]: dict(result.fits[0].component) for method, result in zip(methods, found, strict=True)}


def fitted(sections: Mapping[str, Any], amplitude: float, points: int) -> dict[str, tuple[float, float]]:
    """Return k0 [m/(N s²)] and f1 [Hz] of `fitted_plants`."""
    plants = fitted_plants(sections, amplitude, points)
    return {name: (plant["rigid_body_gain"], plant["frequencies"][0]) for name, plant in plants.items()}
