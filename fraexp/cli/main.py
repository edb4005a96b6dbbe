"""From the command line to an exit code; an error is one line on stderr."""

import gc
import importlib
import io
import os
import signal
import sys
import threading
import traceback
from argparse import Namespace
from collections.abc import Sequence
from contextlib import suppress
from types import ModuleType

from fraexp.cli.arguments import COMMANDS, parse
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.parser import UsageError
from fraexp.errors import FraexpError, StoreError, UnreachedError


def console() -> None:
    """Run the command of this process, and end it with its exit code."""
    for name in ("SIGTERM", "SIGHUP"):  # asked to end: as with Ctrl-C, what is finished is kept
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)
    code = main()
    if code == ExitCode.INTERRUPTED:
        _wait_for_threads(PATIENCE)
        sys.stderr.flush()
        os._exit(code)  # an interpreter that ends waits for threads, and may make another code of the signal
    sys.exit(code)


PATIENCE = 0.5
"""Seconds that threads have to end after an interruption."""


def _wait_for_threads(patience: float) -> None:
    others = [thread for thread in threading.enumerate() if not (thread.daemon or thread is threading.main_thread())]
    for thread in others:
        thread.join(patience / len(others))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal without µ or ° must not end a run
            stream.reconfigure(errors="backslashreplace")
    try:
        code = _parse_and_execute(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:  # before or after the command itself
        with suppress(OSError):
            say("fraexp: interrupted")
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the flush at exit complains
        return ExitCode.PIPE_CLOSED
    return code


def _parse_and_execute(arguments: Sequence[str] | None) -> int:
    try:
        parsed = parse(arguments)
    except UsageError as error:
        say(f"fraexp: {error}")
        return ExitCode.USAGE
    except SystemExit:  # --help has been printed
        return ExitCode.OK
    return _guarded(parsed)


def _guarded(parsed: Namespace) -> int:
    try:
        return _execute(parsed)
    except BrokenPipeError:
        raise
    except KeyboardInterrupt:
        say("fraexp: interrupted")
        return ExitCode.INTERRUPTED
    except FraexpError as error:
        if parsed.debug:
            traceback.print_exc()
        say(f"fraexp: {error}")
        return _code_of(error)
    except Exception as error:
        if parsed.debug:
            traceback.print_exc()
        more = "please report it" if parsed.debug else "run with --debug for the traceback"
        say(f"fraexp: internal error: {type(error).__name__}: {error}; {more}")
        return ExitCode.INTERNAL


def _code_of(error: FraexpError) -> ExitCode:
    if isinstance(error, UnreachedError):
        return ExitCode.INCOMPLETE
    return ExitCode.STORE if isinstance(error, StoreError) else ExitCode.USAGE


def _execute(parsed: Namespace) -> int:
    if parsed.version:
        from fraexp.execution.provenance import gather

        print(gather()["fraexp"])
        return ExitCode.OK
    return int(_module(COMMANDS[parsed.command][0]).execute(parsed))


def _module(command: str) -> ModuleType:
    """Import a command and what it needs; garbage is looked for neither meanwhile nor later in what was imported."""
    name = f"fraexp.cli.{command}"
    if name in sys.modules or not gc.isenabled():
        return importlib.import_module(name)
    gc.disable()
    try:
        return importlib.import_module(name)
    finally:
        gc.freeze()
        gc.enable()
