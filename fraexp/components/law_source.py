"""What a law's source must not use: random numbers, and ways out of what the compiler checks."""

import dis
import inspect
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType

import numpy as np

from fraexp.errors import PluginError

FORBIDDEN_MODULES = {
    "random": "random numbers",
    "numpy.random": "random numbers",
    "secrets": "random numbers",
    "ctypes": "memory by its address",
    "cffi": "memory by its address",
    "os": "the operating system",
    "sys": "the interpreter",
    "time": "the clock",
    "subprocess": "other processes",
    "threading": "threads",
}
"""Modules that a law must not use, and what they stand for."""
FORBIDDEN_NAMES = {
    "random": "random numbers",
    "objmode": "plain Python in compiled code",
    "carray": "memory by its address",
    "empty": "memory that nothing has been written to (take zeros)",
    "empty_like": "memory that nothing has been written to (take zeros_like)",
}
"""Attributes of numpy and numba that a law must not use."""
FORBIDDEN_ATTRIBUTES = {"ctypes": "memory by its address"}
"""Attributes of arrays that a law must not use."""
FORBIDDEN_BUILTINS = {
    "print": "the terminal",
    "input": "the keyboard",
    "open": "files",
    "id": "memory by its address",
    "globals": "memory beside z",
    "exec": "code that is made at run time",
    "eval": "code that is made at run time",
    "__import__": "code that is made at run time",
}
"""Built-in functions that a law must not use, and what they stand for."""
GLOBAL_OR_ATTRIBUTE = {*dis.hasname, *dis.hasfree}
"""Instructions that use a name which is not that of a local variable."""
MAX_ARRAY_BYTES = 16 * 2**20
"""Greatest size of an array of the module: the compiler copies it into the code of each kernel, and to the cache."""
MAX_TUPLE_SIZE = 100
"""Greatest size of a tuple of the module: the compiler treats each element as a variable, and takes 0.5 MB for it."""


@cache
def check_source(name: str, law: Callable[..., float]) -> None:
    """Raise PluginError if a law, or a function that it calls, uses what no function of its arguments may use."""
    for function in _functions(law):
        file = Path(function.__code__.co_filename).name
        for line, used, what in _forbidden_uses(function):
            found = f"the law of {name} ({file}, line {line}) uses {used}: {what}"
            raise PluginError(f"{found}; expected a function of its arguments alone")
        for used, value in _used_names(function):
            if size := _excessive_size(value):
                found = f"the law of {name} ({file}, line {function.__code__.co_firstlineno}) uses {used}, {size}"
                raise PluginError(f"{found}: the compiler copies it into each kernel; make it smaller")


def _excessive_size(value: object) -> str:
    """Return how large a constant is, and what is expected; empty if the compiler can take it."""
    if isinstance(value, np.ndarray) and value.nbytes > MAX_ARRAY_BYTES:
        return f"an array of {value.nbytes / 2**20:.0f} MiB; expected {MAX_ARRAY_BYTES // 2**20} MiB or less"
    if isinstance(value, tuple) and len(value) > MAX_TUPLE_SIZE:
        return f"a tuple of {len(value)} elements; expected {MAX_TUPLE_SIZE} or fewer, or an array"
    return ""


def _functions(law: Callable[..., float]) -> list[FunctionType]:
    """Return a law and the Python functions that it uses, each once."""
    found = [law]
    for function in found:  # the list grows while it is read
        known = (getattr(value, "py_func", value) for _, value in _used_names(function))
        found += [value for value in known if inspect.isfunction(value) and value not in found]
    return [function for function in found if isinstance(function, FunctionType)]


def _used_names(function: Callable[..., float]) -> Iterator[tuple[str, object]]:
    """Yield name and value of the globals that a function uses, and of what it closes over."""
    code = function.__code__
    for name in code.co_names:
        if name in function.__globals__:
            yield name, function.__globals__[name]
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents


def _forbidden_uses(function: FunctionType) -> Iterator[tuple[int, str, str]]:
    """Yield the line of each use of what is forbidden, the name that is used, and what it stands for."""
    values = dict(_used_names(function))
    builtins = {name: what for name, what in FORBIDDEN_BUILTINS.items() if name not in values}
    forbidden = {name: what for name, value in values.items() if (what := _meaning(value))}
    forbidden |= FORBIDDEN_ATTRIBUTES | builtins
    if any(_module_of(value) in ("numpy", "numba") for value in values.values()):
        forbidden |= FORBIDDEN_NAMES
    line = function.__code__.co_firstlineno
    for instruction in dis.get_instructions(function):
        line = instruction.starts_line or line
        if instruction.opcode in GLOBAL_OR_ATTRIBUTE and instruction.argval in forbidden:
            yield line, instruction.argval, forbidden[instruction.argval]


def _meaning(value: object) -> str:
    """Return what a forbidden value stands for; empty if it is allowed."""
    module = _module_of(value)
    return FORBIDDEN_MODULES.get(module, "") or FORBIDDEN_MODULES.get(module.partition(".")[0], "")


def _module_of(value: object) -> str:
    """Return the module that a value is, or comes from."""
    if isinstance(value, ModuleType):
        return value.__name__
    owner = value.__self__ if isinstance(value, MethodType | BuiltinFunctionType) else value
    if isinstance(owner, ModuleType):
        return owner.__name__
    return getattr(value, "__module__", None) or type(owner).__module__
