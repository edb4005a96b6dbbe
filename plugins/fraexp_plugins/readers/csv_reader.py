"""Delimited text: comma, semicolon (decimal comma as well), tab or blanks, with a header line."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared.text_layout import TextLayout, detect_layout
from fraexp_plugins.readers._shared.text_lines import check_thousands, is_comment, is_number, split_cells, text_lines


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
            units={column: unit for column, unit in units.items() if unit},
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
    faults: list[str] = []
    count = cells_read = 0
    for number, line in _rows(path, layout):
        cells = split_cells(line, layout.delimiter)
        for position in positions:
            cell = cells[position] if position < len(cells) else ""
            finite = is_number(cell, layout.decimal_comma)
            with suppress(ValueError):
                finite = finite and math.isfinite(layout.number(cell))
            cells_read += 1
            if not finite:
                count += 1
                faults = faults or [f"line {number}", f"'{cell}' in column '{layout.headings[position]}'"]
    if not faults:
        return RecordError(f"{path.name}: the cells cannot be separated; expected every quote to be closed")
    where, what = faults
    if count == cells_read > 1 and len(positions) == 1 and positions[0] in layout.text_columns:
        name = layout.names[positions[0]]
        return RecordError(f"{path.name}: column '{name}' contains text; expected numbers: choose another column")
    others = f" ({count} such cells in all)" if count > 1 else ""
    return RecordError(f"{path.name}, {where}: {what} is not a finite number{others}; correct or remove these samples")
