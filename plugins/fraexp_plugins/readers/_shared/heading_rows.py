"""Lines above a table of text: which of them are the headings and the units of its columns."""

import re
from collections.abc import Sequence
from pathlib import Path

from fraexp.api import RecordError
from fraexp_plugins.readers._shared.column_headings import UNIT_PATTERN, is_time, name_and_unit, names_and_units
from fraexp_plugins.readers._shared.text_lines import is_comment, is_number, split_cells

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
    plain = [(number, split_cells(line, delimiter)) for number, line in rows if not is_comment(line)]
    labelled = _labelled_headings([row for _, row in plain], cells)
    if labelled:
        return labelled
    commented = [(n, split_cells(line.lstrip("#% "), delimiter)) for n, line in rows if is_comment(line)]
    widths = range(len(cells) - (not cells[-1]), len(cells) + 2)  # a line may end with a delimiter, or with a remark
    block = _heading_block(plain, widths, decimal_comma)
    if not block:
        block = [row for row in commented if len(row[1]) in widths[:-1]][-1:]
    if not block:
        _check_no_broken_row(path, plain, widths, decimal_comma)
        numbers = [str(position + 1) for position in range(len(cells))]
        return numbers, numbers, [None] * len(cells)
    headings = (block[0][1] + [""] * len(cells))[: max(len(cells), 1)]
    found = names_and_units(headings)
    units = [unit for _, unit in found]
    for _, row in block[1:]:
        if _are_units(row, with_numbers=True):
            units = [cell.strip("[]()") or unit for cell, unit in zip(row + [""] * len(cells), units, strict=False)]
    return headings, [name for name, _ in found], units


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
