"""The parameters of a component as editable entries: each by its dotted path, with its declaration."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from fraexp.components.kinds import Component, nested_kind, parameter_group
from fraexp.components.parameters import TYPICAL, Parameters, typical_value, unit_of
from fraexp.components.registry import Registry
from fraexp.data import toml
from fraexp.errors import FraexpError
from fraexp.views.components import parameter_document

EXAMPLE_PRESET = "linear_motor_table"
"""Preset of the example machine, which is preferred where a component has it."""
EXAMPLE_LIST_LENGTH = 2
"""Length of an example list for a required parameter without a preset."""


@dataclass(frozen=True)
class ParameterEntry:
    """An editable parameter."""

    path: str
    info: FieldInfo
    text: str
    """Its value as written in a study; empty if it is not given."""
    rotary: bool = False
    """Whether it is that of a rotary axis."""

    @property
    def hint(self) -> str:
        """Meaning, unit, bounds and default, in one line."""
        document = parameter_document(self.path, self.info, rotary=self.rotary)
        bounds = [f"{sign} {value:g}" for sign, value in document["bounds"].items()]
        unit = "" if document["unit"] in ("", "1") else f"[{document['unit']}]"
        default = document["default"]
        known = (
            "required" if document["required"] else "" if default in (None, []) else f"default {toml.dumps(default)}"
        )
        few = [choice for choice in self.choices if choice not in document["meaning"]]
        listed = f"one of {', '.join(few)}" if few else ""
        return ", ".join(part for part in (f"{document['meaning']} {unit}".strip(), *bounds, listed, known) if part)

    @property
    def choices(self) -> tuple[str, ...]:
        """The allowed values, if they are few."""
        for part in (self.info.annotation, *get_args(self.info.annotation)):
            if get_origin(part) is Literal:
                return tuple(str(value) for value in get_args(part))
            if part is bool:
                return ("true", "false")
        return ()

    @property
    def is_whole(self) -> bool:
        """Whether it is a whole number."""
        return int in (self.info.annotation, *get_args(self.info.annotation))

    def next_text(self, text: str, share: float) -> str:
        """Return the text of a number increased by a fraction of itself, within bounds; or the next allowed value."""
        if self.choices:
            index = self.choices.index(text) if text in self.choices else -1
            return self.choices[(index + (1 if share > 0 else -1)) % len(self.choices)]
        head, blank, unit = text.strip().partition(" ")
        try:
            value = float(head)
        except ValueError:
            return text
        if self.is_whole:
            return f"{self._clamp(value + (1 if share > 0 else -1)):.0f}{blank}{unit}"
        moved = value * (1 + share) if share > 0 else value / (1 - share)
        moved = moved if value or share < 0 else TYPICAL.get(unit_of(self.info), 1.0) * share
        return f"{float(f'{moved if unit else self._clamp(moved):.4g}'):.10g}{blank}{unit}"

    def _clamp(self, value: float) -> float:
        for item in self.info.metadata:
            value = max(value, getattr(item, "ge", value))
            value = min(value, getattr(item, "le", value))
        return value


def example_spec(component: type[Component], registry: Registry) -> dict[str, object]:
    """Return a component in plain data with sensible values for all parameters: of a preset, else typical ones."""
    presets = component.presets
    given = presets.get(EXAMPLE_PRESET) or next(iter(presets.values()), None) or _typical_values(component)
    try:
        made = registry.create(component.kind, {"name": component.name, **given})
    except FraexpError:  # typical values may not fit together; creating it later reports why
        return {"name": component.name, **given}
    return {key: value for key, value in made.spec().items() if key != "version"}


def _typical_values(component: type[Component]) -> dict[str, object]:
    required = {name: info for name, info in component.model_fields.items() if info.is_required()}
    return {name: value for name, info in required.items() if (value := _typical_value(info)) is not None}


def _typical_value(info: FieldInfo) -> object:
    entry = ParameterEntry("", info, "")
    if entry.choices:
        return entry.choices[0]
    if nested_kind(info) is not None:
        return None
    value = typical_value(info)
    if get_origin(info.annotation) is tuple:
        return [1 / EXAMPLE_LIST_LENGTH if unit_of(info) == "1" else value] * EXAMPLE_LIST_LENGTH
    if entry.is_whole:
        return int(max(value, 1))
    return value if float in (info.annotation, *get_args(info.annotation)) else None


def parameter_entries(
    owner: type[Parameters], values: Mapping[str, object], registry: Registry, prefix: str = ""
) -> Iterator[ParameterEntry]:
    """Yield all parameters of a component and of nested components, with their values in plain data."""
    for name, info in owner.model_fields.items():
        path, value, inner = f"{prefix}{name}", values.get(name), nested_kind(info)
        group = parameter_group(info)
        listed: list[Any] = list(value) if isinstance(value, list | tuple) else [value]
        if inner is not None and listed and all(isinstance(part, Mapping) for part in listed):
            for index, part in enumerate(listed):
                provider = registry.providers.get((inner.kind, str(part.get("name"))))
                place = path if isinstance(value, Mapping) else f"{path}.{index}"
                yield from parameter_entries(provider.component, part, registry, f"{place}.") if provider else ()
        elif group is not None and isinstance(value, Mapping):
            yield from parameter_entries(group, value, registry, f"{path}.")
        else:
            yield ParameterEntry(path, info, entry_text(value))


def entry_text(value: object) -> str:
    """Return a value as text; None and empty lists give an empty text."""
    if value is None or value in ([], ()):
        return ""
    if isinstance(value, float):
        return f"{value:.10g}"
    return value if isinstance(value, str) else toml.dumps(value)


def apply_texts(base: Mapping[str, object], texts: Mapping[str, str]) -> dict[str, Any]:
    """Return plain data with texts applied at their paths; an empty text removes the value."""
    data = _copy_without_version(base)
    for path, text in texts.items():
        *parents, last = path.split(".")
        place: Any = data
        for part in parents:
            place = place[int(part)] if isinstance(place, list) else place[part]
        if text.strip():
            place[last] = toml.value(text)
        else:
            place.pop(last, None)
    return data


def _copy_without_version(value: object) -> Any:
    if isinstance(value, Mapping):
        return {key: _copy_without_version(item) for key, item in value.items() if key != "version"}
    return [_copy_without_version(item) for item in value] if isinstance(value, list | tuple) else value


def without_defaults(owner: type[Parameters], data: Mapping[str, Any], registry: Registry) -> dict[str, Any]:
    """Return plain data without values that equal the declared defaults."""
    kept: dict[str, Any] = {"name": data["name"]} if "name" in data else {}
    for name, info in owner.model_fields.items():
        if name not in data:
            continue
        value, inner, group = data[name], nested_kind(info), parameter_group(info)
        default = None if info.is_required() else info.get_default(call_default_factory=True, validated_data={})
        if not info.is_required() and (value == default or (isinstance(default, tuple) and tuple(value) == default)):
            continue
        if inner is not None and isinstance(value, list):
            value = [_component_without_defaults(inner.kind, part, registry) for part in value]
        elif inner is not None and isinstance(value, Mapping):
            value = _component_without_defaults(inner.kind, value, registry)
        elif group is not None and isinstance(value, Mapping):
            value = without_defaults(group, value, registry)
        kept[name] = value
    return kept


def _component_without_defaults(kind: str, data: Any, registry: Registry) -> Any:
    name = data.get("name") if isinstance(data, Mapping) else None
    provider = registry.providers.get((kind, str(name)))
    return without_defaults(provider.component, data, registry) if provider else data
