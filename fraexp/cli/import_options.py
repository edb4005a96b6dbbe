"""The options of ``fraexp import``."""

import argparse
from contextlib import suppress
from pathlib import Path

from fraexp.cli.parser import Parser

RENAMED = {
    "--period": "--samples-per-period",
    "--not-periodic": "--aperiodic",
    "--skip": "--skip-periods",
    "--where": "--select",
    "--each-file": "--separate-files",
    "--lines": "--harmonics",
    "--lowest": "--min-frequency",
    "--highest": "--max-frequency",
    "--every": "--harmonic-step",
}
"""Earlier spellings of options, which are still understood, with their names of today."""


def declare(parser: Parser) -> None:
    """Declare the options of `fraexp import`."""
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
    parser.add_argument(
        "--set", metavar="PATH=VALUE", dest="settings", action="append", default=[],
        help="set a parameter of the estimator, such as estimator.order=2",
    )  # fmt: skip
    parser.add_argument("--study", metavar="FILE", type=Path, help="study file to write (default: studies/FILE.toml)")
    parser.add_argument("--json", action="store_true", help="print one JSON document")


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
    parser.add_argument("--separate-files", action="store_true", help="treat each FILE as a separate experiment")


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
