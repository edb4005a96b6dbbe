"""The table of sweeps: the database sorts, filters and counts what the visible page does not hold."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

from textual import work
from textual.binding import Binding, BindingType
from textual.coordinate import Coordinate
from textual.message import Message
from textual.reactive import reactive
from textual.widgets import DataTable

from fraexp.errors import FraexpError
from fraexp.store import ListingPage, Store
from fraexp.tui.dialogs import ConfirmDialog, InputDialog
from fraexp.tui.page import ACTION_GROUP, Page
from fraexp.tui.widgets.paged_table import PagedTable, TableRows
from fraexp.views.listing import Column, complete_field, listing_columns

ASCENDING_SIGN, DESCENDING_SIGN = "▲", "▼"
MAX_UNCONFIRMED_MARKS = 50
"""Maximum number of sweeps marked without confirmation."""


class SweepTable(PagedTable):
    """The sweeps of the database or of a run that match the filter."""

    TITLE = "Sweeps"

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "mark", "mark", tooltip="mark or unmark the sweep"),
        Binding("a", "mark_all", "all", show=False, tooltip="mark all matching sweeps"),
        Binding("A", "unmark_all", "unmark", show=False, tooltip="unmark all sweeps"),
        Binding("o", "order", "sort", tooltip="sort by a column, a parameter or a metric"),
        Binding("O", "turn_order", "reverse", show=False, tooltip="reverse the order"),
    ]
    filter: reactive[str] = reactive("", init=False)
    """Filter in the syntax of `Store.page`."""
    order: reactive[str] = reactive("", init=False)
    """Field to sort by, with ``-`` for descending order; empty for newest first, or the order of the run."""
    running: reactive[Mapping[str, float]] = reactive(dict, init=False)
    """Finished fractions of running sweeps, by key."""

    class Opened(Message):
        """A sweep was opened."""

        def __init__(self, key: str) -> None:
            super().__init__()
            self.key = key

    def __init__(self, run: int | None = None, shows_errors: bool = True) -> None:
        """Show the sweeps of a run, or all; `shows_errors` here, such as those of a filter, else the screen does."""
        super().__init__()
        self.run, self.shows_errors = run, shows_errors
        self._headings: list[Column] = []

    async def fetch_rows(self, first: int, most: int) -> TableRows:
        """Return sweeps from an offset."""
        wanted, order, run, running = self.filter, self.order, self.run, self.running
        workspace = self.app.backend.workspace

        def read(store: Store) -> tuple[ListingPage, list[Column]]:
            page = store.page(wanted, order, first, most, run)
            registry = workspace.registry if page.rows else None
            return page, listing_columns(page.rows, one_run=run is not None, running=running, registry=registry)

        page, columns = await self.app.backend.read(read)
        self._headings = columns
        by, sign = (
            self._applied_order.removeprefix("-"),
            DESCENDING_SIGN if self._applied_order.startswith("-") else ASCENDING_SIGN,
        )
        columns = [replace(of, title=f"{of.title} {sign}") if of.order == by else of for of in columns]
        return TableRows(tuple(row.key for row in page.rows), columns, page.total)

    def is_marked(self, key: str) -> bool:
        """Return whether a row is marked."""
        return key in self.app.marks

    @property
    def _applied_order(self) -> str:
        return self.order or ("-created" if self.run is None else "position")

    def position(self) -> str:
        """Return which sweeps are visible, and how they are sorted unless by default."""
        return f"{super().position()}, by {self.order}" if self.total and self.order else super().position()

    def show_error(self, text: str) -> None:
        """Show an error, unless the screen does."""
        if self.shows_errors:
            super().show_error(text)

    def watch_filter(self) -> None:
        """Show the matching sweeps."""
        self.restart()

    def watch_order(self) -> None:
        """Show the sweeps in the new order."""
        self.restart()

    def watch_running(self) -> None:
        """Show the progress of running sweeps."""
        self.reload()

    def on_data_table_row_selected(self, event: DataTable.RowSelected) -> None:
        """Post that a sweep was opened."""
        event.stop()
        if self.key:
            self.post_message(self.Opened(self.key))

    def on_data_table_header_selected(self, event: DataTable.HeaderSelected) -> None:
        """Sort by a column; a second click reverses the order."""
        event.stop()
        name = (event.column_key.value or "").partition(".")[2]
        if name and name == self.order:
            self.order = f"-{name}"
        elif name:
            self.order = name

    def action_mark(self) -> None:
        """Mark or unmark the sweep, and move to the next."""
        if self.key:
            self.app.marks.toggle(self.key)
            self.redraw_marks()
            self.action_cursor_down()

    @work(group=ACTION_GROUP)
    async def action_mark_all(self) -> None:
        """Mark all matching sweeps."""
        wanted, run = self.filter, self.run
        try:
            keys = await self.app.backend.read(lambda store: store.keys(wanted, run))
        except FraexpError as error:
            self.show_error(str(error))
            return
        question = ConfirmDialog(f"Mark all {len(keys):,} sweeps?")
        if len(keys) <= MAX_UNCONFIRMED_MARKS or await self.app.push_screen_wait(question):
            named = () if run is None else (str(run),)
            self.app.marks.add(keys, (*named, "--filter", wanted) if wanted or run is None else named)
            self.redraw_marks()

    def action_unmark_all(self) -> None:
        """Unmark all sweeps."""
        self.app.marks.clear()
        self.redraw_marks()

    def redraw_marks(self) -> None:
        """Update the marks of the visible rows."""
        for row, key in enumerate(self.keys):
            mark = self._mark_cell(self.is_marked(key))
            if self.get_cell_at(Coordinate(row, 0)).plain != mark.plain:
                self.update_cell_at(Coordinate(row, 0), mark)
        self._drawn = None
        if isinstance(self.screen, Page):
            self.screen.show_header()

    @work(group=ACTION_GROUP)
    async def action_order(self) -> None:
        """Ask for the field to sort by."""
        try:
            fields = await self.app.backend.read(lambda store: store.fields())
        except FraexpError as error:
            self.show_error(str(error))
            return
        headings = {of.title.partition(" ")[0]: of.order for of in self._headings if of.order}
        columns = ", ".join(headings)
        question = f"Sort by {columns}, any parameter, or metric.NAME? -NAME: descending; empty: default order"
        offered = dict.fromkeys([*headings, *fields])

        def fault(text: str) -> str:
            try:
                return _sort_field(text, fields, headings) and ""
            except FraexpError as error:
                return str(error)

        dialog = InputDialog(question, self.order, fault, [*offered, *(f"-{name}" for name in offered)])
        text = await self.app.push_screen_wait(dialog)
        if text is not None:
            self.order = _sort_field(text, fields, headings)

    def action_turn_order(self) -> None:
        """Reverse the order."""
        self.order = self._applied_order[1:] if self._applied_order.startswith("-") else f"-{self._applied_order}"


def _sort_field(text: str, fields: Sequence[str], headings: Mapping[str, str]) -> str:
    """Return the field that an answer stands for; empty for an empty one."""
    return complete_field(text.strip(), fields, headings, "sort") if text.strip() else ""
