"""Components as plugins declare them: plain data, and a row for each parameter."""

from typing import Any

from pydantic.fields import FieldInfo

from fraexp.parameters import inherited_from, unit_of
from fraexp.plugins import Supply
from fraexp.views.words import value_text

BOUNDS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}


def component_document(supply: Supply) -> dict[str, Any]:
    """Return a component with its parameters."""
    component = supply.component
    return {
        "kind": component.kind,
        "name": component.name,
        "version": component.version,
        "meaning": (component.__doc__ or "").strip().partition("\n")[0],
        "distribution": supply.distribution,
        "file": str(supply.file),
        "parameters": [parameter_document(name, info) for name, info in component.model_fields.items()],
    }


def parameter_document(name: str, info: FieldInfo) -> dict[str, Any]:
    """Return a parameter as it was declared."""
    bounds = {word: getattr(item, word) for item in info.metadata for word in BOUNDS if hasattr(item, word)}
    return {
        "name": name,
        "unit": unit_of(info),
        "meaning": info.description or "",
        "required": info.is_required() and inherited_from(info) is None,
        "default": None if info.is_required() else _plain_default(info),
        "inherited_from": inherited_from(info),
        "bounds": {BOUNDS[word]: value for word, value in bounds.items()},
    }


def _plain_default(info: FieldInfo) -> Any:
    default = info.get_default(call_default_factory=True, validated_data={})
    if isinstance(default, tuple):
        return list(default)
    return default if isinstance(default, int | float | str | bool | None) else str(default)


def parameter_row(parameter: dict[str, Any]) -> list[str]:
    """Return name, unit, default, bounds and meaning of a parameter."""
    default = "required" if parameter["required"] else value_text(parameter["default"])
    if parameter["inherited_from"]:
        default = f"from {parameter['inherited_from']}"
    bounds = ", ".join(f"{sign} {value:g}" for sign, value in parameter["bounds"].items())
    return [f"  {parameter['name']}", parameter["unit"], default, bounds, parameter["meaning"]]
