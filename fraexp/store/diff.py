"""Differences between two results of one sweep."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import Result

PARTS = ("outcome", "findings", "response", "metrics", "curves", "fits", "numerics")
MAX_NAMED = 3
"""Maximum number of differences of a part that are named."""


def describe_differences(ours: Result, theirs: Result) -> tuple[tuple[str, ...], str]:
    """Return the names of the parts in which two results differ, and a description; both empty if they are equal."""
    found = {name: list(_differences("", getattr(ours, name), getattr(theirs, name))) for name in PARTS}
    differing = {name: how for name, how in found.items() if how}
    return tuple(differing), "; ".join(f"{name}: {_short_list(how)}" for name, how in differing.items())


def _differences(name: str, here: Any, there: Any) -> Iterator[str]:
    """Yield how two values of a name differ, and the values inside them."""
    if isinstance(here, np.ndarray) and isinstance(there, np.ndarray):
        text = _array_difference(here, there)
        if text:
            yield f"{name} {text}"
    elif is_dataclass(here) and is_dataclass(there):
        inner = getattr(here, "name", name)
        for item in fields(here):
            label = inner if item.name in ("value", "columns") else f"{inner} {item.name}".strip()
            yield from _differences(label, getattr(here, item.name), getattr(there, item.name))
    elif isinstance(here, Mapping) and isinstance(there, Mapping) and list(here) == list(there):
        for key in here:
            yield from _differences(f"{name} {key}".strip(), here[key], there[key])
    elif _is_list(here) and _is_list(there) and len(here) == len(there):
        for one, other in zip(here, there, strict=True):
            yield from _differences(name, one, other)
    elif here is None or there is None or _is_list(here) or isinstance(here, Mapping):
        if here is not there:
            yield f"{name} in one alone".strip()
    elif here != there and not (_is_nan(here) and _is_nan(there)):
        yield f"{name} {_text(here)} here, {_text(there)} there".strip()


def _array_difference(one: NDArray[np.generic], other: NDArray[np.generic]) -> str:
    """Return how two arrays differ: how far, relative to the largest value; empty if they are equal."""
    if one.shape != other.shape:
        return f"has {one.shape} here, {other.shape} there"
    if one.tobytes() == other.tobytes() or np.array_equal(one, other, equal_nan=True):
        return ""
    here, there = (np.asarray(values, complex).ravel() for values in (one, other))
    finite = np.isfinite(here) & np.isfinite(there)
    if not np.array_equal(here[~finite], there[~finite], equal_nan=True):
        return "by values that are not finite in one alone"
    scale = float(np.abs(here[finite]).max(initial=0.0)) or 1.0
    return f"by {float(np.abs(here[finite] - there[finite]).max(initial=0.0)) / scale:.1e}"


def _is_list(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _text(value: object) -> str:
    if isinstance(value, Enum):
        return value.name.lower()
    return f"{value:g}" if isinstance(value, float) else f'"{value}"'


def _short_list(found: Sequence[str]) -> str:
    return ", ".join(found[:MAX_NAMED]) + (f" and {len(found) - MAX_NAMED} more" if len(found) > MAX_NAMED else "")
