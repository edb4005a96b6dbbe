"""Errors of the compiler, which knows none of ours, as those that a user of the Python interface catches."""

from collections.abc import Iterator
from contextlib import contextmanager

from fraexp.errors import PluginError
from fraexp.kernels.law_error import LawError


@contextmanager
def compiler_errors_as_ours() -> Iterator[None]:
    """Raise a PluginError for a law that cannot be compiled."""
    try:
        yield
    except LawError as error:
        raise PluginError(str(error)) from None
