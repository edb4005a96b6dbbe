"""The options of ``fraexp import``."""

import argparse
from contextlib import suppress
from pathlib import Path

from fraexp.cli.parser import Parser


def declare(parser: Parser) -> None:
    """Declare them."""
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
    parser.add_argument("--json", action="store_true", help="print one JSON document")


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
    parser.add_argument("--input", metavar="NAME", help="channel in which excited lines are looked for")
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
