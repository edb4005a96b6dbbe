"""The parsed command line; this imports nothing heavy, so that help is instant."""

import argparse
import os
import sys
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.cli.options import COMMANDS, COMMON_OPTIONS
from fraexp.cli.parser import CommandParser, Parser, UsageError
from fraexp.workspace.workspace_folder import DATABASE_VARIABLE

EPILOG = "exit codes:\n" + "\n".join(f"  {code.value:<4} {code.sentence}" for code in ExitCode)


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
    common = CommandParser(add_help=False, argument_default=argparse.SUPPRESS)
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
    commands = parser.add_subparsers(dest="command", metavar="command", title="commands", parser_class=CommandParser)
    for name, (_, summary, options) in COMMANDS.items():
        description = summary[0].upper() + summary[1:] + "."
        command = commands.add_parser(name, parents=[common], help=summary, description=description, allow_abbrev=False)
        for option in options:
            command.add_argument(*option.names, **option.settings)
    return parser
