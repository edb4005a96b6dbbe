"""Notice that a compilation begins, for whoever listens; the compiler itself need not have been imported."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[], None]

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def compilation_listener(listener: Listener) -> Iterator[None]:
    """Call `listener` before each compilation that this thread starts inside the `with` block."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def announce_compilation() -> None:
    """Call the listener, if there is one: a compilation begins."""
    listener = _listener.get()
    if listener is not None:
        listener()
