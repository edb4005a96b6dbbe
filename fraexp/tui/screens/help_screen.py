"""What a screen is for, and its keys as they are at the moment."""

from typing import ClassVar

from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static

from fraexp.tui.page import Page
from fraexp.tui.services import user_settings

MANY = 4
"""Keys for the same that are told one by one."""


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
        Binding("j", "scroll(1)", "down", show=False, id="help.down", tooltip="a line down"),
        Binding("k", "scroll(-1)", "up", show=False, id="help.up", tooltip="a line up"),
        Binding("g", "turn(False)", "top", show=False, id="help.top", tooltip="to the top"),
        Binding("G", "turn(True)", "end", show=False, id="help.end", tooltip="to the end"),
    ]

    def __init__(self, page: Page) -> None:
        super().__init__()
        self._page = page

    def compose(self) -> ComposeResult:
        """Show words, then keys."""
        with VerticalScroll():
            yield Static(Text(self._page.HELP.strip() + "\n"))
            yield Static(self._keys())
            yield Static(
                Text(f"\nOther keys, colours, ASCII: {user_settings.place()}; : or ctrl+p finds commands by name.")
            )

    def _keys(self) -> Table:
        table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
        table.add_column(style="bold", no_wrap=True)
        table.add_column()
        seen: dict[tuple[str, str], list[str]] = {}
        for active in self._page.active_bindings.values():
            binding = active.binding
            if binding.id:  # else it is what the toolkit has on every screen
                what = binding.tooltip or binding.description
                kind = binding.action.partition("(")[0]  # the keys of all curves do the same
                seen.setdefault((kind, what), []).append(self.app.get_key_display(binding))
        for (_, what), keys in seen.items():
            table.add_row(_written(list(dict.fromkeys(keys))), Text(what))
        return table

    def action_scroll(self, lines: int) -> None:
        """Scroll by lines."""
        self.query_one(VerticalScroll).scroll_relative(y=lines, animate=False)

    def action_turn(self, end: bool) -> None:
        """Go to the top or to the end."""
        place = self.query_one(VerticalScroll)
        place.scroll_end(animate=False) if end else place.scroll_home(animate=False)


def _written(keys: list[str]) -> Text:
    """Return the keys that do the same; many of them by the first and the last."""
    return Text(" ".join(keys) if len(keys) <= MANY else f"{keys[0]} to {keys[-1]}")
