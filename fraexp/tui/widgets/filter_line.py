"""A line that narrows a table while one types in it."""

from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.message import Message
from textual.widgets import Input


class FilterLine(Input):
    """Hidden until it is asked for; Enter goes on with what is left, Esc takes the filter away."""

    DEFAULT_CSS = """
    FilterLine { display: none; }
    FilterLine.-shown { display: block; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "clear_away", "clear", show=False, id="filter.clear", tooltip="take the filter away"),
        Binding("enter,down", "leave", "go on", show=False, id="filter.leave", tooltip="go on with what is left"),
    ]

    class Left(Message):
        """One goes on with what is left."""

    def __init__(self, placeholder: str) -> None:
        super().__init__(placeholder=placeholder, compact=True)

    def begin(self) -> None:
        """Show the line, to be typed in."""
        self.add_class("-shown")
        self.focus()

    @property
    def words(self) -> list[str]:
        """What is looked for: all of these, in whatever case."""
        return self.value.casefold().split()

    def lets(self, *texts: str) -> bool:
        """Return whether every word occurs in one of the texts."""
        return all(any(word in text.casefold() for text in texts) for word in self.words)

    def clear_away(self) -> bool:
        """Take the filter away; return whether there was one."""
        shown = self.has_class("-shown")
        self.value = ""
        self.remove_class("-shown")
        return shown

    def action_clear_away(self) -> None:
        """Take the filter away."""
        self.clear_away()
        self.post_message(self.Left())

    def action_leave(self) -> None:
        """Go on with what is left."""
        self.set_class(bool(self.value), "-shown")
        self.post_message(self.Left())
