"""Differences between two results of one sweep."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import Curve, Fit, FrequencyResponse, Metric, Result


def describe_differences(ours: Result, theirs: Result) -> tuple[tuple[str, ...], str]:
    """Return the names of the parts in which two results differ, and a description; both empty if they are equal."""
    found = {
        "outcome": ""
        if ours.outcome is theirs.outcome
        else f"{ours.outcome.name.lower()} here, {theirs.outcome.name.lower()} there",
        "message": _text(ours.message, theirs.message),
        "response": _response(ours.response, theirs.response),
        "metrics": _metrics(ours.metrics, theirs.metrics),
        "curves": _curves(ours.curves, theirs.curves),
        "fits": _fits(ours.fits, theirs.fits),
        "numerics": _text(ours.numerics, theirs.numerics),
    }
    differing = {name: how for name, how in found.items() if how}
    return tuple(differing), "; ".join(f"{name}: {how}" for name, how in differing.items())


def _text(ours: str, theirs: str) -> str:
    return "" if ours == theirs else f'"{ours}" here, "{theirs}" there'


def _response(ours: FrequencyResponse | None, theirs: FrequencyResponse | None) -> str:
    if ours is None or theirs is None:
        return "" if ours is theirs else "only one has it"
    pairs = {item.name: (getattr(ours, item.name), getattr(theirs, item.name)) for item in fields(ours)}
    texts = [name for name, (one, _) in pairs.items() if isinstance(one, str)]
    differing = [name for name in texts if pairs[name][0] != pairs[name][1]]
    return _short_list([*differing, *_arrays({name: pair for name, pair in pairs.items() if name not in texts})])


def _metrics(ours: Sequence[Metric], theirs: Sequence[Metric]) -> str:
    if [(item.name, item.unit) for item in ours] != [(item.name, item.unit) for item in theirs]:
        return "other names or units"
    pairs = zip(ours, theirs, strict=True)
    differing = [
        (one, other) for one, other in pairs if one.value != other.value and not _both_nan(one.value, other.value)
    ]
    return _short_list([f"{one.name} is {one.value:g} here, {other.value:g} there" for one, other in differing])


def _curves(ours: Sequence[Curve], theirs: Sequence[Curve]) -> str:
    names = [[(item.name, list(item.columns), dict(item.units)) for item in side] for side in (ours, theirs)]
    if names[0] != names[1]:
        return "other names or units"
    pairs = zip(ours, theirs, strict=True)
    found = []
    for one, other in pairs:
        found += _arrays({name: (one.columns[name], other.columns[name]) for name in one.columns})
    return _short_list(found)


def _fits(ours: Sequence[Fit], theirs: Sequence[Fit]) -> str:
    names = [[(item.kind, tuple(item.parameters), tuple(item.units)) for item in side] for side in (ours, theirs)]
    if names[0] != names[1]:
        return "other parameters"
    if [dict(item.component) for item in ours] != [dict(item.component) for item in theirs]:
        return "other components"
    found = []
    for one, other in zip(ours, theirs, strict=True):
        found += _arrays({"values": (one.values, other.values), "covariance": (one.covariance, other.covariance)})
    return _short_list(found)


def _arrays(pairs: Mapping[str, tuple[NDArray[np.generic] | None, NDArray[np.generic] | None]]) -> list[str]:
    """Return a description of each array that differs: how far, relative to the largest value."""
    found = []
    for name, (one, other) in pairs.items():
        if one is None or other is None:
            found += [] if one is other else [f"{name} in one alone"]
        elif one.shape != other.shape:
            found.append(f"{name} has {one.shape} here, {other.shape} there")
        elif one.tobytes() != other.tobytes() and not np.array_equal(one, other, equal_nan=True):
            found.append(f"{name} by {_distance(one, other)}")
    return found


def _distance(one: NDArray[np.generic], other: NDArray[np.generic]) -> str:
    here, there = (np.asarray(values, complex).ravel() for values in (one, other))
    finite = np.isfinite(here) & np.isfinite(there)
    if not np.array_equal(here[~finite], there[~finite], equal_nan=True):
        return "values that are not finite in one alone"
    scale = float(np.abs(here[finite]).max(initial=0.0)) or 1.0
    return f"{float(np.abs(here[finite] - there[finite]).max(initial=0.0)) / scale:.1e}"


def _short_list(found: Sequence[str]) -> str:
    return ", ".join(found[:3]) + (f" and {len(found) - 3} more" if len(found) > 3 else "")


def _both_nan(one: float, other: float) -> bool:
    return math.isnan(one) and math.isnan(other)
