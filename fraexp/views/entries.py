"""A component's parameters as lines that can be written: each by its dotted path, with what declares it."""

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from fraexp.components.kinds import Component, nested_kind
from fraexp.components.parameters import TYPICAL, Parameters, unit_of
from fraexp.components.registry import Registry
from fraexp.data import toml
from fraexp.errors import FraexpError
from fraexp.views.components import parameter_document
from fraexp.views.fields import toml_value

MACHINE = "linear_motor_table"
"""Preset that is shown first, where a component has it: the machine of the examples."""
LIST = 2
"""Values of a list that has to be given and no preset gives."""


@dataclass(frozen=True)
class ParameterEntry:
    """A parameter that can be written."""

    path: str
    info: FieldInfo
    text: str
    """Its value as a study writes it; empty for one that is not given."""

    @property
    def hint(self) -> str:
        """Meaning, unit, bounds and default, in one line."""
        document = parameter_document(self.path, self.info)
        bounds = [f"{sign} {value:g}" for sign, value in document["bounds"].items()]
        unit = "" if document["unit"] in ("", "1") else f"[{document['unit']}]"
        default = document["default"]
        known = "needed" if document["required"] else "" if default in (None, []) else f"default {toml_value(default)}"
        few = [choice for choice in self.choices if choice not in document["meaning"]]
        listed = f"one of {', '.join(few)}" if few else ""
        return ", ".join(part for part in (f"{document['meaning']} {unit}".strip(), *bounds, listed, known) if part)

    @property
    def choices(self) -> tuple[str, ...]:
        """The values that it may have, if they are few."""
        for part in (self.info.annotation, *get_args(self.info.annotation)):
            if get_origin(part) is Literal:
                return tuple(str(value) for value in get_args(part))
            if part is bool:
                return ("true", "false")
        return ()

    @property
    def whole(self) -> bool:
        """Whether it is a whole number."""
        return int in (self.info.annotation, *get_args(self.info.annotation))

    def moved(self, text: str, share: float) -> str:
        """Return a number that is greater by a share of itself, within the bounds; or the next of few values."""
        if self.choices:
            index = self.choices.index(text) if text in self.choices else -1
            return self.choices[(index + (1 if share > 0 else -1)) % len(self.choices)]
        head, blank, unit = text.strip().partition(" ")
        try:
            value = float(head)
        except ValueError:
            return text
        if self.whole:
            return f"{self._inside(value + (1 if share > 0 else -1)):.0f}{blank}{unit}"
        moved = value * (1 + share) if share > 0 else value / (1 - share)
        moved = moved if value or share < 0 else TYPICAL.get(unit_of(self.info), 1.0) * share
        return f"{float(f'{moved if unit else self._inside(moved):.4g}'):.10g}{blank}{unit}"

    def _inside(self, value: float) -> float:
        for item in self.info.metadata:
            value = max(value, getattr(item, "ge", value))
            value = min(value, getattr(item, "le", value))
        return value


def example(component: type[Component], registry: Registry) -> dict[str, Any]:
    """Return a component in plain data with sensible values: of a preset, else what is typical; all that it takes."""
    presets = component.presets
    given = presets.get(MACHINE) or next(iter(presets.values()), None) or _typical(component)
    try:
        made = registry.create(component.kind, {"name": component.name, **given})
    except FraexpError:  # what is typical need not fit; its author will see why
        return {"name": component.name, **given}
    return {key: value for key, value in made.spec().items() if key != "version"}


def _typical(component: type[Component]) -> dict[str, Any]:
    required = {name: info for name, info in component.model_fields.items() if info.is_required()}
    return {name: value for name, info in required.items() if (value := _of_unit(info)) is not None}


def _of_unit(info: FieldInfo) -> Any:
    entry = ParameterEntry("", info, "")
    if entry.choices:
        return entry.choices[0]
    if nested_kind(info) is not None:
        return None
    value = TYPICAL.get(unit_of(info), 1.0)
    low = next((getattr(item, word) for item in info.metadata for word in ("ge", "gt") if hasattr(item, word)), None)
    high = next((getattr(item, word) for item in info.metadata for word in ("le", "lt") if hasattr(item, word)), None)
    if low is not None and high is not None:
        value = (low + high) / 2
    elif (low is not None and value <= low) or (high is not None and value >= high):
        value = 2 * low if low else (high or 0.0) / 2
    if get_origin(info.annotation) is tuple:
        return [1 / LIST if unit_of(info) == "1" else value] * LIST
    if entry.whole:
        return int(max(value, 1))
    return value if float in (info.annotation, *get_args(info.annotation)) else None


def entries(
    owner: type[Parameters], values: Mapping[str, Any], registry: Registry, prefix: str = ""
) -> Iterator[ParameterEntry]:
    """Yield all parameters of a component and of what it holds, with the values that plain data give them."""
    for name, info in owner.model_fields.items():
        path, value, inner = f"{prefix}{name}", values.get(name), nested_kind(info)
        group = _group(info)
        listed: list[Any] = list(value) if isinstance(value, list | tuple) else [value]
        if inner is not None and listed and all(isinstance(part, Mapping) for part in listed):
            for index, part in enumerate(listed):
                supply = registry.supplies.get((inner.kind, str(part.get("name"))))
                place = path if isinstance(value, Mapping) else f"{path}.{index}"
                yield from entries(supply.component, part, registry, f"{place}.") if supply else ()
        elif group is not None and isinstance(value, Mapping):
            yield from entries(group, value, registry, f"{path}.")
        else:
            yield ParameterEntry(path, info, _text(value))


def _group(info: FieldInfo) -> type[Parameters] | None:
    candidates = (info.annotation, *get_args(info.annotation))
    return next((of for of in candidates if inspect.isclass(of) and issubclass(of, Parameters)), None)


def _text(value: Any) -> str:
    if value is None or value in ([], ()):
        return ""
    if isinstance(value, float):
        return f"{value:.10g}"
    return value if isinstance(value, str) else toml_value(value)


def written(base: Mapping[str, Any], texts: Mapping[str, str]) -> dict[str, Any]:
    """Return plain data with the values that were written at their paths; what is empty is left out."""
    data = _copied(base)
    for path, text in texts.items():
        *parents, last = path.split(".")
        place: Any = data
        for part in parents:
            place = place[int(part)] if isinstance(place, list) else place[part]
        if text.strip():
            place[last] = _value(text.strip())
        else:
            place.pop(last, None)
    return data


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _copied(item) for key, item in value.items() if key != "version"}
    return [_copied(item) for item in value] if isinstance(value, list | tuple) else value


def _value(text: str) -> Any:
    try:
        return toml.value(text)
    except ValueError:
        return text


def told(owner: type[Parameters], data: Mapping[str, Any], registry: Registry) -> dict[str, Any]:
    """Return plain data without what is as declared anyway."""
    kept: dict[str, Any] = {"name": data["name"]} if "name" in data else {}
    for name, info in owner.model_fields.items():
        if name not in data:
            continue
        value, inner, group = data[name], nested_kind(info), _group(info)
        default = None if info.is_required() else info.get_default(call_default_factory=True, validated_data={})
        if not info.is_required() and (value == default or (isinstance(default, tuple) and tuple(value) == default)):
            continue
        if inner is not None and isinstance(value, list):
            value = [_told_component(inner.kind, part, registry) for part in value]
        elif inner is not None and isinstance(value, Mapping):
            value = _told_component(inner.kind, value, registry)
        elif group is not None and isinstance(value, Mapping):
            value = told(group, value, registry)
        kept[name] = value
    return kept


def _told_component(kind: str, data: Any, registry: Registry) -> Any:
    name = data.get("name") if isinstance(data, Mapping) else None
    supply = registry.supplies.get((kind, str(name)))
    return told(supply.component, data, registry) if supply else data
