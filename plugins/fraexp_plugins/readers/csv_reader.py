"""Delimited text: comma, semicolon (decimal comma as well), tab or blanks, with a header line."""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import date, datetime, time
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared.heading_rows import CLOCK_FACTORS, find_headings, is_time, stated_sample_time
from fraexp_plugins.readers._shared.record_arrays import check_size
from fraexp_plugins.readers._shared.text_lines import (
    MAX_HEADER_LINES,
    check_thousands,
    column_position,
    head_lines,
    is_comment,
    is_number,
    split_cells,
    text_encoding,
    text_lines,
    unique_names,
)

DATE_PATTERN = re.compile(
    r"(?:(?:(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d)|(?P<day_first>\d\d)\.(?P<month_next>\d\d)\.(?P<year_last>\d{4})"
    r"|(?P<month_first>\d\d?)/(?P<day_next>\d\d?)/(?P<year_end>\d{4}))"
    r"(?:T|\s+))?(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d)(?P<fraction>[.,;]\d+)?(?P<zone>Z|[+-]\d\d:?\d\d)?"
    r"(?:\s*(?P<half>[AP])M)?"
)
"""ISO 8601 with a time of day, such as ``2026-03-05T14:02:59.500``, ``05.03.2026 14:02:59,500``, or
``3/5/2026 2:02:59.500 PM``; a time of day alone is one of some day."""

NAMES = (("year", "year_last", "year_end"), ("month", "month_next", "month_first"), ("day", "day_first", "day_next"))
"""Groups of the pattern, in the order of ISO 8601."""


def first_day(cells: Sequence[str]) -> date | None:
    """Return the day of the first cell if all cells are dates with a time of day; otherwise None."""
    try:
        moments = [_moment(cell)[0] for cell in cells]
    except ValueError:
        return None
    return moments[0].date() if moments else None


def seconds_since(cell: str, day: date) -> float:
    """Return the seconds [s] of a cell since the beginning of a day; ValueError if it is no date.

    They are counted from that day, because a number since 1970 has no digits left for microseconds.
    """
    moment, fraction = _moment(cell)
    start = datetime.combine(day, time(), moment.tzinfo)
    return (moment - start).total_seconds() + fraction


def _moment(cell: str) -> tuple[datetime, float]:
    """Return whole seconds and their fraction [s]; ValueError if a cell is no date."""
    found = DATE_PATTERN.fullmatch(cell.strip())
    if found is None:
        raise ValueError(f"'{cell}' is no date with a time of day")
    year, month, day = (next((int(found[name]) for name in names if found[name]), 1) for names in NAMES)
    hour = int(found["hour"])
    if found["half"]:
        hour = hour % 12 + 12 * (found["half"] == "P")
    fraction = "." + (found["fraction"] or ".0")[1:]
    text = f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{found['minute']}:{found['second']}{found['zone'] or ''}"
    return datetime.fromisoformat(text), float(f"0{fraction}")


_NUMBER = r"(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?"


class ComplexNotation(NamedTuple):
    """A way to write complex numbers."""

    pattern: re.Pattern[str]
    """Matches a cell; its groups are the two numbers."""
    parts: tuple[str, str]
    """What the names of the two columns end with."""
    units: tuple[str | None, str | None]


NOTATIONS = (
    ComplexNotation(
        re.compile(rf"\(?\s*([+-]?{_NUMBER})\s*(?=[+-])\+?(-?\s*{_NUMBER})\s*\*?\s*[ij]\s*\)?"),
        ("real", "imaginary"),
        (None, None),
    ),
    ComplexNotation(
        re.compile(rf"\(([+-]?{_NUMBER})dB,([+-]?{_NUMBER})\s*(?:°|deg)?\)"), ("magnitude", "phase"), ("dB", "deg")
    ),
)
"""``(1-2j)`` of Python, ``1 - 2i`` of MATLAB; ``(-12dB,45°)`` of circuit simulators."""


def complex_notation(cells: Sequence[str]) -> ComplexNotation | None:
    """Return the notation of a column of complex numbers; None if a cell is none, or all are empty."""
    filled = [cell for cell in cells if cell]
    return next((one for one in NOTATIONS if filled and all(map(one.pattern.fullmatch, filled))), None)


def split_complex(cell: str, notation: ComplexNotation) -> list[str]:
    """Return the two numbers in a cell; the cell and an empty one if it is no complex number."""
    found = notation.pattern.fullmatch(cell)
    return [part.replace(" ", "") for part in found.groups()] if found else [cell, ""]


DELIMITERS = ("\t", ";", "|", ",", None)
"""Delimiters in the order in which they are tried; None is any run of blanks."""
SAMPLED_ROWS = 200
"""Last lines of the head that decide which columns contain numbers."""
FIRST_ROWS = 3
"""Successive lines that fit the columns where the table begins: a line of metadata may fit them by chance."""

_Found = TypeVar("_Found")


@dataclass(frozen=True)
class TextLayout:
    """Layout of a text file."""

    encoding: str
    delimiter: str | None
    decimal_comma: bool
    start: int
    """Lines before the first line of numbers."""
    headings: tuple[str, ...]
    """Headings as in the file; numbers from 1 if it has none."""
    plain_names: tuple[str, ...]
    """Names of the columns without their units."""
    units: tuple[str | None, ...]
    text_columns: frozenset[int]
    """Positions of the columns that contain text."""
    sample_time: float | None
    """Sample time [s] if a line above the table states it."""
    days: Mapping[int, date] = field(default_factory=dict)
    """First day of each column of dates, by its position in the file: they are read as seconds since then."""
    complex_columns: Mapping[int, ComplexNotation] = field(default_factory=dict)
    """Notation of each column of complex numbers, by its position in the file: each is read as two columns."""

    @property
    def names(self) -> list[str]:
        """Names of the columns, without their units; equal ones are numbered."""
        return unique_names(self.plain_names)

    @property
    def is_rewritten(self) -> bool:
        """Whether lines must be rewritten before their numbers are read."""
        return bool(self.days or self.complex_columns)

    def position(self, path: Path, column: str) -> int:
        """Return the position of a column by its heading, or by the name in the heading."""
        return column_position(path, column, self.headings, self.plain_names, self.names)

    def time_position(self, position: int) -> int | None:
        """Return the position of the time of a column: the nearest one before it; None if the file has only one."""
        times = [at for at, found in enumerate(zip(self.plain_names, self.units, strict=True)) if is_time(*found)]
        before = [at for at in times if at < position]
        return before[-1] if len(times) > 1 and before and position not in times else None

    def time_factor(self, path: Path, position: int | None) -> float:
        """Return the factor to seconds of a column of time; RecordError if its unit is unknown."""
        unit = ((self.units[position] if position is not None else None) or "s").strip()
        if unit not in CLOCK_FACTORS:
            known = ", ".join(CLOCK_FACTORS)
            raise RecordError(
                f"{path.name}: a column of time is in '{unit}'; expected one of {known}: give time_column"
            )
        return CLOCK_FACTORS[unit]

    def number(self, cell: str) -> float:
        """Return the number in a cell; ValueError if it is not a number."""
        return float(cell.replace(",", ".") if self.decimal_comma else cell)

    def rewrite(self, line: str) -> str:
        """Return a line in which dates are numbers of seconds and complex numbers two cells; what is neither stays."""
        cells = [
            part for at, cell in enumerate(split_cells(line, self.delimiter)) for part in self._plain_cells(at, cell)
        ]
        return (self.delimiter or " ").join(f'"{cell}"' if (self.delimiter or " ") in cell else cell for cell in cells)

    def _plain_cells(self, position: int, cell: str) -> list[str]:
        if position in self.complex_columns:
            return split_complex(cell, self.complex_columns[position])
        if position in self.days:
            with suppress(ValueError):
                return [repr(seconds_since(cell, self.days[position]))]
        return [cell]


def detect_layout(path: Path) -> TextLayout:
    """Return the layout of a file; RecordError if it contains no columns of numbers."""
    check_size(path, "the file", path.stat().st_size)
    encoding = text_encoding(path)
    with path.open(encoding=encoding, errors="replace") as stream:
        lines = list(head_lines(path, stream))
    found = _pure_table(lines) or _mixed_table(lines) or _single_column(lines)
    if found is None:
        raise RecordError(
            f"{path.name}: no line of numbers in the first {MAX_HEADER_LINES}; expected columns of numbers"
        )
    start, delimiter, text_columns = found
    cells = _first_row(lines[start : start + 2], delimiter)
    decimal_comma = delimiter != "," and any("," in cell for cell in _numeric_cells(lines[start:], delimiter))
    header = lines[:start]
    headings, names, units = find_headings(path, header, delimiter, cells, decimal_comma)
    rows = [
        split_cells(line, delimiter) for line in lines[start:][:SAMPLED_ROWS] if line.strip() and not is_comment(line)
    ]
    days = _find_in_columns(rows, text_columns, first_day)
    pairs = _find_in_columns(rows, text_columns - days.keys(), complex_notation)
    units = ["s" if position in days else unit for position, unit in enumerate(units)]
    text_columns -= days.keys() | pairs.keys()
    wide = [row for row in (split_cells(line, delimiter) for line in header) if len(row) == len(cells)]
    has_time = any(is_time(names[at], units[at]) for at in set(range(len(names))) - text_columns)
    spread = [part for at in range(len(names)) for part in _spread(at, headings[at], names[at], units[at], pairs)]
    return TextLayout(
        encoding=encoding,
        delimiter=delimiter,
        decimal_comma=decimal_comma,
        start=start,
        headings=tuple(heading for _, heading, _, _ in spread),
        plain_names=tuple(name for _, _, name, _ in spread),
        units=tuple(unit for *_, unit in spread),
        text_columns=frozenset(at for at, (place, *_) in enumerate(spread) if place in text_columns),
        sample_time=None if has_time else stated_sample_time(header, wide, decimal_comma),
        days=days,
        complex_columns=pairs,
    )


def _find_in_columns(
    rows: Sequence[Sequence[str]], positions: Iterable[int], find: Callable[[Sequence[str]], _Found | None]
) -> dict[int, _Found]:
    """Return what `find` returns for the cells of columns, by their positions, where it is not None."""
    found = {at: find([row[at] for row in rows if at < len(row)]) for at in positions}
    return {at: one for at, one in found.items() if one is not None}


def _spread(
    place: int, heading: str, name: str, unit: str | None, pairs: Mapping[int, ComplexNotation]
) -> list[tuple[int, str, str, str | None]]:
    """Return position, heading, name and unit of a column, or of the two that a complex one becomes."""
    if place not in pairs:
        return [(place, heading, name, unit)]
    notation = pairs[place]
    names = [f"{name}.{part}" for part in notation.parts]
    return [(place, one, one, own or unit) for one, own in zip(names, notation.units, strict=True)]


def _numeric(cells: Sequence[str], delimiter: str | None) -> bool:
    # A first line of numbers with an empty cell is not a heading.
    filled = [cell for cell in cells if cell]
    return bool(filled) and all(is_number(cell, delimiter != ",") for cell in filled)


def _pure_table(lines: Sequence[str]) -> tuple[int, str | None, set[int]] | None:
    """Return first line and delimiter of a table in which a line contains numbers alone."""
    for delimiter in DELIMITERS:
        for start, line in enumerate(lines):
            cells = split_cells(line, delimiter) if delimiter is None or delimiter in line else ()
            if len(cells) > 1 and not is_comment(line) and _numeric(cells, delimiter):
                first = _first_row_above(lines, start, delimiter, len(cells))
                sampled = [*lines[first:][:SAMPLED_ROWS], *lines[start:][-SAMPLED_ROWS:]]
                return first, delimiter, _text_columns(sampled, delimiter, len(cells))
    return None


def _first_row(lines: Sequence[str], delimiter: str | None) -> list[str]:
    """Return the cells of the first line without a remark at its end, for which the second one has no cell."""
    first, *others = (split_cells(line, delimiter) for line in lines)
    has_remark = _numeric(first[:-1], delimiter) and not is_number(first[-1], decimal_comma=True)
    return first[:-1] if has_remark and others and len(others[0]) == len(first) - 1 else first


def _first_row_above(lines: Sequence[str], start: int, delimiter: str | None, width: int) -> int:
    """Return the first of the lines directly above that have numbers where the first line of numbers has some.

    Another column contains text there: the first row of a LabVIEW file may end with a remark, in a column that the
    others do not have, and oscilloscopes write their settings beside the first samples.
    """
    first = start
    own = split_cells(lines[start], delimiter)
    filled = [0] if own[0] else [at for at, cell in enumerate(own) if cell]
    for number in range(start - 1, -1, -1):
        cells = split_cells(lines[number], delimiter)
        has_remark = len(cells) == width + 1 and _numeric(cells[:-1], delimiter)
        if is_comment(lines[number]) or not (len(cells) == width or has_remark):
            break
        if not all(is_number(cells[at], delimiter != ",") for at in filled):
            break
        first = number
    return first


def _mixed_table(lines: Sequence[str]) -> tuple[int, str | None, set[int]] | None:
    """Return first line, delimiter and columns of text of a table in which each line contains text."""
    rows = [(number, line) for number, line in enumerate(lines) if line.strip() and not is_comment(line)]
    for delimiter in DELIMITERS:
        tail = [split_cells(line, delimiter) for _, line in rows[-SAMPLED_ROWS:]]
        width = Counter(map(len, tail)).most_common(1)[0][0] if tail else 0
        text = _text_columns([line for _, line in rows[-SAMPLED_ROWS:]], delimiter, width)
        if width < 2 or len(text) == width:
            continue
        fits = [_fits(split_cells(line, delimiter), width, text, delimiter) for _, line in rows]
        for place, (number, _) in enumerate(rows):
            if all(fits[place : place + FIRST_ROWS]):
                return number, delimiter, text
    return None


def _fits(cells: Sequence[str], width: int, text: set[int], delimiter: str | None) -> bool:
    numbers = [cell for position, cell in enumerate(cells) if position not in text and cell]
    return len(cells) == width and bool(numbers) and all(is_number(cell, delimiter != ",") for cell in numbers)


def _single_column(lines: Sequence[str]) -> tuple[int, str | None, set[int]] | None:
    numbers = (n for n, line in enumerate(lines) if not is_comment(line) and _numeric([line.strip()], ";"))
    start = next(numbers, None)
    return None if start is None else (start, ";", set())


def _text_columns(lines: Sequence[str], delimiter: str | None, width: int) -> set[int]:
    """Return the positions of columns of which most cells are text, or some where most cells are empty."""
    rows = [split_cells(line, delimiter) for line in lines if line.strip() and not is_comment(line)]
    columns = zip(*(row for row in rows if len(row) == width), strict=True)
    return {position for position, column in enumerate(columns) if _is_text(column, delimiter != ",")}


def _is_text(column: Sequence[str], decimal_comma: bool) -> bool:
    filled = [cell for cell in column if cell]
    texts = sum(not is_number(cell, decimal_comma) for cell in filled)
    return texts > len(filled) - texts or (texts > 0 and len(filled) < len(column) / 2)


def _numeric_cells(lines: Sequence[str], delimiter: str | None) -> Iterator[str]:
    for line in lines[:SAMPLED_ROWS]:
        for cell in split_cells(line, delimiter):
            if is_number(cell, decimal_comma=True) or NOTATIONS[0].pattern.fullmatch(cell):
                yield cell


class CsvReader(RecordReader, name="csv", version=1):
    """Delimited text with names in its last line before the numbers, such as ``Position [mm]``.

    A column is asked for by its name with or without the unit; in a file without a header by its number from 1.
    Equal names are numbered: ``Time #1``, ``Time #2``. Lines that begin with # or % are comments; such a line may be
    the header if there is no other. Lines of metadata above the header are skipped; a sample rate there is used if no
    column is the time. A column of dates with times of day (ISO 8601, or 31.12.2026 23:59:59,5) is read as seconds
    since the beginning of its first day. A column may end before the others; columns of text are not read.
    """

    suffixes = (".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm", ".prn", ".ascii", ".log")

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        layout = detect_layout(path)
        positions = [layout.position(path, column) for column in columns]
        if layout.decimal_comma:
            check_thousands(path, _rows(path, layout), layout.delimiter, positions, layout.headings)
        owners = [layout.time_position(position) for position in positions]
        values = _numbers(path, layout, positions)
        own_times = {}
        if None not in owners and len(set(owners)) > 1:
            stamps = dict(zip(owners, _numbers(path, layout, [at for at in owners if at is not None]), strict=True))
            own_times = {c: stamps[at] * layout.time_factor(path, at) for c, at in zip(columns, owners, strict=True)}
        units = dict(zip(layout.names, layout.units, strict=False))  # of all columns: another one may be the clock
        units |= {column: layout.units[position] for column, position in zip(columns, positions, strict=True)}
        return RecordTable(
            columns=dict(zip(columns, values, strict=True)),
            sample_time=layout.sample_time,
            units={column: unit or "" for column, unit in units.items()},
            times=own_times,
        )

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of every column of numbers by its name."""
        layout = detect_layout(path)
        lengths = _lengths(path, layout)
        found = zip(layout.names, lengths, layout.units, strict=False)
        return {
            name: ((length,), unit or "")
            for position, (name, length, unit) in enumerate(found)
            if name and length and position not in layout.text_columns
        }

    def unreadable(self, path: Path) -> Mapping[str, str]:
        """Return what the columns contain that are not numbers, by name."""
        layout = detect_layout(path)
        return {layout.names[position]: "text" for position in sorted(layout.text_columns)}


def _rows(path: Path, layout: TextLayout) -> Iterator[tuple[int, str]]:
    """Yield numbers and text of the lines of a table, without lines of text behind the last line with a number."""
    held: list[tuple[int, str]] = []
    with path.open(encoding=layout.encoding, errors="replace") as stream:
        for number, line in enumerate(text_lines(path, stream), start=1):
            if number > layout.start and line.strip() and not is_comment(line):
                row = (number, layout.rewrite(line) if layout.is_rewritten else line)
                if line.lstrip(' "')[0].isalpha() and _has_no_number(line, layout):
                    held.append(row)
                    continue
                yield from held
                held.clear()
                yield row


def _has_no_number(line: str, layout: TextLayout) -> bool:
    return not any(is_number(cell, layout.decimal_comma) for cell in split_cells(line, layout.delimiter))


def _lengths(path: Path, layout: TextLayout) -> list[int]:
    """Return the number of samples of each column: of all lines, unless the last one leaves some cells empty."""
    rows, last = 0, ""
    for _, line in _rows(path, layout):
        rows, last = rows + 1, line
    cells = split_cells(last, layout.delimiter)
    width = len(layout.headings)
    if len(cells) >= width and all(cells[:width]):
        return [rows] * width
    lengths = [0] * width
    for row, (_, line) in enumerate(_rows(path, layout), start=1):
        for position, cell in enumerate(split_cells(line, layout.delimiter)[:width]):
            lengths[position] = row if cell else lengths[position]
    return lengths


def _numbers(path: Path, layout: TextLayout, positions: list[int]) -> Sequence[NDArray[np.float64]]:
    """Return the values of columns, each of shape (n,); RecordError at the first cell that is not a number."""
    lines = (line.replace(",", ".") if layout.decimal_comma else line for _, line in _rows(path, layout))
    try:
        values = np.loadtxt(
            lines, delimiter=layout.delimiter, usecols=positions, comments=None, quotechar='"', ndmin=2, unpack=True
        )
    except (ValueError, StopIteration):  # the latter where a quote is never closed
        return _padded_numbers(path, layout, positions)
    if not np.isfinite(values).all():
        raise _fault(path, layout, positions)
    return list(np.asarray(values))


def _padded_numbers(path: Path, layout: TextLayout, positions: list[int]) -> list[NDArray[np.float64]]:
    """Return the values of columns that may end before others; RecordError if a cell within one is not a number."""
    rows = [split_cells(line, layout.delimiter) for _, line in _rows(path, layout)]
    if _is_cut_off(rows, len(layout.headings)):
        raise _fault(path, layout, positions)
    columns = []
    for position in positions:
        cells = [row[position] if position < len(row) else "" for row in rows]
        while cells and not cells[-1]:
            cells.pop()
        try:
            columns.append(np.array([layout.number(cell) for cell in cells], dtype=float))
        except ValueError:
            raise _fault(path, layout, positions) from None
    if not all(values.size and np.isfinite(values).all() for values in columns):
        raise _fault(path, layout, positions)
    return columns


def _is_cut_off(rows: Sequence[Sequence[str]], width: int) -> bool:
    """Say whether only the last line lacks cells: the file was cut there."""
    return bool(rows) and len(rows[-1]) < width - 1 + (width <= 2) and (len(rows) < 2 or len(rows[-2]) >= width - 1)


def _fault(path: Path, layout: TextLayout, positions: list[int]) -> RecordError:
    """Return the error for the first bad cell, with the number of bad cells: slow, as it parses cell by cell."""
    faults: list[tuple[int, str, str]] = []
    for number, line in _rows(path, layout):
        cells = split_cells(line, layout.delimiter)
        for position in positions:
            cell = cells[position] if position < len(cells) else ""
            if not (is_number(cell, layout.decimal_comma) and math.isfinite(layout.number(cell))):
                faults.append((number, cell, layout.headings[position]))
    if not faults:
        return RecordError(f"{path.name}: the cells cannot be separated; expected every quote to be closed")
    number, cell, heading = faults[0]
    what = f"'{cell}' in column '{heading}' is not a finite number"
    others = f" ({len(faults)} such cells in all)" if len(faults) > 1 else ""
    return RecordError(f"{path.name}, line {number}: {what}{others}; correct or remove these samples")
