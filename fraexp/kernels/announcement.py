"""Who is told that something is about to be compiled; the compiler itself need not have been imported."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[], None]

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def announced(listener: Listener) -> Iterator[None]:
    """Call `listener` before each compilation that this thread does meanwhile."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def announce() -> None:
    """Tell the listener, if there is one, that a compilation begins."""
    listener = _listener.get()
    if listener is not None:
        listener()
