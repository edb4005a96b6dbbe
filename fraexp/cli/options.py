"""The options of each command."""

import argparse
from pathlib import Path

from fraexp.cli import import_options
from fraexp.cli.parser import Parser
from fraexp.data.figure_kinds import FIGURES

KINDS = ("friction", "plant", "controller", "excitation", "estimator", "reader")
"""Kinds of component."""
IDENTIFIER = "a run's number, a study's name for its newest run, or the beginning of a sweep's key"

ALL = "show each of many sweeps on a terminal too, not quantiles over them"


def _json(parser: Parser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def _list(parser: Parser) -> None:
    parser.add_argument(
        "filter", metavar="FILTER", nargs="*",
        help="list the sweeps for which all of these hold, such as estimator=proposed 'excitation.amplitude>=12' "
        "state:failed tag:baseline; names and texts with blanks stand in quotes, as in 'metric.\"peak force\">14N'",
    )  # fmt: skip
    parser.add_argument("--studies", action="store_true", help="list the studies, and what running them would do")
    parser.add_argument("--sweeps", action="store_true", help="list all sweeps, as an empty filter does")
    parser.add_argument(
        "--order", metavar="FIELD", default="-created", help="sort the sweeps; - before it: falling (default: -created)"
    )
    parser.add_argument(
        "--limit", metavar="COUNT", type=int, default=100, help="most sweeps that are listed (default: 100)"
    )
    parser.add_argument("--offset", metavar="COUNT", type=int, default=0, help="sweeps to leave out before them")
    _json(parser)


def _stop(parser: Parser) -> None:
    parser.add_argument("run", metavar="RUN", type=int, help="number of a run")
    parser.add_argument("--hard", action="store_true", help="end its processes at once; what is stored stays")


def _tag(parser: Parser) -> None:
    parser.add_argument("tag", metavar="TAG", help="a word")
    parser.add_argument("ids", metavar="ID", nargs="+", help=IDENTIFIER)
    parser.add_argument("--remove", action="store_true", help="take the tag away")


def _note(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help="the beginning of a sweep's key")
    parser.add_argument("text", metavar="TEXT", help="the note; an empty one takes it away")


def _delete(parser: Parser) -> None:
    parser.add_argument(
        "ids", metavar="ID", nargs="+",
        help="a run's number, with the sweeps that are in no other run, or the beginning of a sweep's key",
    )  # fmt: skip
    parser.add_argument("--yes", action="store_true", help="do not ask")


def _merge(parser: Parser) -> None:
    parser.add_argument("other", metavar="OTHER", help="database to read: a file or URL; what --db names is added to")
    _json(parser)


def _serve(parser: Parser) -> None:
    parser.add_argument("--port", metavar="PORT", type=int, default=8000, help="port (default: 8000)")
    parser.add_argument("--host", metavar="ADDRESS", default="127.0.0.1", help="address (default: this machine only)")
    parser.add_argument("--remote", action="store_true", help="allow an address that others reach; needs a token")
    parser.add_argument("--token", metavar="TEXT", default="", help="word that a browser must give (default: made up)")


def _tui(parser: Parser) -> None:
    parser.add_argument("--ascii", action="store_true", help="draw with ASCII characters alone")


def _run(parser: Parser) -> None:
    parser.add_argument("study", metavar="STUDY", nargs="+", help="study file (TOML)")
    parser.add_argument(
        "--executor",
        metavar="NAME",
        help="serial, processes[:N] or dask:ADDRESS (default: all cores, or one where that is faster)",
    )
    parser.add_argument(
        "--set", metavar="PATH=VALUE", dest="overrides", action="append", default=[], help="override a study's value"
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="say what would be computed, and why, and about how long it takes"
    )
    parser.add_argument(
        "--time-limit", metavar="TIME", help="most that a sweep may take: 60, 90s, 5min, none (default: 1h)"
    )
    parser.add_argument(
        "--memory", metavar="SIZE", help="most that a worker process may have, such as 2GB (default: all)"
    )
    parser.add_argument("--rerun", choices=("stale", "failed", "all"), help="compute these again")
    parser.add_argument("--detach", action="store_true", help="run in the background, with a log; see fraexp stop")
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
    parser.add_argument("--band", metavar="LOW:HIGH", default="", help="frequencies [Hz] to show, such as 4.5:45")
    parser.add_argument("--wrapped", action="store_true", help="phase of a Bode plot within ±180 degrees")


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
    parser.add_argument("--force", action="store_true", help="replace a file that is no earlier report")


def _export(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help=IDENTIFIER)
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True, help="file: .csv, .json, .mat, .h5 or .unv"
    )
    parser.add_argument("--force", action="store_true", help="replace the file if it exists")


def _new(parser: Parser) -> None:
    parser.add_argument("kind", metavar="KIND", choices=KINDS, help=f"kind of component: {', '.join(KINDS)}")
    parser.add_argument("name", metavar="NAME", help="its name in studies, such as my_law")
    parser.add_argument("--package", action="store_true", help="write an installable package with its test")


def _check(parser: Parser) -> None:
    parser.add_argument("name", metavar="NAME", help="name of a component, or a plugin's file")
    parser.add_argument("--kind", metavar="KIND", choices=KINDS, help="its kind, if several have the name")
    parser.add_argument("--quick", action="store_true", help="look at few examples, and compile nothing")
    _json(parser)


DECLARE = {
    "run": _run,
    "stop": _stop,
    "list": _list,
    "show": _show,
    "compare": _compare,
    "plot": _plot,
    "fit": _fit,
    "report": _report,
    "export": _export,
    "import": import_options.declare,
    "plugins": _json,
    "new": _new,
    "check": _check,
    "tag": _tag,
    "note": _note,
    "delete": _delete,
    "merge": _merge,
    "migrate": _json,
    "tui": _tui,
    "serve": _serve,
    "doctor": _json,
}
