"""One step of a friction law in plain Python, whose faults are reported in one line: what, on which step, and where."""

import inspect
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import PluginError
from fraexp.kernels.call_watch import call_explainer
from fraexp.kernels.law_error import MAX_PLAUSIBLE_SPEED_M_S, LawCall, LawCallError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, error_location, time_limit

Law = Callable[..., float]
HANG_REPLAY_S = 5.0
"""Time limit [s] for a call that has hung in compiled code, in plain Python: it shows the line."""


class LawAccessError(Exception):
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
    return f"{found}; expected a force at once: mend what ends its loops, or make it faster"


def overdue_text(error: OverdueError, law: Law, at: str, seconds: float = LAW_TIME_LIMIT_S) -> str:
    """Return the message about a law that does not return, to follow its name; `at` says on which call."""
    place = error_location(error, law.__code__.co_filename, law.__code__.co_firstlineno)
    found = f"({place}) has not returned after {seconds:g} s {at}"
    return f"{found}; expected a force at once: mend what ends its loops"


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
    if isinstance(error, LawAccessError):
        return f"the law of {name} ({place}) {error} {step_text(dy, dt)}"
    return f"the law of {name} ({place}) fails {step_text(dy, dt)}: {type(error).__name__}: {error}"


def _innermost_place(error: Exception) -> str:
    """Return the innermost file and line of an error, outside of this module."""
    lines = [line for line in traceback.extract_tb(error.__traceback__) if line.filename != __file__]
    return f"{Path(lines[-1].filename).name}, line {lines[-1].lineno}" if lines else "unknown place"


def _named_access_error(
    law: Law, arguments: tuple[object, ...], z: NDArray[np.float64], dy: float, dt: float
) -> LawAccessError | None:
    """Return the access that fails when the step is repeated with arrays that know their names."""
    names = argument_names(law)
    known = names if len(names) == len(arguments) else ["a parameter"] * len(arguments)
    named = [_named_array(value, label, False) for value, label in zip(arguments, known, strict=True)]
    try:
        law(_named_array(z, "z", False), dy, dt, _named_array(np.full(z.size, np.nan), "z_next", True), *named)
    except LawAccessError as error:
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
            raise LawAccessError(f"read {self.label}[{index}] of {self.size}") from None

    def __setitem__(self, index: Any, value: Any) -> None:
        if not self.is_writable:
            what = f"{self.label}[{index}]"
            raise LawAccessError(f"writes {what}; it may write only z_next, as steps are repeated:")
        try:
            super().__setitem__(index, value)
        except IndexError:
            raise LawAccessError(f"wrote {self.label}[{index}] of {self.size}") from None


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
