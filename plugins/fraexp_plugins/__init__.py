"""The built-in components: ordinary plugins, one a file, imported when used; names of helpers begin with `_`."""

from fraexp.api import component_modules, hookimpl


@hookimpl
def fraexp_component_modules() -> dict[str, list[str]]:
    """Return the modules of this package with the names of their components."""
    return component_modules(__name__, __path__)
