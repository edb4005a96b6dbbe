"""Dropped-in plugin files: imported as modules of their own, with the process guarded from what their code does."""

import atexit
import builtins
import importlib.util
import math
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

from fraexp.data.identity import content_hash
from fraexp.errors import PluginError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, error_location, time_limit

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


DROP_IN = "fraexp_drop_in_"
"""How the names of these modules begin: stable, so that compiled laws are found again."""
GRACE_S = 2.0
"""Time [s] after the limit in which a file that computes is interrupted, before one that waits is."""
SOURCE_HASH = "__fraexp_source_hash__"
"""Name in such a module of the content hash of its source as it was loaded: the file may have been edited since."""


class _LocalFileLoader(SourceFileLoader):
    """Reads the source each time: its cached bytecode would hide an edit within the second that keeps the size."""

    def get_code(self, fullname: str) -> CodeType:
        """Return the code of the source as it is now."""
        source = self.get_data(self.path)
        self.source_hash = content_hash(source)
        return compile(source, self.path, "exec", dont_inherit=True)


def load_file(file: Path) -> ModuleType:
    """Import a dropped-in file as a module of its own, as it is now; raises what the file raises."""
    name = DROP_IN + file.stem
    loader = _LocalFileLoader(name, str(file))
    spec = importlib.util.spec_from_file_location(name, file, loader=loader)
    if spec is None or spec.loader is None:
        raise PluginError(f"{file} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # numba and inspect find the law's source through it
    try:
        with time_limit(LAW_TIME_LIMIT_S), _wait_limit(), settings_restored(), harm_refused(str(file)):
            spec.loader.exec_module(module)
        vars(module)[SOURCE_HASH] = loader.source_hash
    except OverdueError as error:
        del sys.modules[name]
        place = error_location(error, str(file), 1)
        why = f"it has not been loaded after {LAW_TIME_LIMIT_S:g} s ({place}); expected definitions at once"
        raise PluginError(why) from None
    except BaseException:
        del sys.modules[name]
        raise
    return module


def loaded_source_hash(cls: type) -> str:
    """Return the content hash of the dropped-in source that defines a class; empty for a class of another module."""
    return str(vars(sys.modules.get(cls.__module__, sys)).get(SOURCE_HASH, ""))


@contextmanager
def _wait_limit() -> Iterator[None]:
    """Raise OverdueError in the `with` block if it waits in a function written in C, as in a sleep.

    Only a signal ends such a wait, and only the main thread gets signals.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def ring(number: int, frame: object) -> None:
        raise OverdueError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, LAW_TIME_LIMIT_S + GRACE_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
