"""All commands, and the parsed command line; this imports nothing heavy, so that help is instant."""

import argparse
import os
import sys
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.cli.options import DECLARE
from fraexp.cli.parser import CommandParser, Parser, UsageError
from fraexp.workspace.workspace_folder import DATABASE_VARIABLE

COMMANDS = {
    "run": ("run", "compute the sweeps of studies that the database lacks"),
    "stop": ("stop", "stop a run; finished sweeps are kept"),
    "list": ("list", "list runs, studies, or the sweeps that match a filter"),
    "show": ("show", "show a run, or one sweep with its parameters and results"),
    "compare": ("compare", "compare sweeps: parameters, metrics and frequency responses"),
    "plot": ("plot", "plot a run or sweeps to a figure file"),
    "fit": ("fit", "fit a plant model to stored frequency responses"),
    "tune": ("fit", "tune the feedback for stored frequency responses, with margins for all plants of their band"),
    "design": ("fit", "choose the sines that tell most in a given measuring time, and write their study"),
    "report": ("report", "write an HTML report of runs"),
    "export": (
        "export",
        "export the result of a sweep to CSV, JSON, MAT, HDF5 or UNV, or a controller to C or ST",
    ),
    "import": ("import_record", "analyse a measured record, or list its contents"),
    "measure": ("measure", "play the excitation of a study on a machine, and analyse what it records"),
    "excite": ("excite", "write the excitation of a study to a file that a machine can play"),
    "plugins": ("plugins", "list the available components, and plugins that failed to load"),
    "new": ("new", "create a plugin from a template: a file in plugins/, or a package"),
    "check": ("check", "run the conformance checks of a plugin's components"),
    "tag": ("tag", "add a tag to sweeps, or remove it"),
    "note": ("note", "attach a note to a sweep"),
    "delete": ("delete", "move runs or sweeps to the trash, with their results, or empty it"),
    "undelete": ("undelete", "bring runs or sweeps back from the trash"),
    "merge": ("merge", "merge another database into this one"),
    "restore": ("restore", "put a copy of a database in the place of this one, which is kept"),
    "tui": ("tui", "start the terminal UI: launch, watch and compare studies"),
    "serve": ("serve", "serve the terminal UI to a web browser"),
    "doctor": ("doctor", "check the installation, the database, the plugins and the numerics"),
}
"""Module and one-line help of each command."""

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


def _common() -> CommandParser:
    common = CommandParser(add_help=False, argument_default=argparse.SUPPRESS)
    group = common.add_argument_group("options of every command")
    group.add_argument(
        "--db",
        metavar="URL",
        help="database: a file, or postgresql://user@host/base (default: $FRAEXP_DB, or WORKSPACE/results.db)",
    )
    group.add_argument(
        "--workspace", metavar="DIR", type=Path, help="folder with plugins/ and studies/ (default: here)"
    )
    group.add_argument("--debug", action="store_true", help="show the traceback if an error occurs")
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
