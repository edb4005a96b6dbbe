"""All commands with their modules, summaries and options; importing this is instant."""

import argparse
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from fraexp.data.figure_kinds import FIGURES


class Option(NamedTuple):
    """An argument of a command, as argparse takes it."""

    names: tuple[str, ...]
    settings: dict[str, Any]

    @property
    def key(self) -> str:
        """Attribute of the parsed command line that holds its value."""
        return str(self.settings.get("dest") or self.names[-1].lstrip("-").replace("-", "_"))


class Command(NamedTuple):
    """A command of the command line."""

    target: str
    """Module of `fraexp.cli`, and its function if that is not ``execute``: ``module:function``."""
    summary: str
    options: tuple[Option, ...]


def _command(target: str, summary: str, *options: Option) -> Command:
    return Command(target, summary, options)


def _option(spelling: str, meaning: str, **settings: Any) -> Option:
    """Return an argument that is spelled as in help, such as ``-o --output FILE``, or ``ids ID`` for a positional."""
    words = spelling.split()
    names = [word for word in words if word.startswith("-")] or words[:1]
    metavar = {"metavar": words[len(names)]} if len(words) > len(names) else {}
    return Option(tuple(names), {**metavar, "help": meaning, **settings})


def _switch(name: str, meaning: str) -> Option:
    return _option(name, meaning, action="store_true")


def _repeated(spelling: str, target: str, meaning: str, **settings: Any) -> Option:
    """Return an option that may be given several times; `target` is the attribute that holds the list."""
    return _option(spelling, meaning, dest=target, action="append", **{"default": [], **settings})


def _set(metavar: str, meaning: str) -> Option:
    return _repeated(f"--set {metavar}", "overrides", meaning)


def _estimator(purpose: str) -> Option:
    return _option("--estimator NAME", f"estimator that {purpose} (default: the only one)", default="")


def _output(meaning: str) -> Option:
    return _option("-o --output FILE", meaning, type=Path, required=True)


def _list_parser(parse: Callable[[str], list[Any]], expected: str) -> Callable[[str], list[Any]]:
    """Return the parser of an option whose value is a list of numbers above 0."""

    def parse_list(text: str) -> list[Any]:
        with suppress(ValueError):
            found = [number for part in text.split(",") for number in parse(part)]
            if found and all(0 < number < float("inf") for number in found):
                return found
        raise argparse.ArgumentTypeError(f"'{text}' is invalid; expected {expected}")

    return parse_list


def _harmonics(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def _placeholder_value(text: str) -> int | float | str:
    for number in (int, float):
        with suppress(ValueError):
            return number(text)
    return text


COMMON_OPTIONS = (
    _option(
        "--db URL", "database: a file, or postgresql://user@host/base (default: $FRAEXP_DB, or WORKSPACE/results.db)"
    ),
    _option("--workspace DIR", "folder with plugins/ and studies/ (default: here)", type=Path),
    _switch("--debug", "show the traceback if an error occurs"),
)
"""Options of every command."""

KINDS = ("friction", "plant", "controller", "excitation", "estimator", "reader", "machine")
"""Kinds of component."""
ID_HELP = "a run number, a study name (its newest run with results), or the beginning of a sweep key"
STUDY_HELP = "study file (TOML) or study name, with [limits]"
IDS = _option("ids ID", ID_HELP, nargs="+")
JSON = _switch("--json", "print one JSON document")
FORCE = _switch("--force", "overwrite an existing file")
FILTER = _option(
    "--filter FILTER",
    "only the sweeps that match a filter, as in fraexp list: 'estimator=effective_input tag:baseline'",
)

RECORD_OPTIONS = (
    _option(
        "--unit UNIT",
        "unit of a response that was measured elsewhere, such as mm/N: its channels are frequency, magnitude and "
        "phase, or real and imaginary",
        dest="response_unit",
    ),
    _option("--input-amplitude VALUE", "amplitude of its input, such as '12 N'"),
    _option("--averages COUNT", "number of averages behind its coherence", type=int),
    _option("--sample-rate HZ", "sample rate, if the file has no time column", type=float),
    _option("--time COLUMN", "time column, such as 'time [ms]'", dest="time_column"),
    _option("--samples-per-period COUNT", "samples per period of the excitation", type=int),
    _option("--period-time SECONDS", "period of the excitation", type=float),
    _option("--frequency COLUMN", "column with the excitation frequency of a stepped sine", dest="frequency_column"),
    _option(
        "--max-phase-slip PERIODS",
        "greatest phase slip of a block of whole periods, in periods (default: 0.001)",
        type=float,
    ),
    _option("--aperiodic", "the excitation is not periodic", action="store_const", const=False, dest="periodic"),
    _option("--skip-periods COUNT", "number of periods to skip at the start", type=int),
    _option("--skip-time SECONDS", "time to skip at the start", type=float),
    _option(
        "--resample METHOD",
        "interpolate between uneven time stamps, or channels of several sample rates: cubic or linear",
        choices=("cubic", "linear"),
    ),
    _option("--start-time SECONDS", "begin so long after the first sample", type=float),
    _option("--end-time SECONDS", "end so long after the first sample", type=float),
    _repeated(
        "--realisation NAME",
        "realisations",
        "value of {realisation} in column or file names; several realisations are averaged",
        default=None,
        type=_placeholder_value,
    ),
    _option(
        "--periods COUNT",
        "periods per realisation, if several realisations follow one another in the record",
        dest="periods_per_realisation",
        type=int,
    ),
    _option("--select COLUMN=NUMBER", "use only these samples, such as amplitude=12"),
    _option(
        "--segment COLUMN", "column with the number of the realisation; 0 between realisations", dest="segment_column"
    ),
    _option("--join-files", "take the FILEs as channels of one record", action="store_const", const=True),
    _option("--input NAME", "channel in which the excited lines are detected", dest="line_channel"),
    _option("--min-frequency HZ", "lowest excited frequency", type=float),
    _option("--max-frequency HZ", "highest excited frequency", type=float),
    _option(
        "--harmonics N,...",
        "excited harmonics, such as 1,3,7-15",
        type=_list_parser(_harmonics, "harmonics such as 1,3,7-15"),
    ),
)
"""Options of ``fraexp import`` that are keys of a study's section ``[record]``."""

CHANNEL = _repeated(
    "--channel NAME=COLUMN",
    "channels",
    "define a channel, such as u=force, 'y=position [mm]' or 'u=(volts - 2.5) * 31.5 [N]'; the first is "
    "the input, the second the output",
)
INTEGRATE = _repeated(
    "--integrate NAME[=TIMES]",
    "integrate",
    "integrate a channel over time, such as y=2 for acceleration to displacement; negative: differentiate",
)
RECORD_FILES = (
    "measured record or response: .csv, .txt, .mat, .h5, .npz, .uff, .xml, .tdms, .mf4, .mcap, .parquet; several files "
    "are records of one experiment"
)
RECORD_STUDY = _option("--study FILE", "study file to write (default: studies/FILE.toml)", type=Path)

COMMANDS = {
    "run": _command(
        "run",
        "compute the sweeps of studies that the database lacks",
        _option("study STUDY", "study file (TOML), study name, or folder of studies", nargs="+"),
        _option(
            "--executor NAME",
            "serial, processes[:N] or dask:ADDRESS (default: all cores, or one process where that is faster)",
        ),
        _set("PATH=VALUE", "override a value of the study, such as loop.divergence_limit=10mm"),
        _switch("--dry-run", "show what would be computed, why, and how long it would take"),
        _option("--time-limit TIME", "time limit of each sweep: 60, 90s, 5min or none (default: 1h)"),
        _option(
            "--database-timeout TIME",
            "time for which the run waits for a database that is unavailable: 90s, 5min or none (default: 1h)",
        ),
        _option("--memory-limit SIZE", "memory limit of each worker process, such as 2GB (default: none)"),
        _option(
            "--rerun",
            "compute stored sweeps again: stale (a plugin has changed since), unusable (without a usable result), all",
            choices=("stale", "unusable", "all"),
        ),
        _switch("--detach", "run in the background with a log file; see fraexp stop"),
        JSON,
    ),
    "stop": _command(
        "run:stop",
        "stop a run; finished sweeps are kept",
        _option("run RUN", "a run number", type=int),
        _switch("--kill", "kill its processes at once; stored results are kept"),
    ),
    "list": _command(
        "list",
        "list runs, studies, or the sweeps that match a filter",
        _option(
            "filter FILTER",
            "list the sweeps that match all terms, such as estimator=effective_input 'excitation.amplitude>=12' "
            "state:unusable tag:baseline; quote names and texts that contain spaces: 'metric.\"peak force\">14N'",
            nargs="*",
        ),
        _switch("--studies", "list the studies, and what running them would compute"),
        _switch("--sweeps", "list all sweeps, as an empty filter does"),
        _option(
            "--sort FIELD",
            "field to sort by, of sweeps or of runs; -FIELD sorts in descending order (default: newest first)",
            default="",
        ),
        _option("--limit COUNT", "maximum number of sweeps to list (default: 100)", type=int, default=100),
        JSON,
    ),
    "show": _command(
        "show",
        "show a run, or one sweep with its parameters and results",
        _option("id ID", ID_HELP),
        _switch("--points", "show every frequency of the response"),
        _option(
            "--controller STUDY",
            "study or machine (machines/NAME) whose controller closes the loop around a measured response",
        ),
        JSON,
    ),
    "compare": _command(
        "compare",
        "compare sweeps: parameters, metrics and frequency responses",
        _option("ids ID", f"{ID_HELP}; the first is the reference", nargs="*"),
        FILTER,
        _option(
            "--against WHAT",
            "reference: the first sweep, or the simulated plant P(jω) of each response (default: first)",
            choices=("first", "plant"),
            default="first",
        ),
        _option(
            "--frequencies HZ,...",
            "frequencies [Hz] at which errors against the plant are shown, such as 5,39,80",
            type=_list_parser(lambda part: [float(part)], "frequencies [Hz] above 0, such as 5,39,80"),
        ),
        JSON,
    ),
    "plot": _command(
        "plot",
        "plot a run or sweeps to a figure file",
        _option("ids ID", ID_HELP, nargs="*"),
        FILTER,
        _output("figure to write: .png, .svg or .pdf"),
        _option("--title", "title of the figure", default=""),
        _option(
            "--kind KIND",
            f"kind of figure: {', '.join(FIGURES)} (default: chosen from the results)",
            choices=FIGURES,
            default="",
        ),
        _option("--frequency-range LOW:HIGH", "frequency range [Hz] to show, such as 4.5:45", default=""),
        _switch("--wrap-phase", "wrap the phase of a Bode plot to ±180 degrees"),
        _option(
            "--group-by LABEL",
            "labels that separate the colours, such as estimator; curves that differ in others share one "
            "(default: all labels; without a label, one group)",
            nargs="*",
        ),
    ),
    "fit": _command(
        "fit",
        "fit a plant model to stored frequency responses",
        IDS,
        _set("PARAMETER=VALUE", "set a parameter of the fit, such as modes=2 or max_frequency=150"),
        _estimator("fits the plant"),
        JSON,
    ),
    "tune": _command(
        "fit",
        "tune the feedback for stored frequency responses, with margins for all plants of their band",
        IDS,
        _set("PARAMETER=VALUE", "set a parameter of the tuning, such as integral_action=false or modulus_margin=0.6"),
        _estimator("tunes the feedback"),
        JSON,
    ),
    "design": _command(
        "fit",
        "choose the sines that tell most in a given measuring time, and write their study",
        IDS,
        _output("study to write (.toml)"),
        _set("PARAMETER=VALUE", "set a parameter of the design, such as measuring_time=120 or amplitudes=[8,12]"),
        _estimator("designs the excitation"),
        _switch("--force", "overwrite another study"),
        JSON,
    ),
    "report": _command(
        "report",
        "write an HTML report of runs",
        _option(
            "ids ID",
            "a run number, a study name (its newest run with results), or a folder of studies (that of each)",
            nargs="+",
        ),
        _output("report to write (.html)"),
        _option("--title", "title of the report", default=""),
        _switch("--force", "overwrite a file that is not a fraexp report"),
    ),
    "export": _command(
        "export",
        "export the result of a sweep to CSV, JSON, MAT, HDF5 or UNV, or a controller to C or ST",
        _option("id ID", ID_HELP),
        _output("file to write: .csv, .json, .mat or .h5; .c, .h (C99) or .st (Structured Text) for a controller"),
        _switch("--single", "code in single precision instead of double"),
        FORCE,
    ),
    "import": _command(
        "records:import_record",
        "analyse a measured record, or list its contents",
        _option("files FILE", f"{RECORD_FILES}; without --channel, list their contents", type=Path, nargs="+"),
        CHANNEL,
        *RECORD_OPTIONS,
        _repeated(
            "--level NAME",
            "levels",
            "value of {level} in column names, file names or --select; several levels are compared",
            type=_placeholder_value,
        ),
        _switch("--separate-files", "treat each FILE as a separate experiment"),
        INTEGRATE,
        _repeated(
            "--estimator NAME",
            "estimators",
            "estimator (default: conventional); repeat it to compare several; see fraexp plugins",
        ),
        _set("PATH=VALUE", "set a parameter of the estimator, such as estimator.order=2"),
        RECORD_STUDY,
        JSON,
    ),
    "identify": _command(
        "records:identify",
        "find plant and friction in records of one machine, at one amplitude or several",
        _option("files FILE", RECORD_FILES, type=Path, nargs="+"),
        CHANNEL,
        *RECORD_OPTIONS,
        INTEGRATE,
        _set("PATH=VALUE", "set a parameter of the estimator, such as estimator.input_dead_time=1.2e-3"),
        RECORD_STUDY,
        _switch("--tune", "tune the feedback for the plant that was found"),
        JSON,
    ),
    "measure": _command(
        "measure",
        "play the excitation of a study on a machine, and analyse what it records",
        _option("study STUDY", f"{STUDY_HELP} and [measurement]"),
        _set("PATH=VALUE", "override a value of the study, such as measurement.band=0.1"),
        _switch("--dry-run", "show the points, their durations and the predicted motion; play nothing"),
        _switch(
            "--autonomous",
            "of the study take sample time, limits and machine alone, and find plant and friction in stages",
        ),
        _switch("--fresh", "measure anew: discard what an earlier measurement of the study recorded"),
        _switch("--trust-program", "let the study's machine run its program, or reach its controller, unasked"),
        JSON,
    ),
    "excite": _command(
        "measure:excite",
        "write the excitation of a study to a file that a machine can play",
        _option("study STUDY", STUDY_HELP),
        _output("file to write: .csv, .mat, .h5, .wav, .h (C) or .st (Structured Text)"),
        _set("PATH=VALUE", "override a value of the study, such as excitation.amplitude=20"),
        _option(
            "--record FILE",
            "name of the record that will come back (default: that of the output, with -record, as .csv)",
            type=Path,
        ),
        FORCE,
    ),
    "plugins": _command(
        "plugins",
        "list the available components, and plugins that failed to load",
        _option("name NAME", "component to describe in full (default: list all)", nargs="?"),
        JSON,
    ),
    "new": _command(
        "new",
        "create a plugin from a template: a file in plugins/, or a package",
        _option("kind KIND", f"kind of component: {', '.join(KINDS)}", choices=KINDS),
        _option("name NAME", "name of the component in studies, such as my_law"),
        _switch("--package", "create an installable package with a test"),
    ),
    "check": _command(
        "check",
        "run the conformance checks of a plugin's components",
        _option("name NAME", "name of a component, or the file of a plugin"),
        _option("--kind KIND", "kind of component, if several share the name", choices=KINDS),
        _switch("--quick", "test few examples, and do not compile"),
        JSON,
    ),
    "tag": _command(
        "tag",
        "add a tag to sweeps, or remove it",
        IDS,
        _option("tag TAG", "the tag: one word"),
        _switch("--remove", "remove the tag"),
    ),
    "delete": _command(
        "delete:delete",
        "move runs or sweeps to the trash, with their results, or empty it",
        _option(
            "ids ID",
            "a run number (its sweeps are deleted unless another run has them), or the beginning of a sweep key",
            nargs="*",
        ),
        _switch("--purge", "empty the trash: delete for good what is in it"),
        _switch("--yes", "do not ask for confirmation"),
    ),
    "undelete": _command(
        "delete:undelete",
        "bring runs or sweeps back from the trash",
        _option("ids ID", "a run number, or the beginning of a sweep key (default: what was deleted last)", nargs="*"),
    ),
    "merge": _command(
        "databases:merge",
        "merge another database into this one",
        _option("other OTHER", "database to read, a file or URL; its contents are added to the one of --db"),
        JSON,
    ),
    "restore": _command(
        "databases:restore",
        "put a copy of a database in the place of this one, which is kept",
        _option("copy COPY", "database file to copy; it is checked before"),
    ),
    "tui": _command("tui", "start the terminal UI: launch, watch and compare studies"),
    "serve": _command(
        "tui:serve",
        "serve the terminal UI to a web browser",
        _option("--port PORT", "port (default: 8000)", type=int, default=8000),
        _option(
            "--host ADDRESS",
            "address to listen on; one for other machines requires --token (default: this machine only)",
            default="127.0.0.1",
        ),
        _option("--token TEXT", "token that the browser must present (default: a random one)", default=""),
    ),
    "doctor": _command("doctor", "check the installation, the database, the plugins and the numerics", JSON),
}
