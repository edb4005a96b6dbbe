"""Responses made of formulas, in a database, for what is drawn of them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fraexp.data.results import Curve, FrequencyResponse, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import Store
from tests.responses import frequency_response

RESONANCE = 40.0
"""Frequency [Hz] at which the response of `resonant` is greatest."""


def resonant(frequency: np.ndarray, unit: str = "m/N", at: float = RESONANCE) -> FrequencyResponse:
    """Return the response of an oscillator with 1 % damping."""
    turning = frequency / at
    value = 1e-3 / (1 - turning**2 + 0.02j * turning)
    harmonics = np.full((len(frequency), 6), 0.01 + 0j)
    covariance = np.eye(2) * (0.05 * np.abs(value))[:, None, None] ** 2
    return frequency_response(frequency, value, covariance=covariance, unit=unit, harmonics=harmonics)


def gap(response: FrequencyResponse, low: float, high: float) -> FrequencyResponse:
    """Return a response that had not settled between two frequencies."""
    inside = (response.frequency >= low) & (response.frequency <= high)
    return replace(response, settled=~inside)


def loop(stroke: float) -> Curve:
    """Return a hysteresis loop."""
    angle = np.linspace(0, 2 * np.pi, 61)
    columns = {"displacement": stroke * np.cos(angle), "force": 10 * np.cos(angle + 0.4)}
    return Curve("loop", columns, {"displacement": "m", "force": "N"})


def store_results(folder: Path, results: Sequence[Result], title: str = "case") -> list[str]:
    """Write results into the database of a folder, as a run of its own; return the keys of their sweeps."""
    sweeps = [
        Sweep({"source": "loop", "excitation": {"name": "x", title: index}}, {"name": "y"}, {title: f"{title} {index}"})
        for index in range(len(results))
    ]
    with Store.open(str(folder / "results.db"), create=True) as store:
        run = store.begin_run(title, f"{title}.toml", f"fraexp run {title}", {}, sweeps)
        store.save(run, [(sweep, result, {}) for sweep, result in zip(sweeps, results, strict=True)])
        store.end_run(run, "complete")
    return [sweep.key for sweep in sweeps]


def found(response: FrequencyResponse) -> Result:
    """Return a result with a response alone."""
    return Result(Outcome.OK, response=response)
