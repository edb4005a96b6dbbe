"""A table of which only the page that is seen exists: the database sorts, filters and counts the rest."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Literal

from rich.text import Text
from textual import events
from textual.binding import Binding, BindingType
from textual.coordinate import Coordinate
from textual.message import Message
from textual.reactive import reactive
from textual.widgets import DataTable

from fraexp.errors import FraexpError
from fraexp.figures.elements.labels import printable
from fraexp.tui.dialogs import Ask, Confirm
from fraexp.tui.page import PAGE, Page
from fraexp.views.listing import GAP, Column, fitted, listing_columns

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp

MARK = "✓"
UP, DOWN = "▲", "▼"
NEAR = 4
"""Names that are offered in place of one that there is not."""
MANY = 50
"""More sweeps than these are marked only if that is confirmed."""
WHEEL = 3
"""Rows by which the mouse wheel moves the cursor."""


class TableRows:
    """One page: the keys of its rows, its columns, and how many rows there are in all."""

    def __init__(self, keys: tuple[str, ...], columns: list[Column], total: int) -> None:
        self.keys, self.columns, self.total = keys, columns, total


class PagedTable(DataTable[Text]):
    """Shows as many rows as fit; the cursor turns the page at its edges, and stays on its row when others come or go.

    A subclass says in `ask` where rows come from. The widget's last line tells which rows are seen, or what is wrong.
    """

    DEFAULT_CSS = """
    PagedTable {
        height: 1fr; overflow: hidden hidden; scrollbar-size: 0 0;
        border-bottom: solid $panel-lighten-2; border-subtitle-align: left; border-subtitle-color: $text-muted;
    }
    PagedTable.-error { border-subtitle-color: $text-error; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "select_cursor", "open", id="table.open", tooltip="open what is under the cursor"),
        Binding("down,j", "cursor_down", "down", show=False, id="table.down", tooltip="next row"),
        Binding("up,k", "cursor_up", "up", show=False, id="table.up", tooltip="row before"),
        Binding("pagedown,right,l", "page_down", "page", show=False, id="table.next", tooltip="next page"),
        Binding("pageup,left,h", "page_up", "page back", show=False, id="table.before", tooltip="page before"),
        Binding("g,home,ctrl+home", "scroll_top", "first", show=False, id="table.first", tooltip="first row of all"),
        Binding("G,end,ctrl+end", "scroll_bottom", "last", show=False, id="table.last", tooltip="last row of all"),
    ]
    app: "FraexpApp"

    class Shown(Message):
        """A page is shown, or could not be had."""

        def __init__(self, total: int, error: str) -> None:
            super().__init__()
            self.total, self.error = total, error

    def __init__(self) -> None:
        super().__init__(cursor_type="row", zebra_stripes=True)
        self.total = 0
        """Rows in all."""
        self.keys: tuple[str, ...] = ()
        """Those of the rows that are seen."""
        self._first = 0  # place of the first row that is seen, or that will be when it has been read
        self._at = 0  # the cursor's place among all rows, once what is being read is there
        self._turning = False
        self._drawn: object = None

    async def ask(self, first: int, most: int) -> TableRows:
        """Return rows from a place on; FraexpError says why that cannot be."""
        raise NotImplementedError

    @property
    def key(self) -> str | None:
        """Key of the row under the cursor; None if there is none."""
        return self.keys[self.cursor_row] if 0 <= self.cursor_row < len(self.keys) else None

    @property
    def page_rows(self) -> int:
        """How many rows fit."""
        return max(1, self.size.height - self.header_height)

    def reload(self) -> None:
        """Read the page again; the cursor stays on its row, and at the top if it is there."""
        if self._turning:
            return  # something newer is on its way
        stays = self._place() == 0
        self._start(self._first, None if stays else self.key)

    def restart(self) -> None:
        """Read from the beginning: there are other rows now, or another order."""
        self._first = self._at = 0
        self._turning = True
        self._start(0, None)

    def _place(self) -> int:
        return self._at if self._turning else self._first + self.cursor_row

    def _go(self, place: int, first: int | None = None) -> None:
        """Put the cursor at a place among all rows, and turn the page if it is not on this one."""
        place = min(max(place, 0), max(self.total - 1, 0))
        rows = self.page_rows
        if first is None:
            first = self._first
            first = place if place >= first + rows else place - rows + 1 if place < first else first
        first = min(max(first, 0), max(self.total - rows, 0))
        self._at = place
        if first != self._first:
            self._first, self._turning = first, True
            self._start(first, None)
        elif not self._turning:
            self.move_cursor(row=place - first)

    def _start(self, first: int, key: str | None) -> None:
        reading: Callable[[], object] = partial(self._read, first, key)
        self.run_worker(reading, group=PAGE, exclusive=True)

    async def _read(self, first: int, key: str | None) -> None:
        """Read a page, and put the cursor on a key if one is given and still there."""
        if not self.size.height:
            self._turning = False
            return  # not laid out yet: what fits is not known until it is
        try:
            rows = await self.ask(first, self.page_rows)
            if not rows.keys and rows.total:  # rows have gone
                first = max(rows.total - self.page_rows, 0)
                rows = await self.ask(first, self.page_rows)
            if key and key not in rows.keys and rows.total != self.total:  # others came or went before it
                moved = max(first + rows.total - self.total, 0)
                other = await self.ask(moved, self.page_rows)
                first, rows = (moved, other) if key in other.keys else (first, rows)
        except FraexpError as error:
            self._turning = False
            self.tell_error(str(error))
            self.post_message(self.Shown(self.total, str(error)))
            return
        row = rows.keys.index(key) if key in rows.keys else self._place() - first
        self._first, self._turning = first, False
        self._show(rows, min(max(row, 0), max(len(rows.keys) - 1, 0)))
        self.post_message(self.Shown(self.total, ""))

    def _show(self, rows: TableRows, row: int) -> None:
        self.total, self.keys = rows.total, rows.keys
        columns = fitted(rows.columns, self.size.width - 1 - GAP)
        marked = [self.is_marked(key) for key in rows.keys]
        wanted = (rows.keys, columns, marked)
        if wanted != self._drawn:
            with self.app.batch_update():
                self._draw(rows.keys, columns, marked)
        self._drawn = wanted
        if row != self.cursor_row:
            self.move_cursor(row=row)
        self._tell(self.position())

    def _draw(self, keys: tuple[str, ...], columns: list[tuple[Column, int]], marked: list[bool]) -> None:
        self.clear(columns=True)
        self.add_column(Text(" "), width=1, key="")
        for index, (column, width) in enumerate(columns):
            title = Text(column.title, justify=_justify(column))
            self.add_column(title, width=width, key=f"{index}.{column.order}")
        for index, key in enumerate(keys):
            cells = [
                Text(of.cells[index], justify=_justify(of), no_wrap=True, overflow="ellipsis") for of, _ in columns
            ]
            self.add_row(Text(MARK if marked[index] else " "), *cells, key=key)

    def is_marked(self, key: str) -> bool:
        """Return whether a row has a mark."""
        return key in self.app.marks

    def position(self) -> str:
        """Return which rows are seen."""
        if not self.total:
            return "nothing"
        return f"rows {self._first + 1:,}-{self._first + len(self.keys):,} of {self.total:,}"

    def tell_error(self, text: str) -> None:
        """Tell what is wrong below the rows that stay."""
        self._tell(text, error=True)

    def _tell(self, text: str, error: bool = False) -> None:
        self.border_subtitle = Text(printable(text))
        self.set_class(error, "-error")

    def on_resize(self, event: events.Resize) -> None:
        """Show as many rows as fit now."""
        self._drawn = None
        self.reload()

    def action_cursor_down(self) -> None:
        """Move to the next row, on the next page if need be."""
        self._go(self._place() + 1)

    def action_cursor_up(self) -> None:
        """Move to the row before, on the page before if need be."""
        self._go(self._place() - 1)

    def action_page_down(self) -> None:
        """Turn the page; on the last one go to its end."""
        last = self._first + self.page_rows >= self.total
        self._go(self.total if last else self._place() + self.page_rows, self._first + self.page_rows)

    def action_page_up(self) -> None:
        """Turn back; on the first page go to its begin."""
        self._go(0 if self._first == 0 else self._place() - self.page_rows, self._first - self.page_rows)

    def action_scroll_top(self) -> None:
        """Go to the first row of all."""
        self._go(0, 0)

    def action_scroll_bottom(self) -> None:
        """Go to the last row of all."""
        self._go(self.total, self.total)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Move down by some rows."""
        event.prevent_default().stop()
        self._go(self._place() + WHEEL)

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Move up by some rows."""
        event.prevent_default().stop()
        self._go(self._place() - WHEEL)


def _justify(column: Column) -> Literal["left", "right"]:
    return "right" if column.right else "left"


class SweepTable(PagedTable):
    """The sweeps of the database, or of a run, which a filter lets through."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "mark", "mark", id="table.mark", tooltip="mark the sweep, or take its mark away"),
        Binding("a", "mark_all", "all", show=False, id="table.all", tooltip="mark all sweeps that match"),
        Binding("A", "unmark_all", "unmark", show=False, id="table.unmark", tooltip="take all marks away"),
        Binding("o", "order", "sort", id="table.order", tooltip="sort by a column, a parameter or a metric"),
        Binding("O", "turn_order", "turn", show=False, id="table.turn", tooltip="turn the order round"),
    ]
    filter: reactive[str] = reactive("", init=False)
    """What sweeps must be like, in the language of `Store.page`."""
    order: reactive[str] = reactive("", init=False)
    """Field that sorts, with ``-`` before it for falling; empty for newest first, or a run's own order."""
    running: reactive[Mapping[str, float]] = reactive(dict, init=False)
    """What is done of the sweeps that are being computed, by key."""

    class Opened(Message):
        """A sweep was chosen."""

        def __init__(self, key: str) -> None:
            super().__init__()
            self.key = key

    def __init__(self, run: int | None = None, tells: bool = True) -> None:
        """Show a run's sweeps, or all; `tells`: what is wrong with the filter is told here, not by the screen."""
        super().__init__()
        self.run, self.tells = run, tells

    async def ask(self, first: int, most: int) -> TableRows:
        """Return sweeps from a place on."""
        wanted, order, run = self.filter, self.order, self.run
        page = await self.app.desk.read(lambda store: store.page(wanted, order, first, most, run))
        columns = listing_columns(page.rows, one_run=run is not None, running=self.running)
        by, sign = self._by.removeprefix("-"), DOWN if self._by.startswith("-") else UP
        columns = [replace(of, title=f"{of.title} {sign}") if of.order == by else of for of in columns]
        return TableRows(tuple(row.key for row in page.rows), columns, page.total)

    @property
    def _by(self) -> str:
        return self.order or ("-created" if self.run is None else "position")

    def position(self) -> str:
        """Return which sweeps are seen, and how they are sorted where no column tells."""
        return f"{super().position()}, by {self.order}" if self.total and self.order else super().position()

    def tell_error(self, text: str) -> None:
        """Leave it to the screen to tell, if it does."""
        if self.tells:
            super().tell_error(text)

    def watch_filter(self) -> None:
        """Show other sweeps."""
        self.restart()

    def watch_order(self) -> None:
        """Show them in another order."""
        self.restart()

    def watch_running(self) -> None:
        """Show how far they are."""
        self.reload()

    def on_data_table_row_selected(self, event: DataTable.RowSelected) -> None:
        """Tell which sweep was chosen."""
        event.stop()
        if self.key:
            self.post_message(self.Opened(self.key))

    def on_data_table_header_selected(self, event: DataTable.HeaderSelected) -> None:
        """Sort by a column; by the same again, the other way round."""
        event.stop()
        name = (event.column_key.value or "").partition(".")[2]
        if name and name == self.order:
            self.order = f"-{name}"
        elif name:
            self.order = name

    def action_mark(self) -> None:
        """Mark the sweep, or take its mark away, and go on."""
        if self.key:
            self.app.marks.toggle(self.key)
            self.remark()
            self.action_cursor_down()

    async def action_mark_all(self) -> None:
        """Mark all sweeps that match."""
        wanted, run = self.filter, self.run
        try:
            keys = await self.app.desk.read(lambda store: store.keys(wanted, run))
        except FraexpError as error:
            self.tell_error(str(error))
            return
        if len(keys) > MANY:
            self.app.push_screen(
                Confirm(f"Mark all {len(keys):,} sweeps?"), lambda yes: self._mark(keys if yes else [])
            )
        else:
            self._mark(keys)

    def _mark(self, keys: list[str]) -> None:
        self.app.marks.add(keys)
        self.remark()

    def action_unmark_all(self) -> None:
        """Take all marks away."""
        self.app.marks.clear()
        self.remark()

    def remark(self) -> None:
        """Show the marks as they are."""
        for row, key in enumerate(self.keys):
            mark = MARK if self.is_marked(key) else " "
            if self.get_cell_at(Coordinate(row, 0)).plain != mark:
                self.update_cell_at(Coordinate(row, 0), Text(mark))
        self._drawn = None
        if isinstance(self.screen, Page):
            self.screen.head()

    async def action_order(self) -> None:
        """Ask by what to sort."""
        try:
            fields = await self.app.desk.read(lambda store: store.fields())
        except FraexpError as error:
            self.tell_error(str(error))
            return
        question = "Sort by which column, parameter or metric? With - before it, falling; nothing: as at first"
        ask = Ask(
            question, self.order, lambda text: _unknown(text, fields), [*fields, *(f"-{name}" for name in fields)]
        )
        self.app.push_screen(ask, lambda text: None if text is None else setattr(self, "order", text.strip()))

    def action_turn_order(self) -> None:
        """Turn the order round."""
        self.order = self._by[1:] if self._by.startswith("-") else f"-{self._by}"


def _unknown(text: str, known: Sequence[str]) -> str:
    name = text.strip().removeprefix("-")
    if not name or name in known:
        return ""
    near = [of for of in known if name.lower() in of.lower()] or get_close_matches(name, known, NEAR)
    return f"there is no field '{name}'" + (f"; with a name like that: {', '.join(near[:NEAR])}" if near else "")
