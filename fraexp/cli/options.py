"""The options of each command."""

import argparse
from contextlib import suppress
from pathlib import Path

from fraexp.cli.parser import Parser
from fraexp.data.figure_kinds import FIGURES

KINDS = ("friction", "plant", "controller", "excitation", "estimator", "reader", "machine")
"""Kinds of component."""
ID_HELP = "a run number, a study name (its newest run), or the beginning of a sweep key"
ALL_HELP = "on a terminal, show every sweep instead of quantiles over the sweeps"


def _switch(parser: Parser, name: str, meaning: str) -> None:
    parser.add_argument(name, action="store_true", help=meaning)


def _set(parser: Parser, metavar: str, meaning: str, target: str = "overrides") -> None:
    parser.add_argument("--set", metavar=metavar, dest=target, action="append", default=[], help=meaning)


def _estimator(parser: Parser, purpose: str) -> None:
    meaning = f"estimator that {purpose} (default: the only one)"
    parser.add_argument("--estimator", metavar="NAME", default="", help=meaning)


def _output(parser: Parser, meaning: str) -> None:
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help=meaning)


def _ids(parser: Parser) -> None:
    parser.add_argument("ids", metavar="ID", nargs="+", help=ID_HELP)


def _json(parser: Parser) -> None:
    _switch(parser, "--json", "print one JSON document")


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
    _switch(parser, "--studies", "list the studies, and what running them would compute")
    _switch(parser, "--sweeps", "list all sweeps, as an empty filter does")
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
    _switch(parser, "--kill", "kill its processes at once; stored results are kept")


def _tag(parser: Parser) -> None:
    parser.add_argument("tag", metavar="TAG", help="the tag: one word")
    _ids(parser)
    _switch(parser, "--remove", "remove the tag")


def _note(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help="the beginning of a sweep key")
    parser.add_argument("text", metavar="TEXT", help="the note; an empty text removes it")


def _delete(parser: Parser) -> None:
    parser.add_argument(
        "ids", metavar="ID", nargs="*",
        help="a run number (its sweeps are deleted unless another run has them), or the beginning of a sweep key",
    )  # fmt: skip
    _switch(parser, "--purge", "empty the trash: delete for good what is in it")
    _switch(parser, "--yes", "do not ask for confirmation")


def _merge(parser: Parser) -> None:
    parser.add_argument(
        "other", metavar="OTHER", help="database to read, a file or URL; its contents are added to the one of --db"
    )
    _json(parser)


def _restore(parser: Parser) -> None:
    parser.add_argument("copy", metavar="COPY", help="database file to copy; it is checked before")


def _serve(parser: Parser) -> None:
    parser.add_argument("--port", metavar="PORT", type=int, default=8000, help="port (default: 8000)")
    parser.add_argument(
        "--host", metavar="ADDRESS", default="127.0.0.1", help="address to listen on (default: this machine only)"
    )
    _switch(parser, "--remote", "allow an address that other machines can reach; requires --token")
    parser.add_argument(
        "--token", metavar="TEXT", default="", help="token that the browser must present (default: a random one)"
    )


def _undelete(parser: Parser) -> None:
    parser.add_argument(
        "ids", metavar="ID", nargs="*",
        help="a run number, or the beginning of a sweep key (default: what was deleted last)",
    )  # fmt: skip


def _run(parser: Parser) -> None:
    parser.add_argument("study", metavar="STUDY", nargs="+", help="study file (TOML), study name, or folder of studies")
    parser.add_argument(
        "--executor", metavar="NAME",
        help="serial, processes[:N] or dask:ADDRESS (default: all cores, or one process where that is faster)",
    )  # fmt: skip
    _set(parser, "PATH=VALUE", "override a value of the study, such as loop.divergence_limit=10mm")
    _switch(parser, "--dry-run", "show what would be computed, why, and how long it would take")
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
        "--rerun", choices=("stale", "unusable", "all"),
        help="compute stored sweeps again: stale (a plugin has changed since), unusable (without a usable result), all",
    )  # fmt: skip
    _switch(parser, "--detach", "run in the background with a log file; see fraexp stop")
    _json(parser)


def _measure(parser: Parser) -> None:
    parser.add_argument(
        "study", metavar="STUDY", help="study file (TOML) or study name, with [limits] and [measurement]"
    )
    _set(parser, "PATH=VALUE", "override a value of the study, such as measurement.band=0.1")
    _switch(parser, "--dry-run", "show the points, their durations and the predicted motion; play nothing")
    _switch(
        parser,
        "--autonomous",
        "of the study take sample time, limits and machine alone, and find plant and friction in stages",
    )
    _switch(parser, "--fresh", "measure anew: discard what an earlier measurement of the study recorded")
    _switch(parser, "--trust-program", "let the study's machine run its program, or reach its controller, unasked")
    _json(parser)


def _excite(parser: Parser) -> None:
    parser.add_argument("study", metavar="STUDY", help="study file (TOML) or study name, with [limits]")
    _output(parser, "file to write: .csv, .mat, .h5, .wav, .h (C) or .st (Structured Text)")
    _set(parser, "PATH=VALUE", "override a value of the study, such as excitation.amplitude=20")
    parser.add_argument(
        "--record", metavar="FILE", type=Path,
        help="name of the record that will come back (default: that of the output, with -record, as .csv)",
    )  # fmt: skip
    _switch(parser, "--force", "overwrite an existing file")


def _show(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help=ID_HELP)
    _switch(parser, "--points", "show every frequency of the response")
    parser.add_argument(
        "--controller",
        metavar="STUDY",
        help="study or machine (machines/NAME) whose controller closes the loop around a measured response",
    )
    _switch(parser, "--all", ALL_HELP)
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
    _switch(parser, "--all", ALL_HELP)
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
    _switch(parser, "--terminal", "draw a figure into the terminal, in braille")
    parser.add_argument("--title", default="", help="title of the figure")
    parser.add_argument(
        "--kind", metavar="KIND", choices=FIGURES, default="",
        help=f"kind of figure: {', '.join(FIGURES)} (default: chosen from the results)",
    )  # fmt: skip
    parser.add_argument(
        "--frequency-range", metavar="LOW:HIGH", default="", help="frequency range [Hz] to show, such as 4.5:45"
    )
    _switch(parser, "--wrap-phase", "wrap the phase of a Bode plot to ±180 degrees")
    parser.add_argument(
        "--group-by", metavar="LABEL", nargs="*", default=None,
        help="labels that separate the colours, such as estimator; curves that differ in others share one "
        "(default: all labels; without a label, one group)",
    )  # fmt: skip


def _fit(parser: Parser) -> None:
    _ids(parser)
    _set(parser, "PARAMETER=VALUE", "set a parameter of the fit, such as modes=2 or max_frequency=150")
    _estimator(parser, "fits the plant")
    _json(parser)


def _tune(parser: Parser) -> None:
    _ids(parser)
    _set(
        parser, "PARAMETER=VALUE", "set a parameter of the tuning, such as integral_action=false or modulus_margin=0.6"
    )
    _estimator(parser, "tunes the feedback")
    _json(parser)


def _design(parser: Parser) -> None:
    _ids(parser)
    _output(parser, "study to write (.toml)")
    _set(parser, "PARAMETER=VALUE", "set a parameter of the design, such as measuring_time=120 or amplitudes=[8,12]")
    _estimator(parser, "designs the excitation")
    _switch(parser, "--force", "overwrite another study")
    _json(parser)


def _report(parser: Parser) -> None:
    parser.add_argument(
        "ids", metavar="ID", nargs="+",
        help="a run number, a study name (its newest run), or a folder of studies (the newest run of each)",
    )  # fmt: skip
    _output(parser, "report to write (.html)")
    parser.add_argument("--title", default="", help="title of the report")
    _switch(parser, "--force", "overwrite a file that is not a fraexp report")


def _export(parser: Parser) -> None:
    parser.add_argument("id", metavar="ID", help=ID_HELP)
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True,
        help="file to write: .csv, .json, .mat, .h5 or .unv; .c, .h (C99) or .st (Structured Text) for a "
        "controller",
    )  # fmt: skip
    _switch(parser, "--single", "code in single precision instead of double")
    _switch(parser, "--force", "overwrite an existing file")


def _new(parser: Parser) -> None:
    parser.add_argument("kind", metavar="KIND", choices=KINDS, help=f"kind of component: {', '.join(KINDS)}")
    parser.add_argument("name", metavar="NAME", help="name of the component in studies, such as my_law")
    _switch(parser, "--package", "create an installable package with a test")


def _check(parser: Parser) -> None:
    parser.add_argument("name", metavar="NAME", help="name of a component, or the file of a plugin")
    parser.add_argument("--kind", metavar="KIND", choices=KINDS, help="kind of component, if several share the name")
    _switch(parser, "--quick", "test few examples, and do not compile")
    _json(parser)


def _import(parser: Parser) -> None:
    parser.add_argument(
        "files", metavar="FILE", type=Path, nargs="+",
        help="measured record or response: .csv, .txt, .mat, .h5, .npz, .uff, .xml, .tdms, .mf4, .mcap, .parquet; "
        "several files are realisations of one experiment",
    )  # fmt: skip
    parser.add_argument(
        "--channel", metavar="NAME=COLUMN", dest="channels", action="append", default=[],
        help="define a channel, such as u=force, 'y=position [mm]' or 'u=(volts - 2.5) * 31.5 [N]'; the first is the "
        "input, the second the output; without --channel, list the contents of the file",
    )  # fmt: skip
    parser.add_argument(
        "--unit", metavar="UNIT", dest="response_unit",
        help="unit of a response that was measured elsewhere, such as mm/N: its channels are frequency, magnitude and "
        "phase, or real and imaginary",
    )  # fmt: skip
    parser.add_argument(
        "--input-amplitude", metavar="VALUE", dest="input_amplitude", help="amplitude of its input, such as '12 N'"
    )
    parser.add_argument("--averages", metavar="COUNT", type=int, help="number of averages behind its coherence")
    _declare_timebase(parser)
    _declare_segments(parser)
    _declare_lines(parser)
    parser.add_argument(
        "--integrate", metavar="NAME[=TIMES]", action="append", default=[],
        help="integrate a channel over time, such as y=2 for acceleration to displacement; negative: differentiate",
    )  # fmt: skip
    parser.add_argument(
        "--estimator", metavar="NAME", dest="estimators", action="append", default=[],
        help="estimator (default: conventional); repeat it to compare several; see fraexp plugins",
    )  # fmt: skip
    _set(parser, "PATH=VALUE", "set a parameter of the estimator, such as estimator.order=2", "settings")
    parser.add_argument("--study", metavar="FILE", type=Path, help="study file to write (default: studies/FILE.toml)")
    _switch(parser, "--json", "print one JSON document")


def _declare_timebase(parser: Parser) -> None:
    parser.add_argument("--sample-rate", metavar="HZ", type=float, help="sample rate, if the file has no time column")
    parser.add_argument("--time", metavar="COLUMN", dest="time_column", help="time column, such as 'time [ms]'")
    parser.add_argument(
        "--samples-per-period",
        metavar="COUNT",
        dest="samples_per_period",
        type=int,
        help="samples per period of the excitation",
    )
    parser.add_argument("--period-time", metavar="SECONDS", type=float, help="period of the excitation")
    parser.add_argument(
        "--frequency",
        metavar="COLUMN",
        dest="frequency_column",
        help="column with the excitation frequency of a stepped sine",
    )
    parser.add_argument(
        "--max-phase-slip", metavar="PERIODS", type=float,
        help="greatest phase slip of a block of whole periods, in periods (default: 0.001)",
    )  # fmt: skip
    parser.add_argument(
        "--aperiodic", action="store_const", const=False, dest="periodic", help="the excitation is not periodic"
    )
    parser.add_argument(
        "--skip-periods", metavar="COUNT", dest="skip_periods", type=int, help="number of periods to skip at the start"
    )
    parser.add_argument("--skip-time", metavar="SECONDS", type=float, help="time to skip at the start")
    parser.add_argument(
        "--resample", metavar="METHOD", choices=("cubic", "linear"),
        help="interpolate between uneven time stamps, or channels of several sample rates: cubic or linear",
    )  # fmt: skip
    parser.add_argument("--start-time", metavar="SECONDS", type=float, help="begin so long after the first sample")
    parser.add_argument("--end-time", metavar="SECONDS", type=float, help="end so long after the first sample")


def _declare_segments(parser: Parser) -> None:
    parser.add_argument(
        "--level", metavar="NAME", dest="levels", action="append", type=_placeholder_value, default=[],
        help="value of {level} in column names, file names or --select; several levels are compared",
    )  # fmt: skip
    parser.add_argument(
        "--realisation", metavar="NAME", dest="realisations", action="append", type=_placeholder_value,
        help="value of {realisation} in column or file names; several realisations are averaged",
    )  # fmt: skip
    parser.add_argument(
        "--periods", metavar="COUNT", dest="periods_per_realisation", type=int,
        help="periods per realisation, if several realisations follow one another in the record",
    )  # fmt: skip
    parser.add_argument(
        "--select", metavar="COLUMN=NUMBER", dest="select", help="use only these samples, such as amplitude=12"
    )
    parser.add_argument(
        "--segment",
        metavar="COLUMN",
        dest="segment_column",
        help="column with the number of the realisation; 0 between realisations",
    )
    parser.add_argument(
        "--join-files", action="store_const", const=True, help="take the FILEs as channels of one record"
    )
    _switch(parser, "--separate-files", "treat each FILE as a separate experiment")


def _declare_lines(parser: Parser) -> None:
    parser.add_argument(
        "--input", metavar="NAME", dest="line_channel", help="channel in which the excited lines are detected"
    )
    parser.add_argument("--min-frequency", metavar="HZ", type=float, help="lowest excited frequency")
    parser.add_argument("--max-frequency", metavar="HZ", type=float, help="highest excited frequency")
    parser.add_argument(
        "--harmonic-step", metavar="COUNT", type=int,
        help="step between excited harmonics, from --min-frequency to --max-frequency",
    )  # fmt: skip
    parser.add_argument(
        "--harmonics", metavar="N,...", dest="harmonics", type=_harmonics, help="excited harmonics, such as 1,3,7-15"
    )


def _placeholder_value(text: str) -> int | float | str:
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
        raise argparse.ArgumentTypeError(f"'{text}' is invalid; expected harmonics such as 1,3,7-15")
    return found


def _plugins(parser: Parser) -> None:
    parser.add_argument("name", metavar="NAME", nargs="?", help="component to describe in full (default: list all)")
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
    "import": _import,
    "plugins": _plugins,
    "new": _new,
    "check": _check,
    "tag": _tag,
    "note": _note,
    "delete": _delete,
    "undelete": _undelete,
    "merge": _merge,
    "restore": _restore,
    "tui": lambda parser: None,  # those of every command
    "serve": _serve,
    "doctor": _json,
}
"""What declares the options of each command."""
