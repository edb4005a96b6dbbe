"""From the command line to an exit code; an error is one line on stderr, with the nearest name if one is wrong.

argparse tells neither its options nor the place where a choice is checked in public: `_actions` and `_check_value` are
its private members. tests/cli/test_usage.py fails if they change.
"""

import argparse
import gc
import importlib
import io
import os
import signal
import sys
import threading
import traceback
from argparse import Namespace
from collections.abc import Iterable, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

from fraexp.cli.exits import ExitCode
from fraexp.cli.options import COMMANDS, COMMON_OPTIONS
from fraexp.cli.output import forget_documents, report_error, say
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
    did_you_mean,
)
from fraexp.workspace.workspace_folder import DATABASE_VARIABLE

EPILOG = "exit codes:\n" + "\n".join(f"  {code.value:<4} {code.sentence}" for code in ExitCode)


class UsageError(Exception):
    """The command line is invalid; the text is one line."""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line with the nearest name, raised instead of printed."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError."""
        raise UsageError(f"{self._command}{message}; see {self.prog} --help")

    @property
    def _command(self) -> str:
        return f"{self.prog.partition(' ')[2]}: ".removeprefix(": ")

    def check_options(self, arguments: Iterable[str]) -> None:
        """Raise UsageError for a long option that does not exist, with the nearest one that does."""
        known = {option for action in self._actions for option in action.option_strings if option.startswith("--")}
        for argument in takewhile(lambda text: text != "--", arguments):
            option = argument.partition("=")[0]
            if option.startswith("--") and option not in known:
                raise UsageError(f"{self._command}unknown option '{option}'{did_you_mean(option, known)}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            what = action.metavar or action.option_strings[0]
            raise UsageError(f"unknown {what} '{value}'{did_you_mean(value, action.choices)}")


class _CommandParser(Parser):
    """The parser of one command, which sees what follows the command's name."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse after looking at every long option."""
        arguments = list(args or ())
        self.check_options(arguments)
        return super().parse_known_args(_join_sort_field(arguments), namespace)


def _join_sort_field(arguments: Iterable[str]) -> list[str]:
    """Return arguments in which ``--sort -created`` is one: a field with - before it looks like an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--sort":
            joined[-1] = f"--sort={argument}"
        else:
            joined.append(argument)
    return joined


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line; UsageError names the fault in one line."""
    defaults = argparse.Namespace(
        db=os.environ.get(DATABASE_VARIABLE) or None, workspace=Path(), debug=False, command=None, version=False
    )
    given = list(sys.argv[1:] if arguments is None else arguments)
    parser = _parser(given)
    parser.check_options(takewhile(lambda text: text not in COMMANDS, given))
    parsed = parser.parse_args(given, defaults)
    if parsed.command is None and not parsed.version:
        raise UsageError(f"no command; choose one of {', '.join(COMMANDS)}, or see fraexp --help")
    return parsed


def _parser(given: Sequence[str]) -> Parser:
    """Return the parser, in which only those commands have their options whose names are given."""
    common = _CommandParser(add_help=False, argument_default=argparse.SUPPRESS)
    group = common.add_argument_group("options of every command")
    for option in COMMON_OPTIONS:
        group.add_argument(*option.names, **option.settings)
    parser = Parser(
        prog="fraexp",
        description="Frequency response analysis of machines with friction.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        parents=[common],
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="store_true", help="print the version")
    commands = parser.add_subparsers(dest="command", metavar="command", title="commands", parser_class=_CommandParser)
    for name, (_, summary, options) in COMMANDS.items():
        description = summary[0].upper() + summary[1:] + "."
        command = commands.add_parser(name, parents=[common], help=summary, description=description, allow_abbrev=False)
        for option in options if name in given else ():
            command.add_argument(*option.names, **option.settings)
    return parser


ALLOCATION_THRESHOLD = 100_000
"""Allocations until a collection of new objects: most that a command makes are of imported modules, and stay."""


def console() -> None:
    """Run the command of this process, and end it with its exit code."""
    gc.set_threshold(ALLOCATION_THRESHOLD, 10, 10)
    open_closed_streams()
    watch_output()
    _end_by_signals()
    code = main()
    gc.freeze()  # the interpreter would look through all imported objects twice before it ends
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
    forget_documents()
    try:
        parsed = parse(arguments)
    except UsageError as error:
        given = sys.argv[1:] if arguments is None else arguments
        return report_error(f"fraexp: {error}", ExitCode.USAGE, "--json" in given)
    except SystemExit:  # --help has been printed
        return ExitCode.OK
    text, code = _execute_guarded(parsed)
    return report_error(text, code, getattr(parsed, "json", False)) if text else code


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
    return int(getattr(importlib.import_module(f"fraexp.cli.{module}"), function or "execute")(parsed))
