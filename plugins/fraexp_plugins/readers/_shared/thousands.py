"""Separators of thousands in a text file, which look like decimal commas or points of three digits."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from fraexp.api import RecordError
from fraexp_plugins.readers._shared.text_lines import is_number, split_cells

GROUPED_POINTS = re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+")
GROUPED_COMMAS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")
MIN_GROUPED = 2
"""Least number of cells that look grouped, from which whole numbers beside them tell that they are."""


class _Column:
    """What the cells of a column in a file with decimal commas look like."""

    def __init__(self) -> None:
        self.points = self.commas = self.whole = 0
        """Numbers of cells with a point, with a comma, and with neither."""
        self.all_grouped = True
        """Whether each cell with a separator has three digits behind each."""
        self.first: tuple[int, str] | None = None
        """Line and text of the first cell with a separator."""

    def add(self, number: int, cell: str) -> None:
        """Count a cell."""
        has_point, has_comma = "." in cell, "," in cell
        if not has_point and not has_comma:
            self.whole += is_number(cell, decimal_comma=True)
            return
        self.points += has_point
        self.commas += has_comma and not has_point
        grouped = GROUPED_POINTS if has_point else GROUPED_COMMAS
        if has_point or not self.points:
            self.all_grouped &= bool(grouped.fullmatch(cell))
        self.first = self.first or (number, cell)

    @property
    def has_decimal_points(self) -> bool:
        return bool(self.points) and not self.all_grouped

    def is_grouped(self, others_have_points: bool) -> bool:
        """Say whether its separators are probably those of thousands."""
        if not self.all_grouped:
            return False
        return bool(self.points) or (self.commas >= MIN_GROUPED and (others_have_points or bool(self.whole)))


def check_thousands(
    path: Path, rows: Iterable[tuple[int, str]], delimiter: str | None, positions: Sequence[int], names: Sequence[str]
) -> None:
    """Raise RecordError if a column of a file with decimal commas has separators of thousands, or may have.

    `rows` are line numbers and lines, `positions` the columns that are read.
    """
    columns = [_Column() for _ in names]
    for number, line in rows:
        for column, cell in zip(columns, split_cells(line, delimiter), strict=False):
            column.add(number, cell)
    have_points = any(column.has_decimal_points for column in columns)
    for position in positions:
        column = columns[position]
        if column.first and column.is_grouped(have_points):
            number, cell = column.first
            plain = cell.replace(".", "").replace(",", "")
            raise RecordError(
                f"{path.name}, line {number}: '{cell}' in column '{names[position]}' may be {plain} or "
                f"{cell.replace(',', '.')}; write its numbers without separators of thousands"
            )
