"""An input that filters a table as the user types, and the pages that have one."""

from collections.abc import Sequence
from typing import ClassVar, Generic

from textual import on
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.suggester import Suggester
from textual.widgets import DataTable, Input

from fraexp.tui.page import Page
from fraexp.tui.widgets.paged_table import Item, ListTable, PagedTable


class FilterLine(Input):
    """Hidden until it is opened, unless it `stays`; Enter keeps the filter and moves to the table, Esc clears it."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "clear_away", "clear", show=False, tooltip="clear the filter"),
        Binding("enter,down", "leave", "go on", show=False, tooltip="move to the table"),
        Binding("tab", "take", "complete", show=False, tooltip="accept the completion"),
    ]

    class Left(Message):
        """The user moves to the table."""

    def __init__(self, placeholder: str, suggester: Suggester | None = None, stays: bool = False) -> None:
        super().__init__(placeholder=placeholder, suggester=suggester, compact=True, select_on_focus=not stays)
        self._stays = stays
        self.set_class(stays, "-shown")

    def begin(self) -> None:
        """Show and focus the input."""
        self.add_class("-shown")
        self.focus()

    @property
    def words(self) -> list[str]:
        """The words of the filter, which must all match, ignoring case."""
        return self.value.casefold().split()

    def matches(self, *texts: str) -> bool:
        """Return whether every word occurs in one of the texts."""
        return all(any(word in text.casefold() for text in texts) for word in self.words)

    def clear_away(self) -> bool:
        """Clear the filter; return whether there was something to leave."""
        was_open = bool(self.value) or self.has_focus or (self.has_class("-shown") and not self._stays)
        self.value = ""
        self.set_class(self._stays, "-shown")
        self.post_message(self.Left())
        return was_open

    def action_clear_away(self) -> None:
        """Clear the filter, and move to the table."""
        self.clear_away()

    def action_leave(self) -> None:
        """Keep the filter, and move to the table."""
        self.set_class(self._stays or bool(self.value), "-shown")
        self.post_message(self.Left())

    async def action_take(self) -> None:
        """Accept the completion, or move on."""
        offered = await self.suggester.get_suggestion(self.value) if self.suggester else None
        if offered is None:
            self.screen.focus_next()
        else:
            self.value, self.cursor_position = offered, len(offered)


class FilteredPage(Page):
    """A page with a table below a `FilterLine`; `show` shows the rows that match."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("slash", "filter", "filter", tooltip="filter by words, which must all match")
    ]

    def filter_rows(self) -> object:
        """Show the rows that match the filter, which has changed."""
        raise NotImplementedError

    @property
    def line(self) -> FilterLine:
        """The filter."""
        return self.query_one(FilterLine)

    @on(Input.Changed, "FilterLine")
    def _handle_filter(self) -> None:
        self.filter_rows()

    @on(FilterLine.Left)
    def _focus_table(self) -> None:
        self.query_one(PagedTable).focus()

    async def action_filter(self) -> None:
        """Open the filter."""
        self.line.begin()

    def action_back(self) -> None:
        """Clear the filter, or go back."""
        if not self.line.clear_away():
            super().action_back()


class ListPage(FilteredPage, Generic[Item]):
    """A page with a `ListTable` of items; a preview follows the cursor, and Enter opens an item."""

    def __init__(self) -> None:
        super().__init__()
        self.items: Sequence[Item] = ()

    def texts(self, item: Item) -> Sequence[str]:
        """Return the texts of an item in which the filter looks for words."""
        raise NotImplementedError

    def preview(self, item: Item) -> None:
        """Show what is known of the item under the cursor."""

    def open(self, item: Item) -> None:
        """Open an item."""
        raise NotImplementedError

    @property
    def table(self) -> ListTable[Item]:
        """The table of the items."""
        return self.query_one(ListTable)

    @property
    def item(self) -> Item | None:
        """The item under the cursor."""
        return self.table.item

    def show(self) -> None:
        """Show the items that match the filter."""
        self.table.items = [item for item in self.items if self.line.matches(*self.texts(item))]
        self.table.reload()

    def filter_rows(self) -> None:
        """Show the items that match the filter, from the first one."""
        self.show()
        self.table.restart()

    @on(PagedTable.Shown)
    @on(DataTable.RowHighlighted)
    def _handle_row(self) -> None:
        if self.is_attached and (item := self.item) is not None:
            self.preview(item)

    @on(DataTable.RowSelected)
    def _handle_choice(self) -> None:
        if (item := self.item) is not None:
            self.open(item)
