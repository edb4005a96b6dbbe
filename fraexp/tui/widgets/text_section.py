"""Text and tables that are scrolled by keys."""

from typing import ClassVar

from rich.console import Group, RenderableType
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

READING_TEXT = "loading ..."


class TextSection(VerticalScroll):
    """Text that can be scrolled."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("j", "scroll_down", "down", show=False, tooltip="scroll down"),
        Binding("k", "scroll_up", "up", show=False, tooltip="scroll up"),
        Binding("g", "scroll_home", "top", show=False, tooltip="scroll to the top"),
        Binding("G", "scroll_end", "end", show=False, tooltip="scroll to the end"),
    ]

    def __init__(self, *parts: RenderableType, id: str | None = None) -> None:  # noqa: A002 - as Textual calls it
        """Show texts and tables below each other, or that they are loading."""
        super().__init__(id=id)
        self._parts = parts or (READING_TEXT,)

    def compose(self) -> ComposeResult:
        """Yield what is shown at first."""
        yield Static(Group(*self._parts))

    def show_parts(self, *parts: RenderableType) -> None:
        """Show other texts and tables."""
        self.query_one(Static).update(Group(*parts))
