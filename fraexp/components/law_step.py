"""A friction law in plain Python: what its source may use, a trial run, and one step; faults are one line."""

import dis
import inspect
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import PluginError
from fraexp.kernels.call_watch import call_explainer
from fraexp.kernels.law_error import MAX_PLAUSIBLE_SPEED_M_S, LawCall, LawCallError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, error_location, time_limit

Law = Callable[..., float]
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
def check_source(name: str, law: Law) -> None:
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


def _functions(law: Law) -> list[FunctionType]:
    """Return a law and the Python functions that it uses, each once."""
    found = [law]
    for function in found:  # the list grows while it is read
        known = (getattr(value, "py_func", value) for _, value in _used_names(function))
        found += [value for value in known if inspect.isfunction(value) and value not in found]
    return [function for function in found if isinstance(function, FunctionType)]


def _used_names(function: Law) -> Iterator[tuple[str, object]]:
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


HANG_REPLAY_S = 5.0
"""Time limit [s] for a call that has hung in compiled code, in plain Python: it shows the line."""


class _LawAccessError(Exception):
    """A law reads or writes an element that it must not; the text says which."""


@cache
def argument_names(law: Law) -> tuple[str, ...]:
    """Return the names of what a law takes after z_next; looking them up takes longer than a short motion."""
    return tuple(inspect.signature(law).parameters)[4:]


def checked_step(
    name: str,
    law: Law,
    arguments: tuple[object, ...],
    z: NDArray[np.float64],
    dy: float,
    dt: float,
    unwritten: float = np.nan,
) -> tuple[float, NDArray[np.float64]]:
    """Return force [N] and next state of a step; PluginError if the law fails or gives no finite numbers.

    Beyond `MAX_PLAUSIBLE_SPEED_M_S` it may overflow. `unwritten` is what z_next contains before the law writes it.
    """
    force: object = np.nan
    z_next = np.full(z.size, unwritten)
    is_plausible = abs(dy) <= MAX_PLAUSIBLE_SPEED_M_S * dt
    try:
        force = law(_read_only(z), dy, dt, z_next, *map(_read_only, arguments))
    except Exception as error:
        if is_plausible or not isinstance(error, ArithmeticError):  # compiled code gives inf for an ArithmeticError
            raise PluginError(step_fault(name, law, arguments, z, dy, dt, error)) from error
    if is_plausible and not isinstance(force, float | int):
        found = f"a force of {force!r:.60}"
        raise PluginError(f"the law of {name} ({law_place(law)}) gives {found} {step_text(dy, dt)}; expected a float")
    if is_plausible and not (np.isfinite(cast("float", force)) and np.all(np.isfinite(z_next))):
        wrong = np.flatnonzero(~np.isfinite(z_next))
        found = f"z_next[{wrong[0]}] = {z_next[wrong[0]]}" if wrong.size else f"a force of {force} N"
        also = ", or leaves it unwritten" if wrong.size and np.isnan(z_next[wrong[0]]) else ""
        what = f"gives {found} {step_text(dy, dt)}{also}"
        raise PluginError(f"the law of {name} ({law_place(law)}) {what}; expected finite numbers")
    return float(cast("float", force)), z_next


@contextmanager
def explained_calls(name: str, arguments: tuple[object, ...]) -> Iterator[None]:
    """Explain what goes wrong in the `with` block, which calls a compiled law with these arguments: PluginError."""
    try:
        with call_explainer(lambda law, call, seconds: hang_fault(name, law, arguments, call, seconds)):
            yield
    except LawCallError as error:
        raise PluginError(call_fault(name, error.law, arguments, error)) from error


def call_fault(name: str, law: Law, arguments: tuple[object, ...], error: LawCallError) -> str:
    """Return in one line why a call of a compiled law failed.

    The call is repeated in plain Python, which names the line. Where the call is not known, or plain Python does it
    well, it is what compiled code says.
    """
    if error.call is not None:
        call = error.call
        try:
            with np.errstate(all="ignore"), time_limit(LAW_TIME_LIMIT_S):
                checked_step(name, law, arguments, call.z, call.dy, call.dt)
        except PluginError as fault:
            return str(fault)
        except OverdueError as overdue:
            return f"the law of {name} {overdue_text(overdue, law, step_text(call.dy, call.dt))}"
        return f"the law of {name} ({law_place(law)}): {error} {step_text(call.dy, call.dt)}, in compiled code"
    return f"the law of {name} ({law_place(law)}) {error}, in compiled code"


def hang_fault(name: str, law: Law, arguments: tuple[object, ...], call: LawCall | None, seconds: float) -> str:
    """Return in one line where a compiled law hangs: the call is repeated in plain Python, which is interrupted."""
    at = f" {step_text(call.dy, call.dt)}" if call else ""
    if call is not None:
        try:
            with np.errstate(all="ignore"), time_limit(HANG_REPLAY_S):
                checked_step(name, law, arguments, call.z, call.dy, call.dt)
        except OverdueError as overdue:
            return f"the law of {name} {overdue_text(overdue, law, at.strip(), round(seconds))}"
        except PluginError:  # compiled code got further than that
            pass
    found = f"the law of {name} ({law_place(law)}) has not returned after {seconds:.0f} s{at}, in compiled code"
    return f"{found}; expected a force at once: fix the condition that ends its loops, or make it faster"


def overdue_text(error: OverdueError, law: Law, at: str, seconds: float = LAW_TIME_LIMIT_S) -> str:
    """Return the message about a law that does not return, to follow its name; `at` says on which call."""
    place = error_location(error, law.__code__.co_filename, law.__code__.co_firstlineno)
    found = f"({place}) has not returned after {seconds:g} s {at}".rstrip()
    return f"{found}; expected a force at once: fix the condition that ends its loops"


def step_text(dy: float, dt: float) -> str:
    """Return a step in words."""
    return f"on dy = {dy:g} m in {dt:g} s"


def law_place(law: Law) -> str:
    """Return the file of a law, and the line at which it begins."""
    return f"{Path(law.__code__.co_filename).name}, line {law.__code__.co_firstlineno}"


def step_fault(
    name: str, law: Law, arguments: tuple[object, ...], z: NDArray[np.float64], dy: float, dt: float, error: Exception
) -> str:
    """Return what an error in a step means."""
    if isinstance(error, IndexError | ValueError):  # an index or a write that is not allowed, which names no array
        error = _named_access_error(law, arguments, z, dy, dt) or error
    place = _innermost_place(error)
    if isinstance(error, _LawAccessError):
        return f"the law of {name} ({place}) {error} {step_text(dy, dt)}"
    return f"the law of {name} ({place}) fails {step_text(dy, dt)}: {type(error).__name__}: {error}"


def _innermost_place(error: Exception) -> str:
    """Return the innermost file and line of an error, outside of this module."""
    lines = [line for line in traceback.extract_tb(error.__traceback__) if line.filename != __file__]
    return f"{Path(lines[-1].filename).name}, line {lines[-1].lineno}" if lines else "unknown place"


def _named_access_error(
    law: Law, arguments: tuple[object, ...], z: NDArray[np.float64], dy: float, dt: float
) -> _LawAccessError | None:
    """Return the access that fails when the step is repeated with arrays that know their names."""
    names = argument_names(law)
    known = names if len(names) == len(arguments) else ["a parameter"] * len(arguments)
    named = [_named_array(value, label, False) for value, label in zip(arguments, known, strict=True)]
    try:
        law(_named_array(z, "z", False), dy, dt, _named_array(np.full(z.size, np.nan), "z_next", True), *named)
    except _LawAccessError as error:
        return error
    except Exception:  # the caller has one that says more
        return None
    return None


class _NamedArray(np.ndarray[Any, Any]):
    """An array whose name is part of the error of a wrong access."""

    label: str
    is_writable: bool

    def __array_finalize__(self, source: object) -> None:
        """Give a slice the name of its array."""
        self.label, self.is_writable = getattr(source, "label", "an array"), getattr(source, "is_writable", True)

    def __getitem__(self, index: Any) -> Any:
        try:
            return super().__getitem__(index)
        except IndexError:
            raise _LawAccessError(f"read {self.label}[{index}] of {self.size}") from None

    def __setitem__(self, index: Any, value: Any) -> None:
        if not self.is_writable:
            what = f"{self.label}[{index}]"
            raise _LawAccessError(f"writes {what}; it may write only z_next, as steps are repeated:")
        try:
            super().__setitem__(index, value)
        except IndexError:
            raise _LawAccessError(f"wrote {self.label}[{index}] of {self.size}") from None


def _named_array(value: object, label: str, is_writable: bool) -> object:
    if isinstance(value, tuple):
        return tuple(_named_array(part, label, is_writable) for part in value)
    if not isinstance(value, np.ndarray):
        return value
    array = value.copy().view(_NamedArray)
    array.label, array.is_writable = label, is_writable
    return array


def _read_only(value: object) -> object:
    if isinstance(value, tuple):
        return tuple(map(_read_only, value))
    if not isinstance(value, np.ndarray):
        return value
    view = value.view()
    view.flags.writeable = False
    return view
