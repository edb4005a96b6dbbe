"""Notice that a compilation begins and ends, for whoever listens; the compiler itself need not have been imported."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[bool], None]
"""Called with True before a compilation, and with False after it."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def compilation_listener(listener: Listener | None) -> Iterator[None]:
    """Call `listener` before and after each compilation of this thread inside the `with` block."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def announced_compilation() -> Iterator[None]:
    """Tell the listener, if there is one, that the `with` block compiles; what is compiled within is part of it."""
    listener = _listener.get()
    if listener is None:
        yield
        return
    listener(True)
    try:
        with compilation_listener(None):
            yield
    finally:
        listener(False)
