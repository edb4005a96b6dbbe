"""Delimited text: comma, semicolon (decimal comma as well), tab or blanks, with a header line."""

import csv
import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_checks import check_size, missing_column

DELIMITERS = ("\t", ";", ",", None)
"""Delimiters in the order in which they are tried; None is any run of blanks."""
COMMENTS = ("#", "%")
BRACKETS = (("[", "]"), ("(", ")"))
"""Brackets around a unit."""
ENCODING_PEEK_BYTES = 65536
"""Bytes from which the encoding is detected."""
MAX_HEADER_LINES = 1000
"""Lines among which the first line of numbers must be."""
MAX_LINE_CHARACTERS = 1 << 22
"""Characters of a line, and of all lines together among which the first line of numbers must be."""


class CsvReader(RecordReader, name="csv", version=1):
    """Delimited text with names in its last line before the numbers, such as ``Position [mm]``.

    A column is asked for by its name with or without the unit; in a file without a header by its number from 1.
    Lines that begin with # or % are comments; such a line may be the header if there is no other.
    """

    suffixes = (".csv", ".txt", ".tsv", ".dat")

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        encoding, layout = _detect_layout(path)
        positions = [layout.position(path, column) for column in columns]
        values = _numbers(path, encoding, layout, positions)
        names = [_name_and_unit(heading)[0] for heading in layout.headings]
        units = dict(zip(names, layout.units, strict=False))  # of all columns: another one may be the clock
        units |= {column: layout.units[position] for column, position in zip(columns, positions, strict=True)}
        return RecordTable(
            columns=dict(zip(columns, values, strict=True)),
            units={column: unit for column, unit in units.items() if unit},
        )

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of every column by its name."""
        encoding, layout = _detect_layout(path)
        rows = sum(1 for _ in _rows(path, encoding, layout))
        names = [_name_and_unit(heading)[0] for heading in layout.headings]
        return {name: ((rows,), unit or "") for name, unit in zip(names, layout.units, strict=False) if name}


@dataclass(frozen=True)
class _Layout:
    """Layout of a text file."""

    delimiter: str | None
    decimal_comma: bool
    start: int
    """Lines before the first line of numbers."""
    headings: tuple[str, ...]
    """Headings as in the file; numbers from 1 if it has none."""
    units: tuple[str | None, ...]

    def position(self, path: Path, column: str) -> int:
        """Return the position of a column by its heading, or by the name in the heading."""
        names = [_name_and_unit(heading)[0] for heading in self.headings]
        for known in (list(self.headings), names):
            if known.count(column) > 1:
                raise RecordError(
                    f"{path.name}: {known.count(column)} columns are called '{column}'; rename all but one"
                )
            if column in known:
                return known.index(column)
        raise missing_column(path, column, names)

    def number(self, cell: str) -> float:
        """Return the number in a cell; ValueError if it is not a number."""
        return float(cell.replace(",", ".") if self.decimal_comma else cell)


def _detect_layout(path: Path) -> tuple[str, _Layout]:
    """Return encoding and layout of a file."""
    check_size(path, "the file", path.stat().st_size)
    encoding = _encoding(path)
    with path.open(encoding=encoding, errors="replace") as stream:
        return encoding, _layout(path, list(_head(path, stream)))


def _head(path: Path, stream: TextIO) -> Iterator[str]:
    """Yield the lines among which the first line of numbers must be."""
    remaining = MAX_LINE_CHARACTERS
    for line in itertools.islice(_lines(path, stream), MAX_HEADER_LINES):
        remaining -= len(line)
        if remaining < 0:
            return
        yield line


def _lines(path: Path, stream: TextIO) -> Iterator[str]:
    """Yield the lines of a text; RecordError at one that is too long to be a line of columns."""
    number = 1
    while line := stream.readline(MAX_LINE_CHARACTERS + 1):
        if len(line) > MAX_LINE_CHARACTERS:
            raise RecordError(
                f"{path.name}, line {number}: more than {MAX_LINE_CHARACTERS:,} characters; expected columns"
            )
        yield line
        number += 1


def _encoding(path: Path) -> str:
    with path.open("rb") as stream:
        head = stream.read(ENCODING_PEEK_BYTES)
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if b"\0" in head:
        raise RecordError(f"{path.name}: this is not a text file; expected lines of numbers, or choose another reader")
    try:
        # up to the end of a line, so that no character is cut in two
        (head[: head.rfind(b"\n") + 1] if len(head) == ENCODING_PEEK_BYTES else head).decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _layout(path: Path, lines: list[str]) -> _Layout:
    for delimiter in DELIMITERS:
        for start, line in enumerate(lines):
            cells = _cells(line, delimiter)
            if len(cells) > 1 and not line.lstrip().startswith(COMMENTS) and _numeric(cells, delimiter):
                return _layout_below_header(path, lines[:start], delimiter, cells)
    for start, line in enumerate(lines):
        if not line.lstrip().startswith(COMMENTS) and _numeric([line.strip()], ";"):
            return _layout_below_header(path, lines[:start], ";", [line.strip()])
    raise RecordError(
        f"{path.name}: no line of numbers in the first {MAX_HEADER_LINES}; expected columns of numbers under a header"
    )


def _layout_below_header(path: Path, header: list[str], delimiter: str | None, cells: list[str]) -> _Layout:
    decimal_comma = delimiter != "," and any("," in cell for cell in cells)
    rows = [(number + 1, line.strip()) for number, line in enumerate(header) if line.strip()]
    plain = [(number, _cells(line, delimiter)) for number, line in rows if not line.startswith(COMMENTS)]
    commented = [(number, _cells(line.lstrip("#% "), delimiter)) for number, line in rows if line.startswith(COMMENTS)]
    widths = (len(cells), len(cells) - (not cells[-1]))  # a line of numbers may end with a delimiter
    candidates = [row for row in plain if len(row[1]) in widths]
    if not candidates:
        candidates = [row for row in commented if len(row[1]) in widths][-1:]
    headings = candidates[0][1] if candidates else [str(position + 1) for position in range(len(cells))]
    units = [_name_and_unit(heading)[1] for heading in headings]
    for number, row in candidates[1:]:
        if any(_is_number(cell, decimal_comma) for cell in row):
            bad = next((cell for cell in row if not _is_number(cell, decimal_comma)), row[0])
            raise RecordError(
                f"{path.name}, line {number}: '{bad}' does not fit the lines below; correct or remove the line"
            )
        units = [cell.strip("[]()") or unit for cell, unit in zip(row, units, strict=False)]  # a line of units
    return _Layout(delimiter, decimal_comma, len(header), tuple(headings), tuple(units))


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter), [])]
    except csv.Error:  # such as a cell of more than 128 KiB
        return [line.strip()]


def _numeric(cells: list[str], delimiter: str | None) -> bool:
    # A first line of numbers with an empty cell is not a heading.
    filled = [cell for cell in cells if cell]
    return bool(filled) and all(_is_number(cell, delimiter != ",") for cell in filled)


def _is_number(cell: str, decimal_comma: bool) -> bool:
    with suppress(ValueError):
        float(cell.replace(",", ".") if decimal_comma else cell)
        return True
    return False


def _name_and_unit(heading: str) -> tuple[str, str | None]:
    for opening, closing in BRACKETS:
        name, bracket, unit = heading.removesuffix(closing).rpartition(opening)
        if heading.endswith(closing) and bracket and name.strip() and closing not in unit:
            return name.rstrip(), unit
    return heading, None


def _rows(path: Path, encoding: str, layout: _Layout) -> Iterator[tuple[int, str]]:
    with path.open(encoding=encoding, errors="replace") as stream:
        for number, line in enumerate(_lines(path, stream), start=1):
            if number > layout.start and line.strip() and not line.lstrip().startswith(COMMENTS):
                yield number, line


def _numbers(path: Path, encoding: str, layout: _Layout, positions: list[int]) -> NDArray[np.float64]:
    lines = (line.replace(",", ".") if layout.decimal_comma else line for _, line in _rows(path, encoding, layout))
    try:
        values = np.loadtxt(
            lines, delimiter=layout.delimiter, usecols=positions, comments=None, quotechar='"', ndmin=2, unpack=True
        )
    except (ValueError, StopIteration):  # the latter where a quote is never closed
        raise _fault(path, encoding, layout, positions) from None
    if not np.isfinite(values).all():
        raise _fault(path, encoding, layout, positions)
    return np.asarray(values)


def _fault(path: Path, encoding: str, layout: _Layout, positions: list[int]) -> RecordError:
    """Return the error for the first bad cell, with the number of bad cells: slow, as it parses cell by cell."""
    faults: list[str] = []
    count = 0
    for number, line in _rows(path, encoding, layout):
        cells = _cells(line, layout.delimiter)
        for position in positions:
            cell = cells[position] if position < len(cells) else ""
            finite = False
            with suppress(ValueError):
                finite = math.isfinite(layout.number(cell))
            if not finite:
                count += 1
                faults = faults or [f"line {number}", f"'{cell}' in column '{layout.headings[position]}'"]
    if not faults:
        return RecordError(f"{path.name}: the cells cannot be separated; expected every quote to be closed")
    where, what = faults
    others = f" ({count} such cells in all)" if count > 1 else ""
    return RecordError(f"{path.name}, {where}: {what} is not a finite number{others}; correct or remove these samples")
