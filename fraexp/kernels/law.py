"""Making a friction law, written as a plain function, callable from compiled code."""

import contextlib
import hashlib
import inspect
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
from numba.core.errors import NumbaError
from numba.extending import register_jitable

Law = Callable[..., float]


@cache
def compilable(law: Law) -> Law:
    """Return the law, made known to the compiler with the plain functions it calls; it stays plain Python itself."""
    for helper in helpers(law):
        compilable(helper)
    made: Law = register_jitable(law)
    return made


def helpers(law: Law) -> list[Law]:
    """Return the plain Python functions that a law calls."""
    return [value for value in _used(law) if inspect.isfunction(value)]


def fingerprint(law: Law) -> str:
    """Return a hash of all that decides what the law computes: its file, the constants and the functions it uses.

    It is part of a kernel's identity: an edited law is compiled again.
    """
    path = Path(inspect.getfile(law))
    digest = hashlib.blake2b(law.__qualname__.encode(), digest_size=16)
    digest.update(path.read_bytes() if path.is_file() else law.__code__.co_code)
    for value in _used(law):
        if inspect.isfunction(value):
            digest.update(fingerprint(value).encode())
        elif isinstance(value, np.ndarray):
            digest.update(value.tobytes())
        elif isinstance(value, int | float | tuple):
            digest.update(repr(value).encode())
    return digest.hexdigest()


def _used(law: Law) -> list[object]:
    """Return what a law uses beside its arguments: of its module, and what it closes over."""
    named = [law.__globals__[name] for name in law.__code__.co_names if name in law.__globals__]
    return named + [cell.cell_contents for cell in law.__closure__ or ()]


class LawError(Exception):
    """A law is not written in the part of Python that can be compiled."""


@contextlib.contextmanager
def explained(*laws: Law) -> Iterator[None]:
    """Turn what the compiler says of a law into a LawError of one line."""
    try:
        yield
    except NumbaError as error:
        lines = [line.strip() for line in str(error).splitlines()]
        said = [line for line in lines if line.startswith(TELLING)] or [line for line in lines if line][-1:]
        where = [line.removeprefix("File ").replace('"', "") for line in lines if line.startswith('File "')]
        place = where[-1].rstrip(":") if where else inspect.getfile(laws[0])
        names = " or ".join(dict.fromkeys(law.__qualname__ for law in laws))
        raise LawError(f"{names} cannot be compiled: {said[0]} ({place})") from None


TELLING = (
    "NameError",
    "Cannot",
    "Invalid use",
    "No implementation",
    "Unknown attribute",
    "Untyped global",
    "Unsupported",
)
"""How the line of the compiler's message begins that says what is wrong."""


@cache
def kernel_sources() -> str:
    """Return a hash of all kernels' sources."""
    sources = [path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))]
    return hashlib.blake2b(b"".join(sources), digest_size=16).hexdigest()
