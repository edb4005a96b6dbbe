"""Making a friction law, written as a plain function, callable from compiled code."""

import contextlib
import hashlib
import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numba.extending import register_jitable

from fraexp.kernels.law_error import LawError
from fraexp.kernels.watchdog import OverdueError, time_limit

Law = Callable[..., float]


def compilable(law: Law) -> Law:
    """Return the law, made known to the compiler with the functions it calls; it stays plain Python itself."""
    for helper in helpers(law):
        _made_known(helper)
    return _made_known(law)


@cache
def _made_known(function: Law) -> Law:
    made: Law = register_jitable(function)
    return made


def helpers(law: Law) -> list[Law]:
    """Return the Python functions that a law calls, directly or through others, each once."""
    found = [law]
    for function in found:  # which grows meanwhile
        found += [value for value in _used(function) if inspect.isfunction(value) and value not in found]
    return found[1:]


def fingerprint(law: Law) -> str:
    """Return a hash of all that decides what the law computes: its file, the constants and the functions it uses.

    It is part of a kernel's identity: an edited law is compiled again.
    """
    digest = hashlib.blake2b(digest_size=16)
    for function in (law, *helpers(law)):
        path = Path(inspect.getfile(function))
        digest.update(function.__qualname__.encode())
        digest.update(path.read_bytes() if path.is_file() else function.__code__.co_code)
        for value in _used(function):
            if isinstance(value, np.ndarray):
                digest.update(value.tobytes())
            elif isinstance(value, int | float | tuple):
                digest.update(repr(value).encode())
    return digest.hexdigest()


def _used(law: Law) -> list[object]:
    """Return what a law uses beside its arguments: of its module, and what it closes over.

    Of a function that has been given to the compiler already it is the Python function.
    """
    named = [law.__globals__[name] for name in law.__code__.co_names if name in law.__globals__]
    used = named + [cell.cell_contents for cell in law.__closure__ or ()]
    return [getattr(value, "py_func", value) for value in used]


@contextlib.contextmanager
def explained(*laws: Law) -> Iterator[None]:
    """Turn what goes wrong while laws are compiled into a LawError of one line, with the place in the law."""
    names = " or ".join(dict.fromkeys(law.__qualname__ for law in laws))
    try:
        with time_limit(COMPILE_LIMIT_S, of_processor=True):
            yield
    except OverdueError:
        why = f"the compiler has not returned after {COMPILE_LIMIT_S:g} s; expected seconds: make the law simpler"
        raise LawError(f"{names} ({_place('', laws)}) cannot be compiled: {why}") from None
    except Exception as error:  # the compiler raises what it likes
        lines = [line.strip() for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
        said = [line for line in lines if line.startswith(TELLING)] or lines[-1:]
        raise LawError(f"{names} ({_place(str(error), laws)}) cannot be compiled: {said[-1]}") from None


def _place(message: str, laws: Sequence[Law]) -> str:
    """Return file and line of a law: the last that the compiler's message names there, or where the law begins."""
    files = {Path(inspect.getfile(law)).name for top in laws for law in (top, *helpers(top))}
    named = [(Path(found[1] or found[2]).name, found[3]) for found in NAMED_PLACE.finditer(message)]
    inside = [place for place in named if place[0] in files]
    file, line = inside[-1] if inside else (Path(inspect.getfile(laws[0])).name, laws[0].__code__.co_firstlineno)
    return f"{file}, line {line}"


COMPILE_LIMIT_S = 20.0
"""Processor time that one kernel may take to be compiled [s]: four times what the longest built-in law takes."""
NAMED_PLACE = re.compile(r'(?:File "([^"]+)", line |Raised from (.+) \()(\d+)')
"""The two ways in which the compiler names a place."""
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
