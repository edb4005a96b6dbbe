"""Headings of a text table: names and units of its columns, and the clock that lines above it state."""

import re
from collections.abc import Sequence
from itertools import pairwise, zip_longest
from pathlib import Path

from fraexp.api import RecordError
from fraexp_plugins.readers._shared.text_lines import is_comment, is_number, split_cells

BRACKETS = (("[", "]"), ("(", ")"))
"""Brackets around a unit."""
PLAIN_UNIT = (
    r"%|°C?|[fpnuµμmkMG]?(?:m|s|N|A|V|W|g|Hz|rad|Nm|N\*m|Pa|J|bar|T)(?:[/*·^².\d-]|m|s|min|rad|Hz|N|A|V)*"
    r"|[mkuµμ]?[AV][ _]?(?:rms|pk|eff|p)|d[Bb]|deg(?:/s\S*)?|degrees?|rpm|U/min|1/min|min\^?-1|inc\w*|counts?|cts|bool"
    r"|ticks?|rev|in|lbf?|mdeg|arcsec|raw|[mnuµμ]?sec|seconds?|[Vv]olts?|[Aa]mp(?:ere)?s?|[Nn]ewtons?|[Hh]ertz"
)
UNIT_PATTERN = re.compile(rf"-|–|1|[\[(].*[\])]|{PLAIN_UNIT}|Sec|Sequence")
"""A cell in a line of units."""
JOINED_UNIT = re.compile(
    rf"(?P<name>[^/]*[^/\s,])(?:\s*/\s*|\s+in\s+|,\s+)\(?(?P<unit>(?<=\()[^()]+(?=\))|{PLAIN_UNIT})\)?"
)
"""A heading such as ``F/kN`` or ``v/(mm/s)`` (ISO 80000-1: quantity over unit), ``Phase in °`` or ``Force, N``."""
CLOCK_FACTORS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "sec": 1.0, "Sec": 1.0, "msec": 1e-3,
    "usec": 1e-6, "nsec": 1e-9, "second": 1.0, "seconds": 1.0, "min": 60.0, "h": 3600.0,
}  # fmt: skip
"""Units of a column of time."""
AMBIGUOUS_CLOCK_UNITS = ("min", "h")
"""Units of a column of time that alone do not make it one."""
TIME_NAMES = ("t", "time", "zeit", "timestamp", "x_value", "x-axis")


def name_and_unit(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a heading such as ``Position [mm]``; in ``iq[0]`` the number is an index."""
    for opening, closing in BRACKETS:
        name, bracket, unit = heading.removesuffix(closing).rpartition(opening)
        if heading.endswith(closing) and bracket and name.strip() and closing not in unit:
            if unit.strip().isdigit() and not name.endswith(" "):
                break
            return name.rstrip(), unit
    return heading, None


def names_and_units(headings: Sequence[str]) -> list[tuple[str, str | None]]:
    """Return name and unit of each heading of a table, with brackets around the units or without.

    ``F/kN`` counts only if the table has another such heading: a name may contain a slash.
    """
    found = [name_and_unit(heading) for heading in headings]
    if any(unit and not name.endswith("/") for name, unit in found):
        return found
    joined = [JOINED_UNIT.fullmatch(heading) for heading in headings]
    pairs = [(match["name"], match["unit"]) for match in joined if match]
    is_alone = len(pairs) < 2 or all(UNIT_PATTERN.fullmatch(name) for name, _ in pairs)  # m/s and mm/s are units
    is_complete = len(pairs) == sum(map(bool, headings))
    if is_alone or not (is_complete or any(unit in (*CLOCK_FACTORS, "Hz") for _, unit in pairs)):
        return found
    return [(match["name"], match["unit"]) if match else plain for match, plain in zip(joined, found, strict=True)]


def is_time(name: str, unit: str | None) -> bool:
    """Say whether a column of this name and unit is evidently the time."""
    stated = (unit or "").strip()
    return (stated in CLOCK_FACTORS and stated not in AMBIGUOUS_CLOCK_UNITS) or name.strip().lower() in TIME_NAMES


LABEL_OF_NAMES = re.compile(r"(?:trace|signal|channel)?[ _]?names?|signals?|channels?|header|kan[aä]le?", re.IGNORECASE)
LABEL_OF_UNITS = re.compile(r"[vy]?[ _]?units?|einheit(?:en)?", re.IGNORECASE)
"""First cells of the lines with names and with units, in a table whose first column contains labels."""

Headings = tuple[list[str], list[str], list[str | None]]
"""Headings as in the file, names without units, and units, one for each column."""


def find_headings(
    path: Path, header: Sequence[str], delimiter: str | None, cells: Sequence[str], decimal_comma: bool
) -> Headings:
    """Return headings, names and units of the columns from the lines above the table, whose first row is `cells`."""
    rows = [(number + 1, line.strip(" \r\n")) for number, line in enumerate(header) if line.strip()]
    plain = [(number, _heading_cells(line, delimiter, len(cells))) for number, line in rows if not is_comment(line)]
    labelled = _labelled_headings([row for _, row in plain], cells)
    if labelled:
        return labelled
    commented = [(n, _heading_cells(line.lstrip("#% "), delimiter, len(cells))) for n, line in rows if is_comment(line)]
    widths = range(len(cells) - (not cells[-1]), len(cells) + 2)  # a line may end with a delimiter, or with a remark
    block = _heading_block(plain, widths, decimal_comma)
    if not block:
        block = [row for row in commented if len(row[1]) in widths[:-1]][-1:]
    if not block:
        _check_no_broken_row(path, plain, widths, decimal_comma)
        numbers = [str(position + 1) for position in range(len(cells))]
        return numbers, numbers, [None] * len(cells)
    headings = (block[0][1] + [""] * len(cells))[: max(len(cells), 1)]
    above = next((row for number, row in plain if number == block[0][0] - 1), [])
    found = [_under_time(*pair) for pair in zip_longest(names_and_units(headings), above[: len(headings)])]
    units = [unit for _, unit in found]
    for _, row in block[1:]:
        if _are_units(row, with_numbers=True):
            units = [cell.strip("[]()") or unit for cell, unit in zip(row + [""] * len(cells), units, strict=False)]
    return headings, [name for name, _ in found], units


def _heading_cells(line: str, delimiter: str | None, width: int) -> list[str]:
    """Return the cells of a line above a table of a width; between blanks, a unit in brackets belongs to its name."""
    cells = split_cells(line, delimiter)
    if delimiter is not None or len(cells) == width:
        return cells
    ways = (re.findall(r"\S+(?:\s+[\[(][^\])]*[\])])?", line), re.split(r"\s{2,}", line.strip()))
    return next((way for way in ways if len(way) == width), cells)


def _under_time(own: tuple[str, str | None], above: str | None) -> tuple[str, str | None]:
    """Return name and unit of a heading; a unit of time below a name of the time, as servo drives write it, is both."""
    is_unit = own[0] in CLOCK_FACTORS and own[1] is None and is_time(above or "", None)
    return (above or "", own[0]) if is_unit else own


def _labelled_headings(rows: Sequence[list[str]], cells: Sequence[str]) -> Headings | None:
    """Return the headings of a table whose first column contains labels, such as ``name`` and ``unit``, or None."""
    if len(cells) < 2 or is_number(cells[0], decimal_comma=True):
        return None
    wide = [row for row in rows if len(row) in (len(cells), len(cells) + 1)]
    names = [row for row in wide if LABEL_OF_NAMES.fullmatch(row[0].rstrip(":"))]
    if not names:
        return None
    headings = ["", *names[-1][1 : len(cells)]]
    found = names_and_units(headings)
    units = [unit for _, unit in found]
    for row in wide:
        if LABEL_OF_UNITS.fullmatch(row[0].rstrip(":")):
            units = [None, *(cell.strip("[]()") or None for cell in row[1 : len(cells)])]
    return headings, [name for name, _ in found], units


def _are_units(row: Sequence[str], with_numbers: bool = False) -> bool:
    """Say whether cells are units; beside them an oscilloscope may write the numbers of its clock."""
    plain = [cell for cell in row if cell and not (with_numbers and is_number(cell, decimal_comma=True))]
    return all(UNIT_PATTERN.fullmatch(cell) for cell in plain)


def _heading_block(
    plain: Sequence[tuple[int, list[str]]], widths: Sequence[int], decimal_comma: bool
) -> list[tuple[int, list[str]]]:
    """Return the lines directly above the table that may be headings or units: of its width, and without numbers."""
    block: list[tuple[int, list[str]]] = []
    for number, row in reversed(plain):
        values = sum(is_number(cell, decimal_comma) for cell in row)
        is_numbered = _are_numbered_names(row) and bool(block) and all(_are_units(units) for _, units in block)
        if is_numbered and len(row) in widths:
            block.insert(0, (number, row))
            break
        if len(row) not in widths or not any(row) or (values and (block or is_number(row[0], decimal_comma))):
            break
        block.insert(0, (number, row))
    names = [at for at, (_, row) in enumerate(block) if not _are_units(row, with_numbers=at > 0)]
    return block[_last_names(block, names) :] if names else block


def _are_numbered_names(row: Sequence[str]) -> bool:
    """Say whether a row above units is that of an oscilloscope, ``x-axis,1,2``: channels are called by numbers."""
    return is_time(row[0], None) and all(cell.isdigit() for cell in row[1:] if cell)


def _last_names(block: Sequence[tuple[int, list[str]]], names: Sequence[int]) -> int:
    """Return the place of the headings: the line with the most units, a time, then the first with most other cells."""

    def evidence(at: int) -> tuple[int, bool, int, int]:
        cells = [cell for cell in block[at][1] if cell]
        units = sum(name_and_unit(cell)[1] is not None for cell in cells)
        return units, any(is_time(*name_and_unit(cell)) for cell in cells), len(set(cells)), -at

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


NUMBER = r"(?P<number>\d[\d.,]*(?:e[+-]?\d+)?)"
RATE_ENTRY = re.compile(
    r"(?:(?:sampl(?:e|ing)|recording|acquisition)[ _]?(?:rate|freq\w*)|f_?s|abtast(?:rate|frequenz))"
    r"\W*?(?P<prefix>k|M)?(?:Hz)?\W*?[\s:=,;\]]\W*?"
    rf"{NUMBER}\s*(?P<unit>[kM]?Hz|[kM]?S/s)?\W*",
    re.IGNORECASE,
)
"""A line of metadata with the sample rate, such as ``Sample rate [kHz]: 2.5`` or ``fs = 2500 Hz``."""
TIME_ENTRY = re.compile(
    r"(?:sampl(?:e|ing)[ _]?(?:time|interval|period)|delta[ _]?[tx]|[dt]_?[ts]|abtastzeit)"
    r"[\W_]*?(?P<before>ms|us|µs|s)?"
    rf"\W*?[\s:=,;\]]\W*?{NUMBER}\s*(?P<unit>ms|us|µs|s)?\W*",
    re.IGNORECASE,
)
"""A line of metadata with the sample time, such as ``Sample interval (s), 4e-4`` or ``dt = 0.4 ms``."""
INCREMENT_NAME = re.compile(r"increment|x_?incr(?:ement)?", re.IGNORECASE)
"""Heading above a single number: an oscilloscope's sample time [s], while its first column counts the samples."""
MAX_ENTRY_CHARACTERS = 200
"""Characters of a line of metadata that are looked at."""
RATE_FACTORS = {"": 1.0, "k": 1e3, "m": 1e6}
TIME_FACTORS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}


def stated_sample_time(header: Sequence[str], rows: Sequence[Sequence[str]], decimal_comma: bool) -> float | None:
    """Return the sample time [s] that the lines above a table state, or None.

    `rows` are the cells of these lines that are as wide as the table: such a line may state one rate for each column.
    """
    repeated = [f"{row[0]}: {row[-1]}" for row in rows if len({cell for cell in row[1:] if cell}) == 1]
    for line in (*header, *repeated):
        text = line[:MAX_ENTRY_CHARACTERS].strip(" \t\r\n\"'#%;,")
        if rate := RATE_ENTRY.fullmatch(text):
            prefix = (rate["unit"] or rate["prefix"] or "")[:1].lower()
            value = _number(rate["number"], decimal_comma) * RATE_FACTORS.get(prefix, 1.0)
            if value > 0:
                return 1 / value
        time = TIME_ENTRY.fullmatch(text)
        if time and (time["unit"] or time["before"]):
            unit = (time["unit"] or time["before"]).lower()
            # ſ and μ count as s and µ in a pattern
            value = _number(time["number"], decimal_comma) * TIME_FACTORS.get(unit, 0.0)
            if value > 0:
                return value
    return _increment(rows, decimal_comma)


def _increment(rows: Sequence[Sequence[str]], decimal_comma: bool) -> float | None:
    """Return the number below a heading such as Increment, or None."""
    for above, below in pairwise(rows):
        for heading, cell in zip(above, below, strict=False):
            if INCREMENT_NAME.fullmatch(heading):
                return _number(cell, decimal_comma) or None
    return None


def _number(text: str, decimal_comma: bool) -> float:
    """Return a number; 0 if it is none: with a comma that is not the table's decimal sign it may be two."""
    try:
        return float(text.rstrip(",.").replace(",", ".") if decimal_comma else text)
    except ValueError:  # such as 1.2.3
        return 0.0
