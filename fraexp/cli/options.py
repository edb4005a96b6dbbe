"""The options of each command."""

import argparse
from pathlib import Path

from fraexp.cli import import_options
from fraexp.cli.output import say
from fraexp.cli.parser import Parser
from fraexp.data.figure_kinds import FIGURES

KINDS = ("friction", "plant", "controller", "excitation", "estimator", "reader", "machine")
"""Kinds of component."""
ID_HELP = "a run number, a study name (its newest run), or the beginning of a sweep key"
ALL_HELP = "on a terminal, show every sweep instead of quantiles over the sweeps"
RENAMED = {
    "run": {"--memory": "--memory-limit"},
    "stop": {"--hard": "--kill"},
    "list": {"--order": "--sort"},
    "compare": {"--at": "--frequencies"},
    "plot": {"--band": "--frequency-range", "--wrapped": "--wrap-phase"},
    "fit": {"--using": "--estimator"},
    "import": import_options.RENAMED,
}
"""Earlier spellings of options by command, which are still understood, with their names of today."""


def _json(parser: Parser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def _terminal(parser: Parser) -> None:
    parser.add_argument(
        "--terminal",
        action="store_true",
        help="draw a figure into the terminal: an image if it shows them, else braille",
    )


def _filter(parser: Parser) -> None:
    parser.add_argument(
        "--filter", metavar="FILTER",
        help="only the sweeps that match a filter, as in fraexp list: 'estimator=effective_input tag:baseline'",
    )  # fmt: skip


def _list(parser: Parser) -> None:
    parser.add_argument(
        "filter", metavar="FILTER", nargs="*",
        help="list the sweeps that match all terms, such as estimator=effective_input 'excitation.amplitude>=12' "
        "state:unusable tag:baseline; quote names and texts that contain spaces: 'metric.\"peak force\">14N'",
    )  # fmt: skip
    parser.add_argument("--studies", action="store_true", help="list the studies, and what running them would compute")
    parser.add_argument("--sweeps", action="store_true", help="list all sweeps, as an empty filter does")
    parser.add_argument(
        "--sort", metavar="FIELD", default="",
        help="field to sort by, of sweeps or of runs; -FIELD sorts in descending order (default: newest first)",
    )  # fmt: skip
    parser.add_argument(
        "--limit", metavar="COUNT", type=int, default=100, help="maximum number of sweeps to list (default: 100)"
    )
    parser.add_argument(
        "--offset", metavar="COUNT", type=int, default=0, help="number of sweeps to skip at the start (default: 0)"
    )
    _json(parser)


def _stop(parser: Parser) -> None:
    parser.add_argument("run", metavar="RUN", type=int, help="a run number")
    parser.add_argument("--kill", action="store_true", help="kill its processes at once; stored results are kept")


def _tag(parser: Parser) -> None:
    parser.add_argument("tag", metavar="TAG", help="the tag: one word")
    parser.add_argument("ids", metavar="ID", nargs="+", help=ID_HELP)
    parser.add_argument("--remove", action="store_true", help="remove the tag")


def _note(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help="the beginning of a sweep key")
    parser.add_argument("text", metavar="TEXT", help="the note; an empty text removes it")


def _delete(parser: Parser) -> None:
    parser.add_argument(
        "ids", metavar="ID", nargs="+",
        help="a run number (its sweeps are deleted unless another run has them), or the beginning of a sweep key",
    )  # fmt: skip
    parser.add_argument("--yes", action="store_true", help="do not ask for confirmation")


def _merge(parser: Parser) -> None:
    parser.add_argument(
        "other", metavar="OTHER", help="database to read, a file or URL; its contents are added to the one of --db"
    )
    _json(parser)


def _serve(parser: Parser) -> None:
    parser.add_argument("--port", metavar="PORT", type=int, default=8000, help="port (default: 8000)")
    parser.add_argument(
        "--host", metavar="ADDRESS", default="127.0.0.1", help="address to listen on (default: this machine only)"
    )
    parser.add_argument(
        "--remote", action="store_true", help="allow an address that other machines can reach; requires --token"
    )
    parser.add_argument(
        "--token", metavar="TEXT", default="", help="token that the browser must present (default: a random one)"
    )


def _rerun_class(text: str) -> str:
    """Return which stored sweeps are computed again; ``failed`` is the earlier name of those without a result."""
    if text == "failed":
        say("--rerun failed is now --rerun unusable")
        return "unusable"
    return text


def _migrate(parser: Parser) -> None:
    parser.add_argument(
        "--studies", metavar="FILE", type=Path, nargs="*",
        help="instead of the database, rewrite study files with the current names (default: all of the workspace)",
    )  # fmt: skip
    _json(parser)


def _run(parser: Parser) -> None:
    parser.add_argument("study", metavar="STUDY", nargs="+", help="study file (TOML), study name, or folder of studies")
    parser.add_argument(
        "--executor", metavar="NAME",
        help="serial, processes[:N] or dask:ADDRESS (default: all cores, or one process where that is faster)",
    )  # fmt: skip
    parser.add_argument(
        "--set", metavar="PATH=VALUE", dest="overrides", action="append", default=[],
        help="override a value of the study, such as loop.divergence_limit=10mm",
    )  # fmt: skip
    parser.add_argument(
        "--dry-run", action="store_true", help="show what would be computed, why, and how long it would take"
    )
    parser.add_argument(
        "--time-limit", metavar="TIME", help="time limit of each sweep: 60, 90s, 5min or none (default: 1h)"
    )
    parser.add_argument(
        "--database-timeout", metavar="TIME",
        help="time for which the run waits for a database that is unavailable: 90s, 5min or none (default: 1h)",
    )  # fmt: skip
    parser.add_argument(
        "--memory-limit", metavar="SIZE", help="memory limit of each worker process, such as 2GB (default: none)"
    )
    parser.add_argument(
        "--rerun", choices=("stale", "unusable", "all"), type=_rerun_class,
        help="compute stored sweeps again: stale (a plugin has changed since), unusable (without a usable result), all",
    )  # fmt: skip
    parser.add_argument("--detach", action="store_true", help="run in the background with a log file; see fraexp stop")
    _json(parser)


def _measure(parser: Parser) -> None:
    parser.add_argument(
        "study", metavar="STUDY", help="study file (TOML) or study name, with [limits] and [measurement]"
    )
    parser.add_argument(
        "--set", metavar="PATH=VALUE", dest="overrides", action="append", default=[],
        help="override a value of the study, such as measurement.band=0.1",
    )  # fmt: skip
    parser.add_argument(
        "--dry-run", action="store_true", help="show the points, their durations and the predicted motion; play nothing"
    )
    parser.add_argument(
        "--autonomous", action="store_true",
        help="of the study take sample time, limits and machine alone, and find plant and friction in stages",
    )  # fmt: skip
    parser.add_argument(
        "--fresh", action="store_true", help="measure anew: discard what an earlier measurement of the study recorded"
    )
    _json(parser)


def _excite(parser: Parser) -> None:
    parser.add_argument("study", metavar="STUDY", help="study file (TOML) or study name, with [limits]")
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True,
        help="file to write: .csv, .mat, .h5, .wav, .h (C) or .st (Structured Text)",
    )  # fmt: skip
    parser.add_argument(
        "--set", metavar="PATH=VALUE", dest="overrides", action="append", default=[],
        help="override a value of the study, such as excitation.amplitude=20",
    )  # fmt: skip
    parser.add_argument(
        "--record", metavar="FILE", type=Path,
        help="name of the record that will come back (default: that of the output, with -record, as .csv)",
    )  # fmt: skip
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def _show(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help=ID_HELP)
    parser.add_argument("--points", action="store_true", help="show every frequency of the response")
    parser.add_argument(
        "--controller",
        metavar="STUDY",
        help="study or machine (machines/NAME) whose controller closes the loop around a measured response",
    )
    parser.add_argument("--all", action="store_true", help=ALL_HELP)
    _terminal(parser)
    _json(parser)


def _compare(parser: Parser) -> None:
    parser.add_argument("ids", metavar="ID", nargs="*", help=ID_HELP + "; the first is the reference")
    _filter(parser)
    parser.add_argument(
        "--against", metavar="WHAT", choices=("first", "plant"), default="first",
        help="reference: the first sweep, or the simulated plant P(jω) of each response (default: first)",
    )  # fmt: skip
    parser.add_argument(
        "--frequencies", metavar="HZ,...", type=_frequencies,
        help="frequencies [Hz] at which errors against the plant are shown, such as 5,39,80",
    )  # fmt: skip
    parser.add_argument("--all", action="store_true", help=ALL_HELP)
    _terminal(parser)
    _json(parser)


def _frequencies(text: str) -> tuple[float, ...]:
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if not found or not all(0 < frequency < float("inf") for frequency in found):
        raise argparse.ArgumentTypeError(f"'{text}' is invalid; expected frequencies [Hz] above 0, such as 5,39,80")
    return found


def _plot(parser: Parser) -> None:
    parser.add_argument("ids", metavar="ID", nargs="*", help=ID_HELP)
    _filter(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, default=None, help="figure to write: .png, .svg or .pdf"
    )
    _terminal(parser)
    parser.add_argument("--title", default="", help="title of the figure")
    parser.add_argument(
        "--kind", metavar="KIND", choices=FIGURES, default="",
        help=f"kind of figure: {', '.join(FIGURES)} (default: chosen from the results)",
    )  # fmt: skip
    parser.add_argument(
        "--frequency-range", metavar="LOW:HIGH", default="", help="frequency range [Hz] to show, such as 4.5:45"
    )
    parser.add_argument("--wrap-phase", action="store_true", help="wrap the phase of a Bode plot to ±180 degrees")
    parser.add_argument(
        "--group-by", metavar="LABEL", nargs="*", default=None,
        help="labels that separate the colours, such as estimator; curves that differ in others share one "
        "(default: all labels; without a label, one group)",
    )  # fmt: skip


def _fit(parser: Parser) -> None:
    parser.add_argument("ids", metavar="ID", nargs="+", help=ID_HELP)
    parser.add_argument(
        "--set", metavar="PARAMETER=VALUE", dest="overrides", action="append", default=[],
        help="set a parameter of the fit, such as modes=2 or max_frequency=150",
    )  # fmt: skip
    parser.add_argument(
        "--estimator", metavar="NAME", default="", help="estimator that fits the plant (default: the only one)"
    )
    _json(parser)


def _tune(parser: Parser) -> None:
    parser.add_argument("ids", metavar="ID", nargs="+", help=ID_HELP)
    parser.add_argument(
        "--set", metavar="PARAMETER=VALUE", dest="overrides", action="append", default=[],
        help="set a parameter of the tuning, such as integral_action=false or modulus_margin=0.6",
    )  # fmt: skip
    parser.add_argument(
        "--estimator", metavar="NAME", default="", help="estimator that tunes the feedback (default: the only one)"
    )
    _json(parser)


def _design(parser: Parser) -> None:
    parser.add_argument("ids", metavar="ID", nargs="+", help=ID_HELP)
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="study to write (.toml)")
    parser.add_argument(
        "--set", metavar="PARAMETER=VALUE", dest="overrides", action="append", default=[],
        help="set a parameter of the design, such as measuring_time=120 or amplitudes=[8,12]",
    )  # fmt: skip
    parser.add_argument(
        "--estimator", metavar="NAME", default="", help="estimator that designs the excitation (default: the only one)"
    )
    parser.add_argument("--force", action="store_true", help="overwrite another study")
    _json(parser)


def _report(parser: Parser) -> None:
    parser.add_argument(
        "ids", metavar="ID", nargs="+",
        help="a run number, a study name (its newest run), or a folder of studies (the newest run of each)",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True, help="report to write: .html or .pdf"
    )
    parser.add_argument("--title", default="", help="title of the report")
    parser.add_argument("--force", action="store_true", help="overwrite a file that is not a fraexp report")


def _export(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help=ID_HELP)
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True,
        help="file to write: .csv, .json, .mat, .h5 or .unv; .c, .h (C99) or .st (Structured Text) for a "
        "controller; .mjcf or .urdf for friction in a simulator",
    )  # fmt: skip
    parser.add_argument("--single", action="store_true", help="code in single precision instead of double")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def _new(parser: Parser) -> None:
    parser.add_argument("kind", metavar="KIND", choices=KINDS, help=f"kind of component: {', '.join(KINDS)}")
    parser.add_argument("name", metavar="NAME", help="name of the component in studies, such as my_law")
    parser.add_argument("--package", action="store_true", help="create an installable package with a test")


def _check(parser: Parser) -> None:
    parser.add_argument("name", metavar="NAME", help="name of a component, or the file of a plugin")
    parser.add_argument("--kind", metavar="KIND", choices=KINDS, help="kind of component, if several share the name")
    parser.add_argument("--quick", action="store_true", help="test few examples, and do not compile")
    _json(parser)


DECLARE = {
    "run": _run,
    "measure": _measure,
    "excite": _excite,
    "stop": _stop,
    "list": _list,
    "show": _show,
    "compare": _compare,
    "plot": _plot,
    "fit": _fit,
    "tune": _tune,
    "design": _design,
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
    "migrate": _migrate,
    "tui": lambda parser: None,  # those of every command
    "serve": _serve,
    "doctor": _json,
}
"""What declares the options of each command."""
