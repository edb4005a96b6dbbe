"""Trying a friction law in plain Python, before it is compiled and its mistakes go wrong without a word."""

import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.errors import PluginError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, place_of, time_limit

STEPS = [
    (share * size, dt)
    for dt, sizes in ((1e-4, (1e-9, 1e-6)), (1.0, (1e-6, 1e-4)), (1e-4, (1e-8, 1e-5, 1e-3, 1e-1)))
    for size in sizes
    for share in (1.0, 0.0, 1.0, -0.3, -2.0, -2.0, 0.0)
]
"""Steps [m] and their times [s] with which a law is tried: small and long, slow and fast, there and back."""
PLAUSIBLE = 1.0
"""Speed [m/s] up to which a law must give numbers."""

_passed: set[tuple[object, ...]] = set()
"""Laws that have been tried, each with the sizes of its arrays: these decide which elements it may reach."""


def rehearse(
    name: str, law: Callable[..., float], arguments: tuple[Any, ...], states: int, stiffness: Callable[[], float]
) -> None:
    """Walk with a law, once per process; PluginError if it reaches beyond z, writes anything else, or gives no number.

    So it is if the law does not return, or its greatest `stiffness`, which may try the law too. A composite's law is
    tried as a whole, with the sizes that it passes on.
    """
    values = tuple(_read_only(value) for value in arguments)
    tried = (law, states, *(np.size(value) for value in values if not isinstance(value, tuple)))
    if tried in _passed:
        return
    at = "when asked for its greatest stiffness"
    try:
        with time_limit(LAW_TIME_LIMIT_S):
            with suppress(Exception):  # whatever is wrong with it is said where it is needed
                stiffness()
            z = np.zeros(states)
            for dy, dt in STEPS:
                at = f"on dy = {dy:g} m in {dt:g} s"
                z_next = _step(name, law, values, z, dy, dt)
                z = z_next if np.all(np.isfinite(z_next)) else np.zeros(states)
    except OverdueError as error:
        raise PluginError(f"the law of {name} {overdue(error, law, at)}") from None
    _passed.add(tried)


def overdue(error: OverdueError, law: Callable[..., float], at: str) -> str:
    """Return what is said of a law that does not return, after its name; `at` is what it was asked for."""
    place = place_of(error, law.__code__.co_filename, law.__code__.co_firstlineno)
    found = f"({place}) has not returned after {LAW_TIME_LIMIT_S:g} s {at}"
    return f"{found}; expected a force at once: mend what ends its loops"


def _step(
    name: str, law: Callable[..., float], arguments: tuple[Any, ...], z: np.ndarray, dy: float, dt: float
) -> np.ndarray:
    force: Any = np.nan
    z_next = np.full(z.size, np.nan)
    plausible = abs(dy) <= PLAUSIBLE * dt
    try:
        force = law(_read_only(z), dy, dt, z_next, *arguments)
    except Exception as error:
        if plausible or not isinstance(error, ArithmeticError):  # which compiled code answers with inf
            raise PluginError(_complaint(name, error, z.size, dy, dt)) from error
    sound = isinstance(force, float | int) and np.isfinite(force) and np.all(np.isfinite(z_next))
    if plausible and not sound:
        found = f"a force of {force} and a next state of {z_next.tolist()}"
        raise PluginError(f"the law of {name} gives {found} on dy = {dy:g} m; expected finite numbers")
    return z_next


def _complaint(name: str, error: Exception, states: int, dy: float, dt: float) -> str:
    line = traceback.extract_tb(error.__traceback__)[-1]
    place = f"({Path(line.filename).name}, line {line.lineno})"
    if "read-only" in str(error):
        return f"the law of {name} writes z or a parameter; it may write z_next, as steps are tried {place}"
    size = f"z has {states} elements (states, or state_size)"
    return f"the law of {name} fails on dy = {dy:g} m in {dt:g} s: {type(error).__name__}: {error} {place}; {size}"


def _read_only(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    view = value.view()
    view.flags.writeable = False
    return view
