"""Packages that only conversions need: a missing one is named, with the command that installs it."""

from importlib import import_module
from typing import Any

from fraexp.errors import FraexpError


def import_optional(name: str, purpose: str) -> Any:
    """Return a package of the extra ``notebook``; FraexpError says how to install it if it is missing."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        raise FraexpError(
            f"{purpose} needs the package {name}: pip install {name} (the extra 'notebook' has all of them)"
        ) from None
