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
from types import ModuleType

from fraexp.cli.arguments import UsageError, parse
from fraexp.cli.exits import ExitCode
from fraexp.cli.options import COMMANDS
from fraexp.cli.output import error_document, say
from fraexp.cli.standard_streams import discard_unwritable, is_output_failure, open_closed_streams, watch_output
from fraexp.errors import (
    BeginError,
    BusyError,
    FilterError,
    FraexpError,
    LimitError,
    MachineError,
    PlanError,
    StoreError,
    UnreachedError,
)


def console() -> None:
    """Run the command of this process, and end it with its exit code."""
    open_closed_streams()
    watch_output()
    _end_by_signals()
    code = main()
    discard_unwritable(sys.stdout)
    discard_unwritable(sys.stderr)  # or the flush at exit replaces the code by one of Python's
    if code == ExitCode.INTERRUPTED:
        _wait_for_threads(THREAD_TIMEOUT_S)
        os._exit(code)  # a normal exit waits for threads, and may replace the code by the signal
    sys.exit(code)


def _end_by_signals() -> None:
    """Have SIGTERM and SIGHUP end the command as Ctrl-C does: finished sweeps are kept.

    A SIGHUP that the parent ignores stays ignored: ``nohup fraexp run`` goes on after the logout.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    hang_up = getattr(signal, "SIGHUP", None)  # not on Windows
    if hang_up is not None and signal.getsignal(hang_up) != signal.SIG_IGN:
        signal.signal(hang_up, signal.default_int_handler)


THREAD_TIMEOUT_S = 0.5
"""Seconds that threads have to end after an interruption, together."""


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
        if failure := getattr(sys.stdout, "failure", None):  # argparse is silent about its own
            raise failure
    except KeyboardInterrupt:  # before or after the command itself
        say("fraexp: interrupted")
        return ExitCode.INTERRUPTED
    except OSError as error:
        return _report_output_failure(error)
    return code


def _report_output_failure(error: OSError) -> ExitCode:
    """Return the exit code after a failure to write to standard output."""
    if isinstance(error, BrokenPipeError):
        discard_unwritable(sys.stdout)
        return ExitCode.PIPE_CLOSED
    say(f"fraexp: standard output cannot be written ({error.strerror or error}); choose another file, or make room")
    return ExitCode.OUTPUT


def _parse_and_execute(arguments: Sequence[str] | None) -> int:
    with error_document() as document:
        try:
            parsed = parse(arguments)
        except UsageError as error:
            given = sys.argv[1:] if arguments is None else arguments
            return document.report(f"fraexp: {error}", ExitCode.USAGE, "--json" in given)
        except SystemExit:  # --help has been printed
            return ExitCode.OK
        text, code = _execute_guarded(parsed)
        return document.report(text, code, getattr(parsed, "json", False)) if text else code


def _execute_guarded(parsed: Namespace) -> tuple[str, int]:
    """Return the error of a command, empty if there is none, and the exit code."""
    try:
        return "", _execute(parsed)
    except KeyboardInterrupt:
        return "fraexp: interrupted", ExitCode.INTERRUPTED
    except FraexpError as error:
        if parsed.debug:
            traceback.print_exc()
        return f"fraexp: {error}", _exit_code(error)
    except Exception as error:
        if is_output_failure(error):
            raise
        if parsed.debug:
            traceback.print_exc()
        more = "please report it" if parsed.debug else "run with --debug for the traceback"
        return f"fraexp: internal error: {type(error).__name__}: {error}; {more}", ExitCode.INTERNAL


EXIT_CODES: dict[type, ExitCode] = {
    FraexpError: ExitCode.USAGE,
    StoreError: ExitCode.STORE,
    FilterError: ExitCode.USAGE,
    UnreachedError: ExitCode.INCOMPLETE,
    MachineError: ExitCode.MACHINE,
    PlanError: ExitCode.USAGE,
    LimitError: ExitCode.LIMIT,
    BusyError: ExitCode.BUSY,
}
"""Exit code of each error, and of those derived from it."""


def _exit_code(error: FraexpError) -> ExitCode:
    if isinstance(error, BeginError):
        return next((code for code in ExitCode if code == error.code), ExitCode.INCOMPLETE)
    return next(EXIT_CODES[kind] for kind in type(error).__mro__ if kind in EXIT_CODES)


def _execute(parsed: Namespace) -> int:
    if parsed.version:
        from fraexp.execution.provenance import gather_provenance

        print(gather_provenance()["fraexp"])
        return ExitCode.OK
    module, _, function = COMMANDS[parsed.command].target.partition(":")
    return int(getattr(_import_command(f"fraexp.cli.{module}"), function or "execute")(parsed))


def _import_command(name: str) -> ModuleType:
    """Import a command; the garbage collector skips the imported modules, which saves time at the start and later."""
    if name in sys.modules or not gc.isenabled():
        return importlib.import_module(name)
    gc.disable()
    try:
        return importlib.import_module(name)
    finally:
        gc.freeze()
        gc.enable()
