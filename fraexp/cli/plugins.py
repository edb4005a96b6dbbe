"""``fraexp plugins``: the components that plugins provide, and the plugins that fail to load."""

from argparse import Namespace
from typing import Any

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_fields, print_json, print_line, print_table, say
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.data.units import with_powers
from fraexp.views.components import component_document, parameter_row
from fraexp.views.words import plural

COLUMNS = ["  parameter", "unit", "default", "bounds", "meaning"]


def execute(arguments: Namespace) -> ExitCode:
    """Print every component with its parameters, then the plugins that fail to load."""
    registry = workspace_folder(arguments).registry
    providers = [registry.providers[name] for name in sorted(registry.providers)]
    if arguments.json:
        failures = [{"place": failure.place, "reason": failure.reason} for failure in registry.failures]
        print_json({"components": [component_document(provider) for provider in providers], "failures": failures})
        return ExitCode.USAGE if failures else ExitCode.OK
    for provider in providers:
        _print(component_document(provider))
    if registry.failures:
        print("broken")
        print_fields([(failure.place, failure.reason) for failure in registry.failures], indent=2)
        say(f"{plural(len(registry.failures), 'plugin')} failed to load; the others are available")
    return ExitCode.USAGE if registry.failures else ExitCode.OK


def _print(document: dict[str, Any]) -> None:
    origin = document["file"] if document["distribution"] == "workspace" else document["distribution"]
    print_line(f"{document['kind']} {document['name']}  version {document['version']}, {origin}")
    print_line(f"  {document['meaning']}", "  ")
    rows = [[name, with_powers(unit), *rest] for name, unit, *rest in map(parameter_row, document["parameters"])]
    if rows:
        print_table(COLUMNS, rows)
    print()
