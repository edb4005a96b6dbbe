"""All commands, and the command line as it was given; importing this costs nothing, so that help is instant."""

import argparse
import sys
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.cli.options import DECLARE
from fraexp.cli.parser import CommandParser, Parser, UsageError

COMMANDS = {
    "run": ("run", "compute what studies ask for and the database lacks"),
    "stop": ("stop", "ask a run to end and keep what is finished"),
    "list": ("list", "list the runs, the studies, or the sweeps that a filter finds"),
    "show": ("show", "show a run, or a sweep with its parameters and numbers"),
    "compare": ("compare", "show in what sweeps differ: parameters, metrics, responses"),
    "plot": ("plot", "draw a run or sweeps"),
    "fit": ("fit", "fit a plant model to stored responses"),
    "report": ("report", "write a report of runs as HTML"),
    "export": ("export", "write a sweep's result to a file for other programs"),
    "import": ("import_record", "analyse a measured record"),
    "plugins": ("plugins", "list the components that plugins supply, and the broken plugins"),
    "new": ("new", "write a plugin to start from: a file in plugins/, or a package"),
    "check": ("check", "run the conformance checks of a plugin's components"),
    "tag": ("tag", "give sweeps a tag, or take it away"),
    "note": ("note", "write a note on a sweep"),
    "delete": ("delete", "delete runs or sweeps with their results"),
    "merge": ("merge", "add what another database has"),
    "migrate": ("migrate", "bring a database up to date, and give back unused room"),
    "tui": ("tui", "launch, watch and compare studies in the terminal"),
    "serve": ("serve", "show the terminal UI in a browser"),
    "doctor": ("doctor", "check the installation, the database and the plugins"),
}
"""Module and one-line help of each command."""

EPILOG = "exit codes:\n" + "\n".join(f"  {code.value:<4} {code.sentence}" for code in ExitCode)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line; UsageError says in one line what is wrong with it."""
    defaults = argparse.Namespace(db=None, workspace=Path(), debug=False, command=None, version=False)
    given, parser = list(sys.argv[1:] if arguments is None else arguments), _parser()
    parser.check_options(takewhile(lambda text: text not in COMMANDS, given))
    parsed = parser.parse_args(given, defaults)
    if parsed.command is None and not parsed.version:
        raise UsageError(f"no command; choose one of {', '.join(COMMANDS)}, or see fraexp --help")
    return parsed


def _common() -> CommandParser:
    common = CommandParser(add_help=False, argument_default=argparse.SUPPRESS)
    group = common.add_argument_group("options of every command")
    group.add_argument(
        "--db", metavar="URL", help="database: a file, or postgresql://user@host/base (default: WORKSPACE/results.db)"
    )
    group.add_argument(
        "--workspace", metavar="DIR", type=Path, help="folder with plugins/ and studies/ (default: here)"
    )
    group.add_argument("--debug", action="store_true", help="show the traceback of an error")
    return common


def _parser() -> Parser:
    common = _common()
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
    for name, (_, summary) in COMMANDS.items():
        command = commands.add_parser(
            name, parents=[common], help=summary, description=summary[0].upper() + summary[1:] + ".", allow_abbrev=False
        )
        DECLARE[name](command)
    return parser
