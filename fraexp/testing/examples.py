"""Examples of components, drawn from their presets and from the declared bounds of their parameters."""

from collections.abc import Mapping
from functools import cache
from typing import Any, TypeVar, cast, get_args, get_origin

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from pydantic.fields import FieldInfo

from fraexp.components.kinds import Component, nested_kind, parameter_group
from fraexp.components.parameters import Parameters, typical_value, unit_of, value_bounds
from fraexp.components.registry import Registry, discover
from fraexp.errors import FraexpError

AnyComponent = TypeVar("AnyComponent", bound=Component)
MAX_DECADES = 0.5
"""Decades by which a number is drawn below or above its preset."""
DEFAULT_LIST_LENGTH = 2
"""Number of values of a list that no preset gives."""


def strategy(component: type[Component]) -> SearchStrategy[Component]:
    """Return a strategy that draws instances of a component class.

    Numbers are those of a preset, else the default, else within two declared bounds, else typical of the unit,
    each times a factor that is drawn log-uniformly; the numbers of a list share one. A least value that is allowed is
    drawn as well. What the class refuses is drawn again.
    """
    bases = list(component.presets.values()) or [{}]
    return st.sampled_from(bases).flatmap(lambda base: _component_strategy(component, base))


def is_number(info: FieldInfo) -> bool:
    """Whether a parameter is a single number with a unit or of unit 1."""
    return float in (info.annotation, *get_args(info.annotation)) and get_origin(info.annotation) is not tuple


def try_build(component: type[AnyComponent], values: Mapping[str, object]) -> AnyComponent | None:
    """Return an instance, or None if the class refuses the values."""
    try:
        return component.parse(values, component.name)
    except FraexpError:
        return None


def _component_strategy(component: type[Component], base: Mapping[str, object]) -> SearchStrategy[Component]:
    built = _values_strategy(component, base).map(lambda values: try_build(component, values))
    return cast("SearchStrategy[Component]", built.filter(lambda example: example is not None))


def _values_strategy(owner: type[Parameters], base: Mapping[str, object]) -> SearchStrategy[dict[str, object]]:
    drawn = {name: _parameter_strategy(info, base.get(name)) for name, info in owner.model_fields.items()}
    return st.fixed_dictionaries({name: values for name, values in drawn.items() if values is not None})


def _parameter_strategy(info: FieldInfo, base: Any) -> SearchStrategy[object] | None:
    """Return the strategy of one parameter; None to leave it at its default."""
    nested, group = nested_kind(info), parameter_group(info)
    if nested is not None:
        return _nested_strategy(nested, info, base)
    if group is not None:
        return _values_strategy(group, base) if isinstance(base, Mapping) else None
    if get_origin(info.annotation) is tuple:
        return _list_strategy(info, base)
    if not is_number(info):
        return st.just(base) if base is not None else _plain_strategy(info)
    return _number_strategy(info, base)


def _number_strategy(info: FieldInfo, base: Any) -> SearchStrategy[float] | None:
    low, high = value_bounds(info)
    start = base if base is not None else None if info.is_required() else info.default
    if low is not None and high is not None and unit_of(info) == "1":
        return st.floats(low, high)
    if start is None:
        return _scaled_strategy(typical_value(info), low, high) if info.is_required() else None
    if start == 0:
        return st.one_of(st.just(0.0), _scaled_strategy(typical_value(info), low, high))
    scaled = _scaled_strategy(float(start), low, high)
    included = [item.ge for item in info.metadata if hasattr(item, "ge")]
    return st.one_of(scaled, st.just(float(included[0]))) if included else scaled


def _scaled_strategy(value: float, low: float | None, high: float | None) -> SearchStrategy[float]:
    def scale_within_bounds(decades: float) -> float:
        scaled = value * 10.0**decades
        return min(max(scaled, low if low is not None else scaled), high if high is not None else scaled)

    return _decade_strategy().map(scale_within_bounds)


def _decade_strategy() -> SearchStrategy[float]:
    return st.integers(-8, 8).map(lambda eighths: MAX_DECADES * eighths / 8)  # few steps: readable smallest examples


def _list_strategy(info: FieldInfo, base: Any) -> SearchStrategy[object] | None:
    if base is None and not info.is_required():
        return None
    values = list(base) if base is not None else [typical_value(info)] * DEFAULT_LIST_LENGTH
    if unit_of(info) in ("1", "") or not all(isinstance(value, int | float) for value in values):
        return st.just(tuple(values))  # shares, names: no common factor fits
    return _decade_strategy().map(lambda decades: tuple(value * 10.0**decades for value in values))


def _plain_strategy(info: FieldInfo) -> SearchStrategy[object] | None:
    if not info.is_required():
        return None
    low, _ = value_bounds(info)
    plain: dict[object, SearchStrategy[object]] = {int: st.just(int(low or 1)), bool: st.booleans(), str: st.just("x")}
    return plain.get(info.annotation)


def _nested_strategy(kind: type[Component], info: FieldInfo, base: Any) -> SearchStrategy[object] | None:
    """Return the strategy of the components inside a component: those of its preset, else one that has a preset."""
    several = get_origin(info.annotation) is tuple
    if base is None and not info.is_required():
        return None
    specs = base if several else [base]
    if base is None:
        specs = [{"name": _name_with_preset(kind.kind)}]
    parts = st.tuples(*(_spec_strategy(kind.kind, spec) for spec in specs))
    return parts if several else parts.map(lambda drawn: drawn[0])


def _spec_strategy(kind: str, spec: Mapping[str, Any]) -> SearchStrategy[Component]:
    component = installed_components().provider(kind, spec["name"]).component
    preset = component.presets.get(spec.get("preset", ""), {})
    given = {**preset, **{key: value for key, value in spec.items() if key not in ("name", "version", "preset")}}
    return _component_strategy(component, given) if given else strategy(component)


def _name_with_preset(kind: str) -> str:
    names = installed_components().names(kind)
    return next((name for name in names if installed_components().provider(kind, name).component.presets), names[0])


@cache
def installed_components() -> Registry:
    """Return all installed components."""
    return discover()
