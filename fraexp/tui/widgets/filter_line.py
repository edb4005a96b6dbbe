"""An input that filters a table as the user types."""

from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.message import Message
from textual.widgets import Input


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
