"""Standard output and error, which may be closed, full, or gone with their terminal."""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Self, TextIO, cast

STREAM_NAMES = ("stdin", "stdout", "stderr")
"""Attributes of `sys`, by descriptor."""


def open_closed_streams() -> None:
    """Open the null device for each standard stream that the parent has closed: nobody wants it.

    Otherwise the next file that is opened takes the descriptor, and what is printed goes into that file.
    """
    for descriptor, name in enumerate(STREAM_NAMES):
        try:
            os.fstat(descriptor)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)  # the lowest descriptor that is free: this one
            if null != descriptor:
                os.dup2(null, descriptor)
                os.close(null)
            stream = open(descriptor, "r" if name == "stdin" else "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)


class _OutputStream(io.TextIOWrapper):
    """Standard output that keeps its first failure, as other files fail with the same errors."""

    failure: OSError | None = None

    @classmethod
    def replacing(cls, stream: TextIO) -> Self:
        """Return the stream that takes the place of another one, which cannot be used any more."""
        settings = {name: getattr(stream, name) for name in ("encoding", "errors", "line_buffering", "write_through")}
        return cls(cast(io.TextIOWrapper, stream).detach(), **settings)

    def write(self, text: str) -> int:
        """Write a text."""
        with self._noted_failure():
            return super().write(text)

    def flush(self) -> None:
        """Write what is in the buffer."""
        with self._noted_failure():
            super().flush()

    @contextmanager
    def _noted_failure(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.failure = self.failure or error
            raise


def watch_output() -> None:
    """Have standard output keep its first failure."""
    sys.stdout = _OutputStream.replacing(sys.stdout)
    setattr(sys, "__stdout__", sys.stdout)  # noqa: B010 (which is declared final)


def is_output_failure(error: BaseException) -> bool:
    """Return whether an error is one of standard output, not of another file."""
    return isinstance(error, BrokenPipeError) or getattr(sys.stdout, "failure", None) is error


def discard_unwritable(stream: TextIO) -> None:
    """Let what a stream cannot write go to the null device, so that the flush at exit succeeds."""
    try:
        stream.flush()
    except OSError:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            stream.flush()


class TolerantStream:
    """A stream that drops what it cannot write, such as to a terminal that was closed."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a text, or drop it."""
        with suppress(OSError):
            return self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Write what is in the buffer, or keep it there."""
        with suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)
