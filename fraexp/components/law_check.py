"""A trial run of a friction law in plain Python, before it is compiled and its mistakes fail silently."""

import dis
import inspect
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType

import numpy as np
from numpy.typing import NDArray

from fraexp.components.law_step import Law, checked_step, law_place, overdue_text, step_text
from fraexp.errors import PluginError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, time_limit

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


TEST_STEPS = [
    (share * size, dt)
    for dt, sizes in ((1e-4, (1e-9, 1e-6)), (1.0, (1e-6, 1e-4)), (1e-4, (1e-8, 1e-5, 1e-3, 1e-1)))
    for size in sizes
    for share in (1.0, 0.0, 1.0, -0.3, -2.0, -2.0, 0.0)
]
"""Steps [m] of the trial run and their times [s]: small and long, slow and fast, back and forth."""
MAX_STATES = 10_000
"""Greatest size of a law's memory: a law of friction has tens of elements."""
MAX_STEP_TIME_S = LAW_TIME_LIMIT_S / len(TEST_STEPS)
"""Time that a step may take in plain Python [s]; compiled it takes a hundredth."""

UNWRITTEN_NUMBERS = (1e30, -1e30)
"""What z_next contains, in turn, when a step is repeated: in a run it contains an older state, which is no input."""
Step = tuple[float, NDArray[np.float64]]
"""Force [N] and next state."""

_passed: set[tuple[object, ...]] = set()
"""Laws that have passed, each with the sizes of its arrays: these decide which elements it may access."""


def check_law(
    name: str,
    law: Law,
    arguments: tuple[object, ...],
    states: int,
    stiffness: Callable[[], float],
    time_step: float | None = None,
) -> None:
    """Run a law along the test steps, once per process; PluginError for what compiled code would not report.

    That is an index beyond z, a write to anything but z_next, a force that is not a finite number, another force for
    the same step, and a law that never returns, or whose maximum `stiffness`, which may call the law too, never
    returns. The law of a composite is run as a whole, with the sizes that it passes on. With `time_step` [s] it also
    takes a step of that time.
    """
    sizes = (value.size if isinstance(value, np.ndarray) else 1 for value in arguments if not isinstance(value, tuple))
    key = (law, states, time_step, *sizes)
    if key in _passed:
        return
    _check_size(name, law, states)
    check_source(name, law)
    steps = TEST_STEPS if time_step is None else [(dy, time_step) for dy in (1e-9, -1e-6, 0.0, 1e-5)]
    trial = _Trial(name, law, arguments, stiffness)
    trial.run(np.zeros(states), steps)
    _passed.add(key)


def _check_size(name: str, law: Law, states: object) -> None:
    if not (isinstance(states, int | np.integer) and 0 <= states <= MAX_STATES):
        found = f"the law of {name} ({law_place(law)}) has a state_size of {states}"
        raise PluginError(f"{found}; expected a whole number from 0 to {MAX_STATES}")


def _is_same(first: Step, second: Step) -> bool:
    return np.array_equal(first[0], second[0], equal_nan=True) and np.array_equal(first[1], second[1], equal_nan=True)


class _Trial:
    """A trial run with a time limit; `at` is what is being done, for the message if that is exceeded."""

    def __init__(self, name: str, law: Law, arguments: tuple[object, ...], stiffness: Callable[[], float]) -> None:
        self._name, self._law, self._arguments, self._stiffness = name, law, arguments, stiffness
        self._at = "when asked for its maximum stiffness"
        self._done = 0
        """Number of steps that have been taken."""
        self._since = time.monotonic()
        """Time at which the present step began [s]."""

    def run(self, z: NDArray[np.float64], steps: Iterable[tuple[float, float]]) -> None:
        """Take the steps one after another, each twice."""
        try:
            with time_limit(LAW_TIME_LIMIT_S):
                with suppress(Exception):  # its own faults are reported where it is used
                    self._stiffness()
                for dy, dt in steps:
                    z = self._take(z, dy, dt)
        except OverdueError as error:
            raise PluginError(f"the law of {self._name} {self._late_text(error)}") from None

    def _take(self, z: NDArray[np.float64], dy: float, dt: float) -> NDArray[np.float64]:
        self._at, self._since = step_text(dy, dt), time.monotonic()
        step = partial(checked_step, self._name, self._law, self._arguments, z, dy, dt)
        force, z_next = step()
        unwritten = UNWRITTEN_NUMBERS[self._done % len(UNWRITTEN_NUMBERS)]
        if not _is_same((force, z_next), step(unwritten)):
            raise PluginError(self._impurity_text((force, z_next), step(), unwritten))
        self._done += 1
        return z_next if np.all(np.isfinite(z_next)) else np.zeros(z.size)

    def _impurity_text(self, first: Step, again: Step, unwritten: float) -> str:
        """Return what the law depends on beside its arguments; `again` is the same step from the same z_next."""
        subject = f"the law of {self._name} ({law_place(self._law)})"
        if _is_same(first, again):
            found = f"gives another result {self._at} if z_next contains {unwritten:g} before"
            return f"{subject} {found}; expected that it writes each element of z_next and reads none before that"
        forces = f"gives {first[0]!r} N, then {again[0]!r} N {self._at}"
        found = forces if first[0] != again[0] else "gives two next states"
        expected = "a function of its arguments, without random numbers and without memory beside z"
        return f"{subject} {found} from the same state; expected {expected}"

    def _late_text(self, error: OverdueError) -> str:
        """Return why the trial has taken too long: one step that does not return, or all that are slow."""
        if self._done and time.monotonic() - self._since < 0.8 * LAW_TIME_LIMIT_S:
            each = LAW_TIME_LIMIT_S / self._done
            found = f"({law_place(self._law)}) takes {each:.2g} s for a step in plain Python"
            return f"{found}; expected less than {MAX_STEP_TIME_S:.2g} s: simplify it, or take fewer states"
        return overdue_text(error, self._law, self._at, LAW_TIME_LIMIT_S)
