"""Times of work on the reference core: initial estimates, to which a machine's speeds are relative."""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

MICROSECOND = 1e-6
FILE = Path(__file__).with_suffix(".toml")
DEFAULT_ENTRY, FIT_ENTRY = "default", "fit"
"""Entries for components that are not listed."""
Costs = Mapping[str, Mapping[str, float]]


class StepCost(NamedTuple):
    """Cost of a step of a friction law."""

    step: float
    """Constant part [s]."""
    state: float
    """Part of each state of the law [s]."""
    driven: float
    """Cost of a sample when a displacement drives the law, relative to a step of the loop."""


class EstimatorCost(NamedTuple):
    """Cost of an estimator."""

    sweep: float
    """For each sweep [s]."""
    segment: float
    """For each segment of the signals [s]."""
    line: float
    """For each excited line [s]."""
    sample: float
    """For each recorded sample [s]."""
    noisy_segment: float
    """For each segment of several periods with noise or rounding, whose effect an observer finds by draws [s]."""
    noisy_sample: float
    """For each recorded sample of such segments [s]."""


def run_cost(name: str) -> float:
    """Return a time of a run as a whole [s], such as ``start_serial``."""
    return float(_table()["run"][name])


def compile_cost(kernel: str) -> float:
    """Return the time [s] to compile a kind of kernel: ``loop``, ``drive``, or what they share."""
    return float(_table()["compile"][kernel])


def cost(section: str, name: str) -> float:
    """Return a time of the sections ``loop``, ``drive`` and ``record`` [s]."""
    return MICROSECOND * float(_table()[section][name])


def law_cost(law: str) -> StepCost:
    """Return the time of a friction law."""
    laws = _table()["law"]
    found = laws.get(law, laws[DEFAULT_ENTRY])
    return StepCost(MICROSECOND * found["step"], MICROSECOND * found["state"], found["driven"])


def estimator_cost(name: str, fits: bool) -> EstimatorCost:
    """Return the time of an estimator; `fits` says whether one that is not listed identifies a component."""
    estimators = _table()["estimator"]
    found = estimators.get(name, estimators[FIT_ENTRY if fits else DEFAULT_ENTRY])
    return EstimatorCost(*(MICROSECOND * found.get(key, 0.0) for key in EstimatorCost._fields))


@cache
def _table() -> Mapping[str, Any]:
    return tomllib.loads(FILE.read_text(encoding="utf-8"))
