"""Making a friction law, written as a plain function, callable from compiled code."""

import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
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
    """Return the plain Python functions that a law calls: of its module, and those that it closes over."""
    called = [law.__globals__[name] for name in law.__code__.co_names if name in law.__globals__]
    closed = [cell.cell_contents for cell in law.__closure__ or ()]
    return [value for value in called + closed if inspect.isfunction(value)]


def fingerprint(law: Law) -> str:
    """Return a hash of the source that decides what the law computes: its file and those of its helpers.

    A kernel closes over it, because the compiler's disk cache compares the cells of a closure but not the
    source of the functions that it calls: without it an edited law would run as it was before.
    """
    path = Path(inspect.getfile(law))
    source = path.read_bytes() if path.is_file() else law.__code__.co_code
    parts = [hashlib.blake2b(source, digest_size=16).hexdigest(), *(fingerprint(helper) for helper in helpers(law))]
    return parts[0] if len(parts) == 1 else hashlib.blake2b("".join(parts).encode(), digest_size=16).hexdigest()


def cached(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function when it is first called, and keep the machine code on disk where there is a place for it.

    It lets other threads run: a law that never returns must not keep the process from being ended.
    """
    options["nogil"] = True
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # no folder can be written, as in a container: compile again in each process
        return njit(**options)(function)


class LawError(Exception):
    """A law is not written in the part of Python that can be compiled."""


def call(factory: Callable[..., Any], laws: Law | tuple[Law, ...], *arguments: Any) -> Any:
    """Call the kernel that a factory makes for laws; LawError tells in one line why one cannot be compiled."""
    laws = laws if isinstance(laws, tuple) else (laws,)
    try:
        return specialised(factory, *laws)(*arguments)
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
def specialised(factory: Callable[..., Any], *laws: Law) -> Any:
    """Return the kernel that a factory makes for laws, the same one for the same laws."""
    source = "".join(fingerprint(law) for law in laws)
    return factory(*(compilable(law) for law in laws), source + _kernels())


@cache
def _kernels() -> str:
    """Return a hash of all kernels' sources: the compiler looks at the file of the one that it keeps alone."""
    sources = [path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))]
    return hashlib.blake2b(b"".join(sources), digest_size=16).hexdigest()
