"""The points of a response, a page at a time."""

from typing import ClassVar

from textual.binding import Binding, BindingType

from fraexp.tui.widgets.paged_table import PagedTable, TableRows
from fraexp.views.listing import Column

COLUMN_RANKS = {
    "force rate": 12,
    "acceleration": 11,
    "after": 10,
    "numerical": 9,
    "input": 8,
    "output": 7,
    "noise": 6,
    "nonlinear": 5,
    "coherence": 4,
    "distortion": 3,
    "± 95 %": 2,
}
"""The higher the rank, the sooner a column is dropped if not all fit."""


class PointsTable(PagedTable):
    """The points of a response, a row for each frequency."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "nothing", show=False)]
    DEFAULT_CSS = "PointsTable { height: 1fr; }"

    def __init__(self) -> None:
        super().__init__()
        self.header_height = 2
        self._columns: list[str] = []
        self._rows: list[list[str]] = []
        self._are_numbers = True

    def show_points(self, columns: list[str], rows: list[list[str]], are_numbers: bool = True) -> None:
        """Show the points of another response, or rows of words."""
        self._are_numbers = are_numbers
        kept = [index for index in range(len(columns)) if any(row[index] for row in rows)]
        self._columns = [columns[index] for index in kept]
        self._rows = [[row[index] for index in kept] for row in rows]
        self.restart()

    async def fetch_rows(self, first: int, most: int) -> TableRows:
        """Return points from an offset."""
        rows = self._rows[first : first + most]
        return TableRows(
            tuple(str(first + index) for index in range(len(rows))), self._visible_columns(rows), len(self._rows)
        )

    def is_marked(self, key: str) -> bool:
        """Return that no point is marked."""
        return False

    def _visible_columns(self, rows: list[list[str]]) -> list[Column]:
        columns = []
        for index, title in enumerate(self._columns):
            cells = tuple(row[index] for row in rows)
            columns.append(
                Column(title.replace(" [", "\n["), cells, rank=_rank(title), right_aligned=self._are_numbers)
            )
        return columns


def _rank(title: str) -> int:
    return next((rank for begin, rank in COLUMN_RANKS.items() if title.startswith(begin)), 0)
