"""``fraexp plugins``: what plugins supply, and which are broken."""

from argparse import Namespace
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo

from fraexp.cli.exits import ExitCode
from fraexp.cli.terminal import print_fields, print_json, print_table, say
from fraexp.cli.words import plural, value_text
from fraexp.figures.labels import printable
from fraexp.parameters import inherited_from, unit_of
from fraexp.plugins import Supply, discover

BOUNDS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
COLUMNS = ["  parameter", "unit", "default", "bounds", "meaning"]


def execute(arguments: Namespace) -> ExitCode:
    """Print every component with its parameters, then the plugins that failed."""
    registry = discover(Path(arguments.workspace) / "plugins")
    supplies = [registry.supplies[name] for name in sorted(registry.supplies)]
    if arguments.json:
        failures = [{"place": failure.place, "reason": failure.reason} for failure in registry.failures]
        print_json({"components": [_document(supply) for supply in supplies], "failures": failures})
        return ExitCode.USAGE if failures else ExitCode.OK
    for supply in supplies:
        _print(_document(supply))
    if registry.failures:
        print("broken")
        print_fields([(failure.place, failure.reason) for failure in registry.failures], indent=2)
        say(f"{plural(len(registry.failures), 'plugin')} cannot be used; the others can")
    return ExitCode.USAGE if registry.failures else ExitCode.OK


def _document(supply: Supply) -> dict[str, Any]:
    component = supply.component
    return {
        "kind": component.kind,
        "name": component.name,
        "version": component.version,
        "meaning": (component.__doc__ or "").strip().partition("\n")[0],
        "distribution": supply.distribution,
        "file": str(supply.file),
        "parameters": [_parameter(name, info) for name, info in component.model_fields.items()],
    }


def _parameter(name: str, info: FieldInfo) -> dict[str, Any]:
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


def _print(document: dict[str, Any]) -> None:
    origin = document["file"] if document["distribution"] == "workspace" else document["distribution"]
    print(printable(f"{document['kind']} {document['name']}  version {document['version']}, {origin}"))
    print(printable(f"  {document['meaning']}"))
    rows = [_row(parameter) for parameter in document["parameters"]]
    if rows:
        print_table(COLUMNS, rows)
    print()


def _row(parameter: dict[str, Any]) -> list[str]:
    default = "required" if parameter["required"] else value_text(parameter["default"])
    if parameter["inherited_from"]:
        default = f"from {parameter['inherited_from']}"
    bounds = ", ".join(f"{sign} {value:g}" for sign, value in parameter["bounds"].items())
    return [f"  {parameter['name']}", parameter["unit"], default, bounds, parameter["meaning"]]
