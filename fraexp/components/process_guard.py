"""Guards around a dropped-in file that is loaded: it may define, and changes nothing of the whole process."""

import atexit
import builtins
import math
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from fraexp.errors import PluginError

REFUSED_CALLS = {
    (os, "_exit"): "ends the process",
    (os, "abort"): "ends the process",
    (os, "kill"): "sends a signal",
    (os, "fork"): "makes fraexp go on twice",
    (os, "chdir"): "changes the folder of fraexp",
    (signal, "signal"): "changes what fraexp does on a signal",
    (signal, "alarm"): "sends a signal",
    (signal, "setitimer"): "sends a signal",
    (atexit, "register"): "makes fraexp do more at its end",
}
"""Functions that a file must not call while it is loaded, and what they do."""
KEPT_MODULES = (builtins, math, os, time)
"""Modules of which a file must not replace anything."""


@contextmanager
def harm_refused(file: str) -> Iterator[None]:
    """Make what harms the whole process an error of the code of a file that is loaded in the `with` block.

    Threads that it starts become daemons: fraexp would otherwise wait at its end for one that never returns.
    """
    loading, real_start = threading.get_ident(), threading.Thread.start

    def start_daemon(thread: threading.Thread) -> None:
        if threading.get_ident() == loading:
            thread.daemon = True
        real_start(thread)

    refused = [(place, does) for place, does in REFUSED_CALLS.items() if hasattr(*place)]
    stand_ins: dict[tuple[Any, str], Callable[..., object]] = {(threading.Thread, "start"): start_daemon}
    stand_ins |= {place: _refusal(*place, does, file) for place, does in refused}
    with _replace_functions(stand_ins), _keep_modules():
        yield


@contextmanager
def _replace_functions(stand_ins: Mapping[tuple[Any, str], Callable[..., object]]) -> Iterator[None]:
    """Replace functions, given by what has them and their name, in the `with` block."""
    real = {place: getattr(*place) for place in stand_ins}
    try:
        for place, stand_in in stand_ins.items():
            setattr(*place, stand_in)
        yield
    finally:
        for place, function in real.items():
            setattr(*place, function)


def _refusal(module: ModuleType, name: str, does: str, file: str) -> Callable[..., object]:
    """Return what stands in for a function: it refuses calls from the file, and of `os` from all that it imports."""
    real, loading = getattr(module, name), threading.get_ident()

    def refuse(*arguments: Any, **named: Any) -> object:
        is_from_file = module is os or sys._getframe(1).f_code.co_filename == file
        if threading.get_ident() != loading or not is_from_file:
            return real(*arguments, **named)
        call = f"{module.__name__}.{name}({', '.join(map(repr, arguments))})"
        raise PluginError(f"it {does} by {call:.80}; expected definitions only")

    return refuse


@contextmanager
def _keep_modules() -> Iterator[None]:
    """Raise PluginError if the `with` block replaces a part of a module that everything uses, and put it back."""
    before = [(module, dict(vars(module))) for module in KEPT_MODULES]
    replaced = ""
    try:
        yield
    finally:
        for module, parts in before:
            for name in [name for name, part in parts.items() if vars(module).get(name) is not part]:
                setattr(module, name, parts[name])
                replaced = f"{module.__name__}.{name}"
    if replaced:
        raise PluginError(f"it replaces {replaced} for all of fraexp; expected definitions only")


@contextmanager
def settings_restored() -> Iterator[None]:
    """Restore what a file changes of numpy's error handling, of warnings and of the interpreter's recursion limit."""
    recursion_limit = sys.getrecursionlimit()
    with np.errstate(), warnings.catch_warnings():
        try:
            yield
        finally:
            sys.setrecursionlimit(recursion_limit)
