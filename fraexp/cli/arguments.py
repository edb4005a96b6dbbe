"""All commands and their options; importing this costs nothing, so that help is instant."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

from fraexp.cli.exits import ExitCode
from fraexp.errors import did_you_mean
from fraexp.figures.kinds import FIGURES

COMMANDS = {
    "run": ("run", "compute what studies ask for and the database lacks"),
    "list": ("list", "list the runs"),
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
    "doctor": ("doctor", "check the installation, the database and the plugins"),
}
"""Module and one-line help of each command."""

KINDS = ("friction", "plant", "controller", "excitation", "estimator", "reader")
"""Kinds of component."""
EPILOG = "exit codes:\n" + "\n".join(f"  {code.value:<4} {code.sentence}" for code in ExitCode)
IDENTIFIER = "a run's number, a study's name for its newest run, or the beginning of a sweep's key"

ALL = "show each of many sweeps on a terminal too, not quantiles over them"


class UsageError(Exception):
    """The command line asks for something that does not exist; its text is one line."""


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
                raise UsageError(f"{self._command}no option '{option}'{did_you_mean(option, known)}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            what = action.metavar or action.option_strings[0]
            raise UsageError(f"'{value}' is no {what}{did_you_mean(value, action.choices)}")


class CommandParser(Parser):
    """The parser of one command, which sees what follows the command's name."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse after looking at every long option."""
        self.check_options(args or ())
        return super().parse_known_args(args, namespace)


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
    group.add_argument("--db", metavar="URL", help="database: a path or SQLAlchemy URL (default: WORKSPACE/results.db)")
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


def _json(parser: Parser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def _run(parser: Parser) -> None:
    parser.add_argument("study", metavar="STUDY", nargs="+", help="study file (TOML)")
    parser.add_argument(
        "--executor",
        metavar="NAME",
        help="serial, or processes[:N] (default: all cores, or one for what takes a second)",
    )
    parser.add_argument(
        "--set", metavar="PATH=VALUE", dest="overrides", action="append", default=[], help="override a study's value"
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="say what would be computed, and about how long it takes"
    )
    parser.add_argument("--rerun", choices=("stale", "failed", "all"), help="compute these again")
    _json(parser)


def _show(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help=IDENTIFIER)
    parser.add_argument("--points", action="store_true", help="show every frequency of the response")
    parser.add_argument("--all", action="store_true", help=ALL)
    _json(parser)


def _compare(parser: Parser) -> None:
    parser.add_argument("ids", metavar="ID", nargs="+", help=IDENTIFIER + "; the first is compared with the others")
    parser.add_argument(
        "--against", metavar="WHAT", choices=("first", "plant"), default="first",
        help="first: the others with the first sweep; plant: each simulated response with its plant P(jω)",
    )  # fmt: skip
    parser.add_argument(
        "--at", metavar="HZ,...", type=_frequencies, help="frequencies of the errors against the plant, such as 5,39,80"
    )
    parser.add_argument("--all", action="store_true", help=ALL)
    _json(parser)


def _frequencies(text: str) -> tuple[float, ...]:
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if not found or not all(0 < frequency < float("inf") for frequency in found):
        raise argparse.ArgumentTypeError(f"'{text}' are no frequencies; expected such as 5,39,80")
    return found


def _plot(parser: Parser) -> None:
    parser.add_argument("ids", metavar="ID", nargs="+", help=IDENTIFIER)
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="figure: .png, .svg or .pdf")
    parser.add_argument("--title", default="", help="title of the figure")
    parser.add_argument(
        "--kind", metavar="KIND", choices=FIGURES, default="",
        help=f"kind of figure: {', '.join(FIGURES)} (default: what fits the results)",
    )  # fmt: skip


def _fit(parser: Parser) -> None:
    parser.add_argument("ids", metavar="ID", nargs="+", help=IDENTIFIER)
    parser.add_argument(
        "--set", metavar="PARAMETER=VALUE", dest="overrides", action="append", default=[],
        help="a parameter of the fit, such as modes=2 or highest=150",
    )  # fmt: skip
    parser.add_argument("--using", metavar="NAME", default="", help="estimator that fits (default: the one there is)")
    _json(parser)


def _report(parser: Parser) -> None:
    parser.add_argument(
        "ids", metavar="ID", nargs="+",
        help="a run's number, a study's name for its newest run, or a folder's for those of its studies",
    )  # fmt: skip
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="report: .html")
    parser.add_argument("--title", default="", help="title of the report")


def _export(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help=IDENTIFIER)
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True, help="file: .csv, .json, .mat, .h5 or .unv"
    )
    parser.add_argument("--force", action="store_true", help="replace the file if it exists")


def _import(parser: Parser) -> None:
    parser.add_argument(
        "files", metavar="FILE", type=Path, nargs="+",
        help="measured record: .csv or .mat; several are realisations of one experiment",
    )  # fmt: skip
    parser.add_argument(
        "--channel", metavar="NAME=COLUMN", dest="channels", action="append", default=[],
        help="a channel, such as u=force, 'y=position [mm]' or 'u=(volts - 2.5) * 31.5 [N]'; the first is the input, "
        "the second the output; without any, what is in the file is listed",
    )  # fmt: skip
    _import_clock(parser)
    _import_segments(parser)
    _import_lines(parser)
    parser.add_argument(
        "--integrate", metavar="NAME[=TIMES]", action="append", default=[],
        help="integrate a channel over time, such as y=2 from acceleration to displacement; below 0: differentiate",
    )  # fmt: skip
    parser.add_argument(
        "--estimator", metavar="NAME", dest="estimators", action="append", default=[],
        help="what is estimated (default: conventional); several are compared; see fraexp plugins",
    )  # fmt: skip
    parser.add_argument(
        "--set", metavar="PATH=VALUE", dest="settings", action="append", default=[],
        help="set a parameter of the estimator, such as estimator.order=2",
    )  # fmt: skip
    parser.add_argument("--study", metavar="FILE", type=Path, help="study to write, by default studies/FILE.toml")
    _json(parser)


def _import_clock(parser: Parser) -> None:
    parser.add_argument("--sample-rate", metavar="HZ", type=float, help="sample rate, if the file has no time column")
    parser.add_argument("--time", metavar="COLUMN", help="column with the time, such as 'time [ms]'")
    parser.add_argument("--period", metavar="SAMPLES", type=int, help="samples per period of the excitation")
    parser.add_argument("--period-time", metavar="SECONDS", type=float, help="the same as a time")
    parser.add_argument("--frequency", metavar="COLUMN", help="column with the frequency of a stepped sine")
    parser.add_argument(
        "--not-periodic", action="store_const", const=False, dest="periodic", help="the record does not repeat itself"
    )
    parser.add_argument("--skip", metavar="PERIODS", type=int, help="periods to drop at the start")
    parser.add_argument("--skip-time", metavar="SECONDS", type=float, help="time to drop at the start")


def _import_segments(parser: Parser) -> None:
    parser.add_argument(
        "--level", metavar="NAME", dest="levels", action="append", type=_name, default=[],
        help="what {level} stands for in columns, files or --where; several are compared",
    )  # fmt: skip
    parser.add_argument(
        "--realisation", metavar="NAME", dest="realisations", action="append", type=_name,
        help="what {realisation} stands for in columns or files; several are averaged",
    )  # fmt: skip
    parser.add_argument(
        "--periods", metavar="COUNT", type=int, help="periods of each realisation, where several follow one another"
    )
    parser.add_argument("--where", metavar="COLUMN=NUMBER", help="take those samples alone, such as amplitude=12")
    parser.add_argument("--segment", metavar="COLUMN", help="column that numbers the realisations; 0 between them")
    parser.add_argument("--each-file", action="store_true", help="each FILE is an experiment of its own")


def _import_lines(parser: Parser) -> None:
    parser.add_argument("--lowest", metavar="HZ", type=float, help="lowest excited frequency")
    parser.add_argument("--highest", metavar="HZ", type=float, help="highest excited frequency")
    parser.add_argument(
        "--every", metavar="COUNT", type=int, help="every how many harmonics one is excited, from lowest to highest"
    )
    parser.add_argument("--lines", metavar="N,...", type=_harmonics, help="excited harmonics, such as 1,3,7-15")


def _name(text: str) -> int | float | str:
    for number in (int, float):
        with suppress(ValueError):
            return number(text)
    return text


def _harmonics(text: str) -> list[int]:
    found: list[int] = []
    try:
        for part in text.split(","):
            first, _, last = part.partition("-")
            found += range(int(first), int(last or first) + 1)
    except ValueError:
        found = []
    if not found or min(found) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' are no harmonics; expected such as 1,3,7-15")
    return found


def _new(parser: Parser) -> None:
    parser.add_argument("kind", metavar="KIND", choices=KINDS, help=f"kind of component: {', '.join(KINDS)}")
    parser.add_argument("name", metavar="NAME", help="its name in studies, such as my_law")
    parser.add_argument("--package", action="store_true", help="write an installable package with its test")


def _check(parser: Parser) -> None:
    parser.add_argument("name", metavar="NAME", help="name of a component, or a plugin's file")
    parser.add_argument("--kind", metavar="KIND", choices=KINDS, help="its kind, if several have the name")
    _json(parser)


DECLARE = {
    "run": _run,
    "list": _json,
    "show": _show,
    "compare": _compare,
    "plot": _plot,
    "fit": _fit,
    "report": _report,
    "export": _export,
    "import": _import,
    "plugins": _json,
    "new": _new,
    "check": _check,
    "doctor": _json,
}
