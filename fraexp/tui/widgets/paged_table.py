"""Tables that hold only the visible page: of what is read bit by bit, of a list, and of the points of a response."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Generic, Literal, TypeVar

from rich.text import Text
from textual import events, work
from textual.binding import Binding, BindingType
from textual.coordinate import Coordinate
from textual.message import Message
from textual.widgets import DataTable

from fraexp.data.texts import printable
from fraexp.errors import FraexpError
from fraexp.tui.page import TABLE_GROUP
from fraexp.tui.services.themes import rich_colour, state_cell, state_text
from fraexp.views.listing import COLUMN_GAP, Column, fit_columns

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp

Item = TypeVar("Item")
MARK_SIGN = "✓"
STATE_TITLES = ("state", "outcome", "last run")
"""Titles of columns with states, which get signs and colours."""
WHEEL_ROWS = 3
"""Rows by which the mouse wheel moves the cursor."""


class TableRows:
    """One page: the keys of its rows, its columns, and the total number of rows."""

    def __init__(self, keys: tuple[str, ...], columns: list[Column], total: int) -> None:
        self.keys, self.columns, self.total = keys, columns, total


@dataclass(frozen=True)
class _Drawn:
    """What a table shows."""

    keys: tuple[str, ...]
    columns: list[tuple[Column, int]]
    """With their widths."""
    marked: list[bool]

    def differs_in_cells(self, other: "_Drawn") -> bool:
        """Return whether another has the same rows, columns and marks, so that the cells alone may differ."""
        frames = ([(of.title, of.order, width) for of, width in each.columns] for each in (self, other))
        return (self.keys, self.marked, next(frames)) == (other.keys, other.marked, next(frames))


class PagedTable(DataTable[Text]):
    """A table page by page; the cursor turns the page at its edges, and stays on its row when others come or go.

    A subclass defines in `fetch_rows` where rows come from. The last line shows which rows are seen, or an error.
    """

    DEFAULT_CSS = """
    PagedTable {
        height: 1fr; overflow: hidden hidden; scrollbar-size: 0 0;
        border-bottom: solid $border-blurred; border-subtitle-align: left;
    }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "select_cursor", "open", tooltip="open the selected row"),
        Binding("down,j", "cursor_down", "down", show=False, tooltip="next row"),
        Binding("up,k", "cursor_up", "up", show=False, tooltip="previous row"),
        Binding("pagedown,right,l", "page_down", "page", show=False, tooltip="next page"),
        Binding("pageup,left,h", "page_up", "page back", show=False, tooltip="previous page"),
        Binding("g,home,ctrl+home", "scroll_top", "first", show=False, tooltip="first row"),
        Binding("G,end,ctrl+end", "scroll_bottom", "last", show=False, tooltip="last row"),
    ]
    TITLE: ClassVar[str] = ""
    """Title of the panel."""
    app: "FraexpApp"

    class Shown(Message):
        """A page is shown, or could not be read."""

        def __init__(self, total: int, error: str) -> None:
            super().__init__()
            self.total, self.error = total, error

    class Touched(Message):
        """The user has moved the cursor."""

    def __init__(self) -> None:
        super().__init__(cursor_type="row", zebra_stripes=True, classes="panel")
        self.border_title = self.TITLE
        self.total = 0
        """Total number of rows."""
        self.keys: tuple[str, ...] = ()
        """Keys of the visible rows."""
        self._first = 0  # offset of the first visible row, once it has been read
        self._at = 0  # offset of the cursor, once its page has been read
        self._turning = False
        self._drawn: _Drawn | None = None
        self._subtitle = ""
        self._show_subtitle("loading …")

    async def fetch_rows(self, first: int, most: int) -> TableRows:
        """Return rows from an offset; FraexpError if they cannot be read."""
        raise NotImplementedError

    @property
    def key(self) -> str | None:
        """Key of the row under the cursor; None without rows."""
        return self.keys[self.cursor_row] if 0 <= self.cursor_row < len(self.keys) else None

    @property
    def page_rows(self) -> int:
        """Number of rows that fit."""
        return max(1, self.size.height - self.header_height)

    def reload(self) -> None:
        """Read the page again; the cursor stays on its row, or at the top."""
        if self._turning:
            return  # a newer page is being read
        stays = self._place() == 0
        self._read(self._first, None if stays else self.key)

    def restart(self) -> None:
        """Read from the beginning, after a change of the rows or their order."""
        self._first = self._at = 0
        self._turning = True
        self._read(0, None)

    def _place(self) -> int:
        return self._at if self._turning else self._first + self.cursor_row

    def go_to(self, place: int) -> None:
        """Move the cursor to an offset."""
        if place != self._place():
            self._move(place)

    def _go(self, place: int, first: int | None = None) -> None:
        """Move the cursor to an offset, as the user wishes."""
        self.post_message(self.Touched())
        self._move(place, first)

    def _move(self, place: int, first: int | None = None) -> None:
        """Move the cursor to an offset, and turn the page if necessary."""
        place = min(max(place, 0), max(self.total - 1, 0))
        rows = self.page_rows
        if first is None:
            first = self._first
            first = place if place >= first + rows else place - rows + 1 if place < first else first
        first = min(max(first, 0), max(self.total - rows, 0))
        self._at = place
        if first != self._first:
            self._first, self._turning = first, True
            self._read(first, None)
        elif not self._turning:
            self.move_cursor(row=place - first)

    @work(group=TABLE_GROUP, exclusive=True)
    async def _read(self, first: int, key: str | None) -> None:
        """Read a page, and put the cursor on a key if it is given and still exists."""
        if not self.size.height:
            self._turning = False
            return  # the layout, and thus the number of rows, is not known yet
        try:
            rows = await self.fetch_rows(first, self.page_rows)
            if not rows.keys and rows.total:  # rows were deleted
                first = max(rows.total - self.page_rows, 0)
                rows = await self.fetch_rows(first, self.page_rows)
            if key and key not in rows.keys and rows.total != self.total:  # rows before it were added or deleted
                moved = max(first + rows.total - self.total, 0)
                other = await self.fetch_rows(moved, self.page_rows)
                first, rows = (moved, other) if key in other.keys else (first, rows)
        except FraexpError as error:
            self._turning = False
            self.show_error(str(error))
            self.post_message(self.Shown(self.total, str(error)))
            return
        row = rows.keys.index(key) if key in rows.keys else self._place() - first
        self._first, self._turning = first, False
        self._show(rows, min(max(row, 0), max(len(rows.keys) - 1, 0)))
        self.post_message(self.Shown(self.total, ""))

    def _show(self, rows: TableRows, row: int) -> None:
        self.total, self.keys = rows.total, rows.keys
        columns = fit_columns([_with_signs(of) for of in rows.columns], self.size.width - 1 - COLUMN_GAP)
        marked = [self.is_marked(key) for key in rows.keys]
        wanted = _Drawn(rows.keys, columns, marked)
        if wanted != self._drawn:
            with self.app.batch_update():
                if self._drawn is None or not wanted.differs_in_cells(self._drawn):
                    self._draw(rows.keys, columns, marked)
                else:
                    self._update_cells(self._drawn.columns, columns)
        self._drawn = wanted
        if row != self.cursor_row:
            self.move_cursor(row=row)
        self._show_subtitle(self.position())

    def _draw(self, keys: tuple[str, ...], columns: list[tuple[Column, int]], marked: list[bool]) -> None:
        self.clear(columns=True)
        self.add_column(Text(" "), width=1, key="")
        for index, (column, width) in enumerate(columns):
            title = Text(column.title, justify=_justify(column))
            self.add_column(title, width=width, key=f"{index}.{column.order}")
        for index, key in enumerate(keys):
            self.add_row(self._mark_cell(marked[index]), *(self._cell(of, index) for of, _ in columns), key=key)

    def _update_cells(self, before: list[tuple[Column, int]], columns: list[tuple[Column, int]]) -> None:
        """Draw the cells that have changed: other columns or rows would lay out the whole screen."""
        for place, ((old, _), (column, _)) in enumerate(zip(before, columns, strict=True), start=1):
            for row, (was, text) in enumerate(zip(old.cells, column.cells, strict=True)):
                if was != text:
                    self.update_cell_at(Coordinate(row, place), self._cell(column, row))

    def _cell(self, column: Column, index: int) -> Text:
        text = column.cells[index]
        if column.title.startswith(STATE_TITLES):
            cell = state_text(text, text.partition(" ")[2], self.app.theme_variables)
        else:
            cell = Text(text, justify=_justify(column))
        cell.no_wrap, cell.overflow = True, "ellipsis"
        return cell

    def _mark_cell(self, marked: bool) -> Text:
        return Text(MARK_SIGN, f"bold {rich_colour(self.app.theme_variables, 'accent')}") if marked else Text(" ")

    def is_marked(self, key: str) -> bool:
        """Return whether a row is marked."""
        return False

    def position(self) -> str:
        """Return which rows are visible."""
        if not self.total:
            return "no rows"
        return f"rows {self._first + 1:,}-{self._first + len(self.keys):,} of {self.total:,}"

    def show_error(self, text: str) -> None:
        """Show an error below the rows, which stay."""
        self._show_subtitle(text, error=True)

    def _show_subtitle(self, text: str, error: bool = False) -> None:
        if text != self._subtitle:
            self._subtitle = text
            self.border_subtitle = Text(printable(text))  # draws all of the table anew
        self.set_class(error, "-error")

    def on_mount(self) -> None:
        """Draw all cells again when the theme changes."""
        self.watch(self.app, "theme", self.redraw, init=False)

    def redraw(self) -> None:
        """Read the page, and draw all of its cells."""
        self._drawn = None
        self.reload()

    def on_resize(self, event: events.Resize) -> None:
        """Show as many rows as fit now."""
        self.redraw()

    def action_cursor_down(self) -> None:
        """Move to the next row."""
        self._go(self._place() + 1)

    def action_cursor_up(self) -> None:
        """Move to the previous row."""
        self._go(self._place() - 1)

    def action_page_down(self) -> None:
        """Show the next page; on the last one move to its end."""
        last = self._first + self.page_rows >= self.total
        self._go(self.total if last else self._place() + self.page_rows, self._first + self.page_rows)

    def action_page_up(self) -> None:
        """Show the previous page; on the first one move to its beginning."""
        self._go(0 if self._first == 0 else self._place() - self.page_rows, self._first - self.page_rows)

    def action_scroll_top(self) -> None:
        """Move to the first row."""
        self._go(0, 0)

    def action_scroll_bottom(self) -> None:
        """Move to the last row."""
        self._go(self.total, self.total)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Move down by some rows."""
        event.prevent_default().stop()
        self._go(self._place() + WHEEL_ROWS)

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Move up by some rows."""
        event.prevent_default().stop()
        self._go(self._place() - WHEEL_ROWS)


def _with_signs(column: Column) -> Column:
    """Return a column whose states have their sign before them."""
    if not column.title.startswith(STATE_TITLES):
        return column
    return replace(column, cells=tuple(state_cell(text) for text in column.cells))


def _justify(column: Column) -> Literal["left", "right"]:
    return "right" if column.right_aligned else "left"


class ListTable(PagedTable, Generic[Item]):
    """A row for each item of a list."""

    def __init__(
        self,
        title: str = "",
        heads: Sequence[Column] = (),
        cells_of: Callable[[Item], Sequence[str]] = lambda _: (),
        key_of: Callable[[Item], str] = str,
    ) -> None:
        """Take columns without cells, and what returns the cells of an item, and its key."""
        super().__init__()
        self.border_title = title
        self.heads, self._cells_of, self._key_of = heads, cells_of, key_of
        self.items: Sequence[Item] | None = None
        """The items; None while they are not known."""
        self.note = ""
        """What is said beside the position."""

    async def fetch_rows(self, first: int, most: int) -> TableRows:
        """Return items from an offset."""
        items = self.items or ()
        seen = items[first : first + most]
        rows = [self._cells_of(item) for item in seen]
        columns = [
            replace(head, cells=tuple(printable(row[place]) for row in rows)) for place, head in enumerate(self.heads)
        ]
        return TableRows(tuple(map(self._key_of, seen)), columns, len(items))

    @property
    def item(self) -> Item | None:
        """The item under the cursor."""
        return next((item for item in self.items or () if self._key_of(item) == self.key), None)

    def position(self) -> str:
        """Return which rows are visible."""
        if self.items is None:
            return "loading …"
        return f"{super().position()}, {self.note}" if self.note else super().position()


POINT_RANKS = {
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
"""Ranks of the columns of points: the higher, the sooner a column is dropped if not all fit."""


class PointsTable(ListTable[tuple[int, list[str]]]):
    """The points of a response, a row for each frequency."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "nothing", show=False)]

    def __init__(self) -> None:
        super().__init__(cells_of=lambda row: row[1], key_of=lambda row: str(row[0]))
        self.header_height = 2

    def show_points(self, titles: list[str], rows: list[list[str]], are_numbers: bool = True) -> None:
        """Show the points of another response, or rows of words."""
        kept = [index for index in range(len(titles)) if any(row[index] for row in rows)]
        self.heads = [_point_head(titles[index], are_numbers) for index in kept]
        self.items = list(enumerate([row[index] for index in kept] for row in rows))
        self.restart()


def _point_head(title: str, is_number: bool) -> Column:
    rank = next((rank for begin, rank in POINT_RANKS.items() if title.startswith(begin)), 0)
    return Column(title.replace(" [", "\n["), (), rank=rank, right_aligned=is_number)
