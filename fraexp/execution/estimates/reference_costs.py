"""What work takes on the reference core: where estimates begin, and what a machine's speeds are relative to."""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

MICROSECOND = 1e-6
FILE = Path(__file__).with_suffix(".toml")
DEFAULT, FIT = "default", "fit"
"""Entries that stand for components which are not listed."""
Costs = Mapping[str, Mapping[str, float]]


class StepCost(NamedTuple):
    """Time of a friction law for each step."""

    step: float
    """A part of its own [s]."""
    state: float
    """For each state of the law [s]."""
    driven: float
    """For each sample of a displacement by which the law is driven, relative to a step of the loop."""


class EstimatorCost(NamedTuple):
    """Time of an estimator."""

    sweep: float
    """For each sweep [s]."""
    segment: float
    """For each segment of the signals [s]."""
    line: float
    """For each excited line [s]."""
    sample: float
    """For each recorded sample [s]."""


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
    found = laws.get(law, laws[DEFAULT])
    return StepCost(MICROSECOND * found["step"], MICROSECOND * found["state"], found["driven"])


def estimator_cost(name: str, fits: bool) -> EstimatorCost:
    """Return the time of an estimator; `fits` says whether one that is not listed identifies a component."""
    estimators = _table()["estimator"]
    found = estimators.get(name, estimators[FIT if fits else DEFAULT])
    return EstimatorCost(*(MICROSECOND * found[key] for key in EstimatorCost._fields))


@cache
def _table() -> Mapping[str, Mapping]:  # type: ignore[type-arg]
    return tomllib.loads(FILE.read_text(encoding="utf-8"))
