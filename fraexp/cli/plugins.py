"""``fraexp plugins``: the components that plugins provide, and the plugins that fail to load."""

from argparse import Namespace
from itertools import groupby

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_fields, print_json, print_line, print_table, say
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.components.registry import Provider, Registry
from fraexp.data.units import with_powers
from fraexp.errors import PluginError, did_you_mean
from fraexp.views.components import component_document, parameter_row
from fraexp.views.words import plural

COLUMNS = ["  parameter", "unit", "default", "bounds", "meaning"]
MAIN_PARAMETERS = 5


def execute(arguments: Namespace) -> ExitCode:
    """Print the names of all components, or those of one name or kind in full; then the plugins that fail to load."""
    registry = workspace_folder(arguments).registry
    providers = _select(registry, arguments.name)
    failures = [] if arguments.name else registry.failures
    if arguments.json:
        broken = [{"place": failure.place, "reason": failure.reason} for failure in failures]
        print_json({"components": [component_document(provider) for provider in providers], "failures": broken})
        return ExitCode.USAGE if failures else ExitCode.OK
    if arguments.name:
        for provider in providers:
            _print(provider)
        return ExitCode.OK
    _print_names(providers)
    if failures:
        print("broken")
        print_fields([(failure.place, failure.reason) for failure in failures], indent=2)
        say(f"{plural(len(failures), 'plugin')} failed to load; the others are available")
    return ExitCode.USAGE if failures else ExitCode.OK


def _select(registry: Registry, name: str | None) -> list[Provider]:
    """Return all providers by kind and name, or those of one name; PluginError if nothing is called so."""
    found = [registry.providers[key] for key in sorted(registry.providers) if name in (None, key[1])]
    if not found and name is not None:
        names = {each for _, each in registry.providers}
        raise PluginError(f"plugins: no component is called '{name}'{did_you_mean(name, names)}")
    return found


def _print_names(providers: list[Provider]) -> None:
    """Print the names of each kind; those of the workspace say so."""
    by_kind = groupby(providers, key=lambda provider: provider.component.kind)
    print_fields([(kind, ", ".join(map(_name, of_kind))) for kind, of_kind in by_kind])
    say("fraexp plugins NAME describes one, with its parameters")


def _name(provider: Provider) -> str:
    is_own = provider.distribution == "workspace"
    return f"{provider.component.name} ({provider.file.name})" if is_own else provider.component.name


def _print(provider: Provider) -> None:
    document = component_document(provider)
    origin = document["file"] if document["distribution"] == "workspace" else document["distribution"]
    print_line(f"{document['kind']} {document['name']}  version {document['version']}, {origin}")
    for paragraph in provider.paragraphs:
        print_line(f"  {paragraph}", "  ")
    rows = [[name, with_powers(unit), *rest] for name, unit, *rest in map(parameter_row, document["parameters"])]
    for part in (rows[:MAIN_PARAMETERS], rows[MAIN_PARAMETERS:]):
        if part:
            print()
            print_table(COLUMNS, part)
    print()
