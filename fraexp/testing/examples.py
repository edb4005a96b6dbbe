"""Examples of components, drawn from their presets and from the declared bounds of their parameters."""

import inspect
from collections.abc import Mapping
from functools import cache
from typing import Any, get_args, get_origin

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from pydantic.fields import FieldInfo

from fraexp.components.kinds import Component, nested_kind
from fraexp.components.parameters import TYPICAL, Parameters, unit_of
from fraexp.components.registry import Registry, discover
from fraexp.errors import FraexpError

DECADES = 0.5
"""By how many decades a number is drawn below or above its preset."""
LIST = 2
"""Values of a list that no preset gives."""


def strategy(component: type[Component]) -> SearchStrategy[Any]:
    """Return a strategy that draws instances of a component class.

    Numbers are those of a preset, else the default, else within two declared bounds, else typical of the unit,
    each times a factor that is drawn log-uniformly; the numbers of a list share one. A least value that is allowed is
    drawn as well. What the class refuses is drawn again.
    """
    bases = list(component.presets.values()) or [{}]
    return st.sampled_from(bases).flatmap(lambda base: _component(component, base))


def numbers(info: FieldInfo) -> bool:
    """Whether a parameter is a single number with a unit or of unit 1."""
    return float in (info.annotation, *get_args(info.annotation)) and get_origin(info.annotation) is not tuple


def bounds(info: FieldInfo) -> tuple[float | None, float | None]:
    """Return the least and the greatest value of a parameter, inside of exclusive bounds; None where there is none."""
    declared = {word: getattr(item, word) for item in info.metadata for word in LIMITS if hasattr(item, word)}
    low, high = declared.get("ge"), declared.get("le")
    span = typical(info)
    if "gt" in declared:
        low = declared["gt"] + 1e-6 * span
    if "lt" in declared:
        high = declared["lt"] - 1e-6 * span
    return low, high


LIMITS = ("gt", "ge", "lt", "le")


def typical(info: FieldInfo) -> float:
    """Return a magnitude that is typical of a parameter's unit."""
    return TYPICAL.get(unit_of(info), 1.0)


def built(component: type[Component], values: Mapping[str, Any]) -> Any:
    """Return an instance, or None if the class refuses the values."""
    try:
        return component.parse(values, component.name)
    except FraexpError:
        return None


def _component(component: type[Component], base: Mapping[str, Any]) -> SearchStrategy[Any]:
    return _values(component, base).map(lambda values: built(component, values)).filter(lambda made: made is not None)


def _values(owner: type[Parameters], base: Mapping[str, Any]) -> SearchStrategy[dict[str, Any]]:
    drawn = {name: _value(info, base.get(name)) for name, info in owner.model_fields.items()}
    return st.fixed_dictionaries({name: values for name, values in drawn.items() if values is not None})


def _value(info: FieldInfo, base: Any) -> SearchStrategy[Any] | None:
    """Return the strategy of one parameter; None to leave it at its default."""
    nested, group = nested_kind(info), _group(info)
    if nested is not None:
        return _nested(nested, info, base)
    if group is not None:
        return _values(group, base) if isinstance(base, Mapping) else None
    if get_origin(info.annotation) is tuple:
        return _list(info, base)
    if not numbers(info):
        return st.just(base) if base is not None else _plain(info)
    return _number(info, base)


def _group(info: FieldInfo) -> type[Parameters] | None:
    candidates = (info.annotation, *get_args(info.annotation))
    return next((part for part in candidates if inspect.isclass(part) and issubclass(part, Parameters)), None)


def _number(info: FieldInfo, base: Any) -> SearchStrategy[float] | None:
    low, high = bounds(info)
    start = base if base is not None else None if info.is_required() else info.default
    if low is not None and high is not None and unit_of(info) == "1":
        return st.floats(low, high)
    if start is None:
        return _scaled(_middle(info), low, high) if info.is_required() else None
    if start == 0:
        return st.one_of(st.just(0.0), _scaled(typical(info), low, high))
    scaled = _scaled(float(start), low, high)
    included = [item.ge for item in info.metadata if hasattr(item, "ge")]
    return st.one_of(scaled, st.just(float(included[0]))) if included else scaled


def _middle(info: FieldInfo) -> float:
    low, high = bounds(info)
    return float((low + high) / 2 if low is not None and high is not None else typical(info))


def _scaled(value: float, low: float | None, high: float | None) -> SearchStrategy[float]:
    def inside(decades: float) -> float:
        scaled = value * 10.0**decades
        return min(max(scaled, low if low is not None else scaled), high if high is not None else scaled)

    return _decades().map(inside)


def _decades() -> SearchStrategy[float]:
    return st.integers(-8, 8).map(lambda eighths: DECADES * eighths / 8)  # few steps: readable smallest examples


def _list(info: FieldInfo, base: Any) -> SearchStrategy[Any] | None:
    if base is None and not info.is_required():
        return None
    values = list(base) if base is not None else [_middle(info)] * LIST
    if unit_of(info) in ("1", "") or not all(isinstance(value, int | float) for value in values):
        return st.just(tuple(values))  # shares, names: no common factor fits
    return _decades().map(lambda decades: tuple(value * 10.0**decades for value in values))


def _plain(info: FieldInfo) -> SearchStrategy[Any] | None:
    if not info.is_required():
        return None
    low, _ = bounds(info)
    plain: dict[Any, SearchStrategy[Any]] = {int: st.just(int(low or 1)), bool: st.booleans(), str: st.just("x")}
    return plain.get(info.annotation)


def _nested(kind: type[Component], info: FieldInfo, base: Any) -> SearchStrategy[Any] | None:
    """Draw the components that a component holds: of its preset, else one (or a list of one) that has a preset."""
    several = get_origin(info.annotation) is tuple
    if base is None and not info.is_required():
        return None
    specs = base if several else [base]
    if base is None:
        specs = [{"name": _with_preset(kind.kind)}]
    parts = st.tuples(*(_of_spec(kind.kind, spec) for spec in specs))
    return parts if several else parts.map(lambda drawn: drawn[0])


def _of_spec(kind: str, spec: Mapping[str, Any]) -> SearchStrategy[Any]:
    component = installed().supply(kind, spec["name"]).component
    preset = component.presets.get(spec.get("preset", ""), {})
    given = {**preset, **{key: value for key, value in spec.items() if key not in ("name", "version", "preset")}}
    return _component(component, given) if given else strategy(component)


def _with_preset(kind: str) -> str:
    names = installed().names(kind)
    return next((name for name in names if installed().supply(kind, name).component.presets), names[0])


@cache
def installed() -> Registry:
    """Return all installed components."""
    return discover()
