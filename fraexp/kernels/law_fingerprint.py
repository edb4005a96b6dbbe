"""Identity of a friction law for the cache of compiled code: a hash of all that the compiler reads of it.

It is taken from what was loaded, not from files: a file may have been edited since, and a cell of a notebook has none.
"""

import hashlib
from collections.abc import Iterator
from types import CodeType, ModuleType

import numpy as np

from fraexp.kernels.law import Law, is_built_in, used_by, used_values

CONSTANT_TYPES = (bool, int, float, str, np.generic, type(None))


def fingerprint(law: Law) -> str:
    """Return a hash of everything that decides what a law computes: the code and the values of all functions it uses.

    It is part of a kernel's identity, so that an edited law is compiled again.
    """
    digest = hashlib.blake2b(digest_size=16)
    for function in used_by(law):
        digest.update(f"{function.__qualname__} {is_built_in(function)} ".encode())
        digest.update(f"{_code_text(function.__code__)} {_value_text(function.__defaults__)} ".encode())
        digest.update(" ".join(map(_value_text, _constants(function))).encode())
    return digest.hexdigest()


def _code_text(code: CodeType) -> str:
    """Return what a function does, as text: without names of local variables, comments and places in a file."""
    constants = [_code_text(one) if isinstance(one, CodeType) else repr(one) for one in code.co_consts]
    return repr((code.co_argcount, code.co_code, code.co_exceptiontable, code.co_names, constants))


def _constants(law: Law) -> Iterator[object]:
    """Yield the values that a function uses beside its arguments, those of the modules that it names included."""
    for value in used_values(law):
        yield value
        if isinstance(value, ModuleType):
            found = (getattr(value, name, None) for name in law.__code__.co_names)
            yield from (one for one in found if isinstance(one, (*CONSTANT_TYPES, tuple, np.ndarray)))


def _value_text(value: object) -> str:
    """Return the content of a constant, and the name of anything else: functions contribute their own code."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str}{value.shape}{hashlib.blake2b(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple):
        return f"({', '.join(map(_value_text, value))})"
    if isinstance(value, CONSTANT_TYPES):
        return f"{type(value).__name__} {value!r}"
    name = getattr(value, "__name__", type(value).__name__)
    return str(getattr(value, "__qualname__", name))
