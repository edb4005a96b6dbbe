"""Friction laws, written as plain functions: made known to the compiler together with all that they use.

Their identity is taken from what was loaded, not from files: a file may have been edited since, and a cell of a
notebook has none.
"""

import contextlib
import hashlib
import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from types import CodeType, ModuleType

import numpy as np
from numba.core import ir, ssa
from numba.core.errors import NumbaError
from numba.extending import register_jitable

from fraexp.kernels.law_error import LawError
from fraexp.kernels.watchdog import OverdueError, time_limit

Law = Callable[..., float]
BUILT_IN_PACKAGES = ("fraexp", "fraexp_plugins")


def register_law(law: Law) -> Law:
    """Return the law, registered with the compiler together with the functions that it calls.

    The function itself stays plain Python: observers, checks and tests call it without the compiler.
    """
    for function in called_functions(law):
        _register_function(function)
    return _register_function(law)


@cache
def _register_function(function: Law) -> Law:
    if is_built_in(function):
        return register_jitable(function)
    _dropped_in_files.add(Path(inspect.getfile(function)).resolve())
    return register_jitable(boundscheck=True)(function)


_dropped_in_files: set[Path] = set()
"""Files of the laws in which the compiler refuses a variable that a branch leaves unassigned."""


def _refuse_unassigned(name: str, place: ir.Loc) -> None:
    """Raise an error for a variable of a dropped-in law that a branch leaves unassigned.

    Plain Python raises one where such a variable is read. Compiled code would go on with any number. Numba's own
    setting gives a warning, which depends on the filters of the whole process; `tests/testing/test_hostile_laws.py`
    notices if this private function is called no longer.
    """
    if Path(place.filename).resolve() in _dropped_in_files:
        raise NumbaError(f"{UNASSIGNED} {name}", loc=place)


ssa._warn_about_uninitialized_variable = _refuse_unassigned


def is_built_in(function: Law) -> bool:
    """Return whether a function comes with fraexp, where tests show that it stays within its arrays.

    In all others the compiler checks each index: a law that somebody drops in cannot write where it must not.
    """
    return function.__module__.partition(".")[0] in BUILT_IN_PACKAGES


def called_functions(law: Law) -> list[Law]:
    """Return the Python functions that a law calls, directly or through others, each once."""
    found = [law]
    for function in found:  # the list grows while it is read: callees of callees are visited as well
        found += [value for value in used_values(function) if inspect.isfunction(value) and value not in found]
    return found[1:]


def used_by(law: Law) -> list[Law]:
    """Return a law and the functions that it calls."""
    return [law, *called_functions(law)]


@cache  # it is asked for in each call
def is_all_built_in(law: Law) -> bool:
    """Return whether a law, and all functions that it calls, come with fraexp."""
    return all(map(is_built_in, used_by(law)))


def used_values(law: Law) -> list[object]:
    """Return the values that a law uses beside its arguments: globals of its module, and what it closes over.

    A function that its author has compiled already is replaced by the Python function inside.
    """
    global_values = [law.__globals__[name] for name in law.__code__.co_names if name in law.__globals__]
    values = global_values + [cell.cell_contents for cell in law.__closure__ or ()]
    return [getattr(value, "py_func", value) for value in values]


@contextlib.contextmanager
def explain_compiler_errors(*laws: Law) -> Iterator[None]:
    """Turn errors of the `with` block, which compiles laws, into a LawError of one line with the place in the law."""
    names = " or ".join(dict.fromkeys(law.__qualname__ for law in laws))
    try:
        with time_limit(COMPILE_LIMIT_S, is_processor_time=True):
            yield
    except OverdueError:
        reason = f"the compiler has not returned after {COMPILE_LIMIT_S:g} s; expected seconds: make the law simpler"
        raise LawError(f"{names} ({_error_place('', laws)}) cannot be compiled: {reason}") from None
    except Exception as error:  # the compiler raises errors of many kinds
        message = TERMINAL_CODE.sub("", str(error))
        cause = _error_cause([line.strip() for line in message.splitlines() if line.strip()] or [type(error).__name__])
        cause += "".join(_unsupported_uses(laws))
        raise LawError(f"{names} ({_error_place(message, laws)}) cannot be compiled: {cause}") from None


def _error_cause(lines: list[str]) -> str:
    """Return what the lines of a compiler's message say, in one line."""
    unassigned = next((line.partition(UNASSIGNED)[2].strip() for line in lines if UNASSIGNED in line), "")
    if unassigned:
        return f"one of its branches leaves '{unassigned.partition('.')[0]}' unassigned; assign it before the branch"
    meaning = next((text for begin, text in MEANINGS.items() for line in lines if line.startswith(begin)), "")
    if meaning:
        return meaning
    at = next((at for at in reversed(range(len(lines))) if lines[at].startswith(CAUSE_PREFIXES)), len(lines) - 1)
    if lines[at].endswith("found for signature:") and at + 1 < len(lines):  # the signature is in the line after it
        return f"there is no implementation of {lines[at + 1].removeprefix('>>> ')}"
    return lines[at].partition(" Raised from ")[0]


def _unsupported_uses(laws: Sequence[Law]) -> Iterator[str]:
    """Yield what to write for each function of numpy and math that the compiler lacks for numbers, and a law uses."""
    functions = [each for law in laws for each in used_by(law)]
    own = {function.__name__ for function in functions}
    used = dict.fromkeys(name for function in functions for name in function.__code__.co_names)
    for name in used:
        if name in INSTEAD and name not in own:
            yield f"; {name} does not take single numbers there: write {INSTEAD[name]}"


def _error_place(message: str, laws: Sequence[Law]) -> str:
    """Return file and line of a law: the last that the compiler's message names, or where the law begins."""
    files = {Path(inspect.getfile(function)).name for law in laws for function in used_by(law)}
    named = [(Path(match[1] or match[2]).name, match[3]) for match in COMPILER_PLACE.finditer(message)]
    inside = [place for place in named if place[0] in files]
    file, line = inside[-1] if inside else (Path(inspect.getfile(laws[0])).name, laws[0].__code__.co_firstlineno)
    return f"{file}, line {line}"


COMPILE_LIMIT_S = 20.0
"""Limit of the processor time for compiling one kernel [s]: four times what the slowest built-in law takes."""
COMPILER_PLACE = re.compile(r'(?:File "([^"]+)", line |Raised from (.+) \()(\d+)')
"""The two forms in which the compiler names a file and a line."""
TERMINAL_CODE = re.compile(r"\x1b\[[0-9;]*m")
"""Colours, which the compiler puts into its messages wherever the package colorama is installed."""
UNASSIGNED = "Detected uninitialized variable"
"""How the error about a variable begins that a branch leaves unassigned."""
MEANINGS = {
    ">>> setitem(readonly array": "it writes z, a parameter or an array of its module; it may write only z_next",
    "Cannot modify readonly array": "it writes z, a parameter or an array of its module; it may write only z_next",
}
"""What a cause means in the words of a law's author, by how it begins."""
INSTEAD = {
    "clip": "min(max(x, low), high)",
    "heaviside": "1.0 if x > 0 else 0.0",
    "piecewise": "if and else",
    "select": "if and else",
    "norm": "abs(x) or math.hypot(x, y)",
    "dot": "x * y",
    "polyval": "(a * x + b) * x + c",
    "cbrt": "math.copysign(abs(x) ** (1 / 3), x)",
    "dist": "math.hypot(x, y)",
    "fmod": "x % y",
    "fsum": "a sum",
    "prod": "a product",
}
"""What to write instead of functions that the compiler does not have, or has for arrays only."""
CAUSE_PREFIXES = (
    "NameError",
    "Cannot",
    "Invalid use",
    "No implementation",
    "Unknown attribute",
    "Untyped global",
    "Unsupported",
)
"""How the line of the compiler's message begins that names the cause."""


@cache
def kernel_source_hash() -> str:
    """Return a hash of all source files of the kernels."""
    sources = [path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))]
    return hashlib.blake2b(b"".join(sources), digest_size=16).hexdigest()


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
