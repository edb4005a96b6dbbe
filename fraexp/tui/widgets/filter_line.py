"""An input that filters a table as the user types, and the pages that have one."""

from typing import ClassVar

from textual import on
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.widgets import Input

from fraexp.tui.page import Page
from fraexp.tui.widgets.paged_table import PagedTable


class FilterLine(Input):
    """Hidden until it is opened; Enter keeps the filter and moves to the table, Esc clears it."""

    DEFAULT_CSS = """
    FilterLine { display: none; }
    FilterLine.-shown { display: block; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "clear_away", "clear", show=False, tooltip="clear the filter"),
        Binding("enter,down", "leave", "go on", show=False, tooltip="move to the table"),
    ]

    class Left(Message):
        """The user moves to the table."""

    def __init__(self, placeholder: str) -> None:
        super().__init__(placeholder=placeholder, compact=True)

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
        """Clear and hide the filter; return whether it was open."""
        shown = self.has_class("-shown")
        self.value = ""
        self.remove_class("-shown")
        return shown

    def action_clear_away(self) -> None:
        """Clear the filter, and move to the table."""
        self.clear_away()
        self.post_message(self.Left())

    def action_leave(self) -> None:
        """Keep the filter, and move to the table."""
        self.set_class(bool(self.value), "-shown")
        self.post_message(self.Left())


class FilteredPage(Page):
    """A page with a table below a `FilterLine`, in which `show` shows the rows that match."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("slash", "filter", "filter", tooltip="filter by words, which must all match"),
    ]

    def show(self) -> None:
        """Show the rows that match the filter."""
        raise NotImplementedError

    @property
    def line(self) -> FilterLine:
        """The filter."""
        return self.query_one(FilterLine)

    @on(Input.Changed, "FilterLine")
    def _handle_filter(self) -> None:
        self.show()

    @on(FilterLine.Left)
    def _focus_table(self) -> None:
        self.query_one(PagedTable).focus()

    def action_filter(self) -> None:
        """Open the filter."""
        self.line.begin()

    def action_back(self) -> None:
        """Clear the filter, or go back."""
        if not self.line.clear_away():
            super().action_back()
