"""The built-in components: ordinary plugins, one method a file, found by walking this package."""

import importlib
import pkgutil

from fraexp.api import hookimpl
from fraexp.components import Component
from fraexp.plugins import components_in


@hookimpl
def fraexp_components() -> list[type[Component]]:
    """Return the components of every module in this package."""
    modules = [importlib.import_module(info.name) for info in pkgutil.walk_packages(__path__, f"{__name__}.")]
    return [component for module in modules for component in components_in(module)]
