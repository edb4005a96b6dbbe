"""The parsed command line, whose errors are one line with the nearest name; this imports nothing heavy.

argparse tells neither its options nor the place where a choice is checked in public: `_actions` and `_check_value` are
its private members. tests/cli/test_usage.py fails if they change.
"""

import argparse
import os
import sys
from collections.abc import Iterable, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

from fraexp.cli.exits import ExitCode
from fraexp.cli.options import COMMANDS, COMMON_OPTIONS
from fraexp.errors import did_you_mean
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
    given, parser = list(sys.argv[1:] if arguments is None else arguments), _parser()
    parser.check_options(takewhile(lambda text: text not in COMMANDS, given))
    parsed = parser.parse_args(given, defaults)
    if parsed.command is None and not parsed.version:
        raise UsageError(f"no command; choose one of {', '.join(COMMANDS)}, or see fraexp --help")
    return parsed


def _parser() -> Parser:
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
        for option in options:
            command.add_argument(*option.names, **option.settings)
    return parser
