"""Whether a plugin's methods can be called as those of their kind."""

import inspect

from fraexp.errors import PluginError


def check_overrides(cls: type, kind: type) -> None:
    """Raise PluginError for a method that cannot be called as that of its kind, or that must be a property."""
    name_of_class = getattr(cls, "name", cls.__name__)
    for name, expected in vars(kind).items():
        found = inspect.getattr_static(cls, name)
        if isinstance(expected, property) and inspect.isfunction(found):
            raise PluginError(f"{name_of_class}.{name} is a method; expected a property: put @property above it")
        if inspect.isfunction(expected) and inspect.isfunction(found):
            wanted = [key for key, one in inspect.signature(expected).parameters.items() if one.default is one.empty]
            try:
                inspect.signature(found).bind(*wanted)
            except TypeError:
                has = ", ".join(inspect.signature(found).parameters)
                raise PluginError(f"{name_of_class}.{name} takes ({has}); expected ({', '.join(wanted)})") from None
