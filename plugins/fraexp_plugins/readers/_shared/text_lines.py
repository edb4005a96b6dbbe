"""Lines and cells of text files, which the readers of text share; separators of thousands are refused."""

import csv
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from fraexp.api import RecordError
from fraexp_plugins.readers._shared.record_arrays import missing_column

ENCODING_PEEK_BYTES = 65536
"""Bytes from which the encoding is detected."""
COMMENTS = ("#", "%")
"""What a line begins with that is a comment."""
MAX_HEADER_LINES = 1000
"""Lines among which the first line of numbers must be."""
MAX_LINE_CHARACTERS = 1 << 22
"""Characters of a line, and of all lines together among which the first line of numbers must be."""


def text_encoding(path: Path) -> str:
    """Return the encoding of a text file; RecordError if it is not text."""
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


def head_lines(path: Path, stream: TextIO) -> Iterator[str]:
    """Yield the lines among which the first line of numbers must be."""
    remaining = MAX_LINE_CHARACTERS
    for line in itertools.islice(text_lines(path, stream), MAX_HEADER_LINES):
        remaining -= len(line)
        if remaining < 0:
            return
        yield line


def text_lines(path: Path, stream: TextIO) -> Iterator[str]:
    """Yield the lines of a text; RecordError at one that is too long to be a line of columns."""
    number = 1
    while line := stream.readline(MAX_LINE_CHARACTERS + 1):
        if len(line) > MAX_LINE_CHARACTERS:
            raise RecordError(
                f"{path.name}, line {number}: more than {MAX_LINE_CHARACTERS:,} characters; expected columns"
            )
        yield line
        number += 1


def is_comment(line: str) -> bool:
    """Say whether a line is a comment."""
    return line.lstrip().startswith(COMMENTS)


def split_cells(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line without the blanks around them; the delimiter None is any run of blanks."""
    if delimiter is None:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter), [])]
    except csv.Error:  # such as a cell of more than 128 KiB
        return [line.strip()]


def is_number(cell: str, decimal_comma: bool) -> bool:
    """Say whether a cell contains a number."""
    with suppress(ValueError):
        float(cell.replace(",", ".") if decimal_comma else cell)
        return True
    return False


def unique_names(names: Sequence[str]) -> list[str]:
    """Return the names; those that occur more than once are numbered, such as ``Time #2``."""
    total, seen = Counter(names), Counter[str]()
    found = []
    for name in names:
        seen[name] += 1
        found.append(f"{name} #{seen[name]}" if total[name] > 1 and name else name)
    return found


def column_position(path: Path, column: str, *spellings: Sequence[str]) -> int:
    """Return the position of a column in the first of the lists of names that contains it once.

    Raises
    ------
    RecordError : if no list contains it, or one contains it several times.
    """
    for known in spellings:
        count = list(known).count(column)
        if count > 1:
            raise RecordError(
                f"{path.name}: {count} columns are called '{column}'; give '{column} #1' to '{column} #{count}'"
            )
        if count:
            return list(known).index(column)
    raise missing_column(path, column, spellings[-1])


GROUPED = {".": re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+"), ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")}
"""What a number with separators of thousands looks like, by the separator."""
MIN_GROUPED = 2
"""Least number of cells that look grouped, from which whole numbers beside them tell that they are."""


def check_thousands(
    path: Path, rows: Iterable[tuple[int, str]], delimiter: str | None, positions: Sequence[int], names: Sequence[str]
) -> None:
    """Raise RecordError if a column of a file with decimal commas has separators of thousands, or may have.

    `rows` are line numbers and lines, `positions` the columns that are read.
    """
    counts = [Counter[str]() for _ in names]
    first: dict[int, tuple[int, str]] = {}
    for number, line in rows:
        for at, (count, cell) in enumerate(zip(counts, split_cells(line, delimiter), strict=False)):
            sign = next((sign for sign in GROUPED if sign in cell), "")
            if sign:
                first.setdefault(at, (number, cell))
                count[sign] += 1
                count[f"plain {sign}"] += not GROUPED[sign].fullmatch(cell)
            else:
                count["whole"] += is_number(cell, decimal_comma=True)
    have_points = any(count["plain ."] for count in counts)
    for position in positions:
        count = counts[position]
        by_commas = count[","] >= MIN_GROUPED and not count["plain ,"] and (have_points or count["whole"])
        if not count["plain ."] if count["."] else by_commas:
            number, cell = first[position]
            plain = cell.replace(".", "").replace(",", "")
            raise RecordError(
                f"{path.name}, line {number}: '{cell}' in column '{names[position]}' may be {plain} or "
                f"{cell.replace(',', '.')}; write its numbers without separators of thousands"
            )
