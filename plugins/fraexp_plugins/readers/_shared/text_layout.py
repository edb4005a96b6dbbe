"""Layout of a text file with columns: delimiter, first line of numbers, headings, units, and columns of text."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

from fraexp.api import RecordError
from fraexp_plugins.readers._shared.dates import first_day, seconds_since
from fraexp_plugins.readers._shared.record_checks import check_size
from fraexp_plugins.readers._shared.text_lines import (
    MAX_HEADER_LINES,
    column_position,
    head_lines,
    is_number,
    split_cells,
    text_encoding,
    unique_names,
)

DELIMITERS = ("\t", ";", ",", None)
"""Delimiters in the order in which they are tried; None is any run of blanks."""
COMMENTS = ("#", "%")
BRACKETS = (("[", "]"), ("(", ")"))
"""Brackets around a unit."""
SAMPLED_ROWS = 200
"""Last lines of the head that decide which columns contain numbers."""
FIRST_ROWS = 3
"""Successive lines that fit the columns where the table begins: a line of metadata may fit them by chance."""
UNIT_PATTERN = re.compile(
    r"-|–|%|1|°C?|[\[(].*[\])]|[fpnuµμmkMG]?(m|s|N|A|V|W|g|Hz|rad|Nm|N\*m|Pa|J|bar|T)([/*·^².\d-]|m|s|min|rad|Hz|N|A|V)*"
    r"|deg(/s\S*)?|rpm|1/min|min\^?-1|inc\w*|counts?|cts|bool|ticks?|rev|in|lbf?|mdeg|arcsec|raw"
)
"""A cell in a line of units."""
RATE_ENTRY = re.compile(
    r"(?:sampl(?:e|ing)[ _]?(?:rate|freq\w*)|f_?s|abtastrate)\W*?(?P<prefix>k|M)?(?:Hz)?\W*?[\s:=,;\]]\W*?"
    r"(?P<number>\d[\d.]*(?:e[+-]?\d+)?)\s*(?P<unit>[kM]?Hz|[kM]?S/s)?\W*",
    re.IGNORECASE,
)
"""A line of metadata with the sample rate, such as ``Sample rate [kHz]: 2.5`` or ``fs = 2500 Hz``."""
TIME_ENTRY = re.compile(
    r"(?:sampl(?:e|ing)[ _]?(?:time|interval|period)|delta[ _]?[tx]|[dt]_?[ts]|abtastzeit)"
    r"[\W_]*?(?P<before>ms|us|µs|s)?"
    r"\W*?[\s:=,;\]]\W*?(?P<number>\d[\d.]*(?:e[+-]?\d+)?)\s*(?P<unit>ms|us|µs|s)?\W*",
    re.IGNORECASE,
)
"""A line of metadata with the sample time, such as ``Sample interval (s), 4e-4`` or ``dt = 0.4 ms``."""
MAX_ENTRY_CHARACTERS = 200
"""Characters of a line of metadata that are looked at."""
RATE_FACTORS = {"": 1.0, "k": 1e3, "m": 1e6}
TIME_FACTORS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}
CLOCK_FACTORS = TIME_FACTORS | {
    "sec": 1.0, "msec": 1e-3, "usec": 1e-6, "μs": 1e-6, "ns": 1e-9, "nsec": 1e-9, "min": 60.0, "h": 3600.0,
}  # fmt: skip
"""Units of a column of time."""


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
    units: tuple[str | None, ...]
    text_columns: frozenset[int]
    """Positions of the columns that contain text."""
    sample_time: float | None
    """Sample time [s] if a line above the table states it."""
    days: Mapping[int, date] = field(default_factory=dict)
    """First day of each column of dates, by its position: they are read as seconds since then."""

    @property
    def names(self) -> list[str]:
        """Names of the columns, without their units; equal ones are numbered."""
        return unique_names([name_and_unit(heading)[0] for heading in self.headings])

    def position(self, path: Path, column: str) -> int:
        """Return the position of a column by its heading, or by the name in the heading."""
        plain = [name_and_unit(heading)[0] for heading in self.headings]
        return column_position(path, column, self.headings, plain, self.names)

    def time_position(self, position: int) -> int | None:
        """Return the position of the time of a column: the nearest one before it; None if the file has only one."""
        times = [at for at, heading in enumerate(self.headings) if _is_time(heading)]
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

    def without_dates(self, line: str) -> str:
        """Return a line in which dates are numbers of seconds; what is no date stays."""
        cells = split_cells(line, self.delimiter)
        for position in self.days.keys() & range(len(cells)):
            with suppress(ValueError):
                cells[position] = repr(seconds_since(cells[position], self.days[position]))
        return (self.delimiter or " ").join(f'"{cell}"' if (self.delimiter or " ") in cell else cell for cell in cells)


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
    headings, units = _headings(path, header, delimiter, cells, decimal_comma)
    days = _days(lines[start:], delimiter, text_columns)
    units = ["s" if position in days else unit for position, unit in enumerate(units)]
    clock = None if days or any(map(_is_time, headings)) else _stated_sample_time(header)
    text = frozenset(text_columns - days.keys())
    return TextLayout(encoding, delimiter, decimal_comma, start, tuple(headings), tuple(units), text, clock, days)


def _days(lines: Sequence[str], delimiter: str | None, text_columns: set[int]) -> dict[int, date]:
    """Return the first day of each column of dates by its position."""
    rows = [split_cells(line, delimiter) for line in lines[:SAMPLED_ROWS] if line.strip() and not _is_comment(line)]
    found = {at: first_day([row[at] for row in rows if at < len(row)]) for at in text_columns}
    return {at: day for at, day in found.items() if day}


def name_and_unit(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a heading such as ``Position [mm]``; in ``iq[0]`` the number is an index."""
    for opening, closing in BRACKETS:
        name, bracket, unit = heading.removesuffix(closing).rpartition(opening)
        if heading.endswith(closing) and bracket and name.strip() and closing not in unit:
            if unit.strip().isdigit() and not name.endswith(" "):
                break
            return name.rstrip(), unit
    return heading, None


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _numeric(cells: Sequence[str], delimiter: str | None) -> bool:
    # A first line of numbers with an empty cell is not a heading.
    filled = [cell for cell in cells if cell]
    return bool(filled) and all(is_number(cell, delimiter != ",") for cell in filled)


def _pure_table(lines: Sequence[str]) -> tuple[int, str | None, set[int]] | None:
    """Return first line and delimiter of a table in which a line contains numbers alone."""
    for delimiter in DELIMITERS:
        for start, line in enumerate(lines):
            cells = split_cells(line, delimiter)
            if len(cells) > 1 and not _is_comment(line) and _numeric(cells, delimiter):
                first = _first_row_above(lines, start, delimiter, len(cells))
                return first, delimiter, _text_columns(lines[first:], delimiter, len(cells))
    return None


def _first_row(lines: Sequence[str], delimiter: str | None) -> list[str]:
    """Return the cells of the first line without a remark at its end, for which the second one has no cell."""
    first, *others = (split_cells(line, delimiter) for line in lines)
    has_remark = _numeric(first[:-1], delimiter) and not is_number(first[-1], decimal_comma=True)
    return first[:-1] if has_remark and others and len(others[0]) == len(first) - 1 else first


def _first_row_above(lines: Sequence[str], start: int, delimiter: str | None, width: int) -> int:
    """Return the first of the lines directly above that begin with a number: another column contains text there.

    The first row of a LabVIEW file may end with a remark, in a column that the others do not have.
    """
    first = start
    for number in range(start - 1, -1, -1):
        cells = split_cells(lines[number], delimiter)
        has_remark = len(cells) == width + 1 and _numeric(cells[:-1], delimiter)
        if _is_comment(lines[number]) or not (len(cells) == width or has_remark):
            break
        if not is_number(cells[0], delimiter != ","):
            break
        first = number
    return first


def _mixed_table(lines: Sequence[str]) -> tuple[int, str | None, set[int]] | None:
    """Return first line, delimiter and columns of text of a table in which each line contains text."""
    rows = [(number, line) for number, line in enumerate(lines) if line.strip() and not _is_comment(line)]
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
    numbers = (n for n, line in enumerate(lines) if not _is_comment(line) and _numeric([line.strip()], ";"))
    start = next(numbers, None)
    return None if start is None else (start, ";", set())


def _text_columns(lines: Sequence[str], delimiter: str | None, width: int) -> set[int]:
    """Return the positions of columns of which most cells are text."""
    rows = [split_cells(line, delimiter) for line in lines[-SAMPLED_ROWS:] if line.strip() and not _is_comment(line)]
    columns = zip(*(row for row in rows if len(row) == width), strict=True)
    return {
        position
        for position, column in enumerate(columns)
        if sum(1 if is_number(cell, delimiter != ",") else -1 for cell in column if cell) < 0
    }


def _numeric_cells(lines: Sequence[str], delimiter: str | None) -> Iterator[str]:
    for line in lines[:SAMPLED_ROWS]:
        yield from (cell for cell in split_cells(line, delimiter) if is_number(cell, decimal_comma=True))


def _headings(
    path: Path, header: Sequence[str], delimiter: str | None, cells: Sequence[str], decimal_comma: bool
) -> tuple[list[str], list[str | None]]:
    """Return headings and units of the columns from the lines above the table."""
    rows = [(number + 1, line.strip(" \r\n")) for number, line in enumerate(header) if line.strip()]
    plain = [(number, split_cells(line, delimiter)) for number, line in rows if not _is_comment(line)]
    commented = [(number, split_cells(line.lstrip("#% "), delimiter)) for number, line in rows if _is_comment(line)]
    widths = range(len(cells) - (not cells[-1]), len(cells) + 2)  # a line may end with a delimiter, or with a remark
    block = _heading_block(plain, widths, decimal_comma)
    if not block:
        block = [row for row in commented if len(row[1]) in widths[:-1]][-1:]
    if not block:
        _check_no_broken_row(path, plain, widths, decimal_comma)
        return [str(position + 1) for position in range(len(cells))], [None] * len(cells)
    headings = (block[0][1] + [""] * len(cells))[: max(len(cells), 1)]
    units = [name_and_unit(heading)[1] for heading in headings]
    for _, row in block[1:]:
        if all(UNIT_PATTERN.fullmatch(cell) for cell in row if cell):  # a line of units
            units = [cell.strip("[]()") or unit for cell, unit in zip(row + [""] * len(cells), units, strict=False)]
    return headings, units


def _heading_block(
    plain: Sequence[tuple[int, list[str]]], widths: Sequence[int], decimal_comma: bool
) -> list[tuple[int, list[str]]]:
    """Return the lines directly above the table that may be headings or units: of its width, and without numbers."""
    block: list[tuple[int, list[str]]] = []
    for number, row in reversed(plain):
        values = sum(is_number(cell, decimal_comma) for cell in row)
        if len(row) not in widths or not any(row) or (values and (block or is_number(row[0], decimal_comma))):
            break
        block.insert(0, (number, row))
    names = [at for at, (_, row) in enumerate(block) if not all(UNIT_PATTERN.fullmatch(c) for c in row if c)]
    return block[_last_names(block, names) :] if names else block


def _last_names(block: Sequence[tuple[int, list[str]]], names: Sequence[int]) -> int:
    """Return the place of the headings: the line with the most units, then the first with the most different cells."""

    def evidence(at: int) -> tuple[int, int, int]:
        cells = [cell for cell in block[at][1] if cell]
        return sum(name_and_unit(cell)[1] is not None for cell in cells), len(set(cells)), -at

    return max(names, key=evidence)


def _check_no_broken_row(
    path: Path, plain: Sequence[tuple[int, list[str]]], widths: Sequence[int], decimal_comma: bool
) -> None:
    for number, row in plain[-1:]:
        if len(row) in widths and any(is_number(cell, decimal_comma) for cell in row):
            bad = next((cell for cell in row if not is_number(cell, decimal_comma)), row[0])
            raise RecordError(
                f"{path.name}, line {number}: '{bad}' does not fit the lines below; correct or remove the line"
            )


def _is_time(heading: str) -> bool:
    name, unit = name_and_unit(heading)
    return (unit or "").strip() in TIME_FACTORS or name.strip().lower() in ("t", "time", "zeit", "timestamp", "x_value")


def _stated_sample_time(header: Sequence[str]) -> float | None:
    """Return the sample time [s] that a line above the table states, or None."""
    for line in header:
        text = line[:MAX_ENTRY_CHARACTERS].strip(" \t\r\n\"'#%;,")
        if rate := RATE_ENTRY.fullmatch(text):
            prefix = (rate["unit"] or rate["prefix"] or "")[:1].lower()
            value = _as_float(rate["number"]) * RATE_FACTORS.get(prefix, 1.0)
            return 1 / value if value > 0 else None
        time = TIME_ENTRY.fullmatch(text)
        if time and (time["unit"] or time["before"]):
            unit = (time["unit"] or time["before"]).lower()
            value = _as_float(time["number"]) * TIME_FACTORS.get(unit, 0.0)  # ſ and μ count as s and µ in a pattern
            return value or None
    return None


def _as_float(text: str) -> float:
    try:
        return float(text)
    except ValueError:  # such as 1.2.3
        return 0.0
