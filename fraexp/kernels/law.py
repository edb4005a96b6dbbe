"""Making a friction law, written as a plain function, callable from compiled code."""

import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba.extending import register_jitable

Law = Callable[..., float]


@cache
def compilable(law: Law) -> Law:
    """Return the law, made known to the compiler; the function itself stays plain Python."""
    made: Law = register_jitable(law)
    return made


def fingerprint(law: Law) -> str:
    """Return a hash of the source that decides what the law computes: its file, helpers and constants included.

    A kernel closes over it, because the compiler's disk cache compares the cells of a closure but not the
    source of the functions that it calls: without it an edited law would run as it was before.
    """
    path = Path(inspect.getfile(law))
    source = path.read_bytes() if path.is_file() else law.__code__.co_code
    return hashlib.blake2b(source, digest_size=16).hexdigest()


def specialised(factory: Callable[[Law, str], Any], law: Law) -> Any:
    """Return the kernel that a factory makes for a law, the same one for the same law."""
    return _made(factory, law)


@cache
def _made(factory: Callable[[Law, str], Any], law: Law) -> Any:
    return factory(compilable(law), fingerprint(law))
