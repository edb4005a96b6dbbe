"""What a screen is for, and its keys as they are at the moment."""

from typing import ClassVar

from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static

from fraexp.tui import settings
from fraexp.tui.page import Page


class HelpPage(ModalScreen[None]):
    """Help for the screen below it."""

    DEFAULT_CSS = """
    HelpPage { align: center middle; }
    HelpPage > VerticalScroll {
        width: 76; max-width: 96%; height: auto; max-height: 90%; padding: 1 2;
        background: $surface; border: round $primary;
    }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,question_mark,f1,q,enter", "dismiss", "close", id="help.close"),
        Binding("j", "scroll(1)", show=False),
        Binding("k", "scroll(-1)", show=False),
    ]

    def __init__(self, page: Page) -> None:
        super().__init__()
        self._page = page

    def compose(self) -> ComposeResult:
        """Show words, then keys."""
        with VerticalScroll():
            yield Static(Text(self._page.HELP.strip() + "\n"))
            yield Static(self._keys())
            yield Static(Text(f"\nOther keys, colours, ASCII: {settings.place()}; : or ctrl+p finds commands by name."))

    def _keys(self) -> Table:
        table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
        table.add_column(style="bold", no_wrap=True)
        table.add_column()
        seen: dict[tuple[str, str], list[str]] = {}
        for active in self._page.active_bindings.values():
            binding = active.binding
            what = binding.tooltip or binding.description
            if what and not binding.system:
                seen.setdefault((binding.action, what), []).append(self.app.get_key_display(binding))
        for (_, what), keys in seen.items():
            table.add_row(" ".join(dict.fromkeys(keys)), Text(what))
        return table

    def action_scroll(self, lines: int) -> None:
        """Scroll by lines."""
        self.query_one(VerticalScroll).scroll_relative(y=lines, animate=False)
