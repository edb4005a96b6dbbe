"""A parser of command lines whose errors are one line with the nearest name.

argparse tells neither its options nor the place where a choice is checked in public: `_actions` and `_check_value` are
its private members. tests/cli/test_usage.py fails if they change.
"""

import argparse
from collections.abc import Iterable
from itertools import takewhile
from typing import Any, NoReturn

from fraexp.errors import did_you_mean


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


class CommandParser(Parser):
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
