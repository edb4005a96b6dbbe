"""The built-in components: ordinary plugins, one method a file, each imported when one of its components is used."""

from fraexp.api import component_modules, hookimpl


@hookimpl
def fraexp_component_modules() -> dict[str, list[str]]:
    """Return every module in this package, with the names of its components."""
    return component_modules(__name__, __path__)
